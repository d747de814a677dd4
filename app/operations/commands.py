"""The settings of the commands that jobs run, said once for the command line and for the forms of jobs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from recon.commands import COMMANDS as COMMANDS_OF_RECON
from recon.commands.setting import Argument, Command
from recon.commands.shared import PRACTICE, out


class StimuliImport(Command):
    """Of `stimuli import`."""

    folder: Annotated[
        Path, Argument("Folder with DATASET/CONDITION.mp4; conditions.csv in it gives factors; masters are kept.")
    ]
    out: Annotated[Path, out("New folder for the stimulus set.")]
    practice: Annotated[
        str | None, replace(PRACTICE, help="Dataset of two videos for practice; it is not compared.")
    ] = None


COMMANDS: Mapping[str, type[Command]] = {**COMMANDS_OF_RECON, "stimuli import": StimuliImport}
