"""The settings of the commands that do everything at once."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from recon.cli.commands.setting import OUT, Command, option
from recon.cli.commands.shared import APPROACHES, CLUSTER, DEVICE, WORKERS

DEMO_SIZE = "1280x720"


class Demo(Command):
    """Of `demo`."""

    out: Path = option(Path("demo"), "Folder for everything that is made; a second start resumes.")
    port: int = option(8000, "Port of the server; 0 for any free one.", ge=0, le=65535)
    participants: int = option(12, "How many simulated participants vote.", ge=0)
    size: str | None = option(
        None, f"WIDTHxHEIGHT of the films, pixels; smaller ones are made sooner.  [default: {DEMO_SIZE}]"
    )
    serve: bool = option(True, "Serve the study afterwards, until you press Ctrl-C.")


class ExperimentPaper(Command):
    """Of `experiment paper`."""

    out: Path = option(..., "Folder for everything that is made; a second start resumes.", flags=OUT)
    scale: str = option("small", "small takes minutes; full makes videos in full HD of 15 s and takes hours.")
    frames: int | None = option(
        None, "How many frames show a scene's motion: fewer take less time.  [default: 3; full: 125]", ge=1
    )
    seconds: float | None = option(None, "Length of each video.  [default: 3; full: 15]", ge=0.2)
    approach: str = APPROACHES
    colour: str = option("vertices", "Sources of the models' colours, a third factor if both: vertices,photographs.")
    models: list[Path] | None = option(
        None, "Folder of models of a scene by another program, with a scene.json; once for each scene."
    )
    ratings: bool = option(
        False, "Let other people, sent by a platform, also rate every video (ACR).", flags=("--ratings",)
    )
    workers: int = WORKERS
    cluster: str | None = CLUSTER
    device: Literal["cpu", "gpu"] = DEVICE
    yes: bool = option(False, "Start `full` without asking.", flags=("--yes",))
