"""The settings of the commands that jobs run, said once for the command line and for the forms of jobs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from recon.cli.commands import COMMANDS as COMMANDS_OF_RECON
from recon.cli.commands.setting import OUT, Command, argument, option
from recon.cli.commands.shared import PRACTICE


class StimuliImport(Command):
    """Of `stimuli import`."""

    folder: Path = argument("Folder with DATASET/CONDITION.mp4; conditions.csv in it gives factors; masters are kept.")
    out: Path = option(..., "New folder for the stimulus set.", flags=OUT)
    conform: bool = option(
        False,
        "Make films of a dataset alike that differ in size, frame rate or length.",
        label="Make unlike films alike",
    )
    practice: str | None = option(None, "Dataset of two videos for practice; it is not compared.", **PRACTICE)


COMMANDS: Mapping[str, type[Command]] = {**COMMANDS_OF_RECON, "stimuli import": StimuliImport}
