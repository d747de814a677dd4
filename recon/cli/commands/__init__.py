"""The settings of each command, said once: its flags, the form of its job and its JSON Schema are made from them.

This room imports nothing but pydantic and the ground: it is the one of `recon` that more of `app` than the command line
may read.
"""

from __future__ import annotations

from collections.abc import Mapping

from recon.cli.commands.experiments import Demo, ExperimentPaper
from recon.cli.commands.measures import (
    ValidateCloud,
    ValidateCuboid,
    ValidateFilms,
    ValidateMesh,
    ValidateObject,
    ValidateSphere,
    ValidateViews,
)
from recon.cli.commands.reconstruction import Export, Fuse, Match, Models, Reconstruct, Render
from recon.cli.commands.recordings import (
    CaptureBoard,
    CaptureCalibrate,
    CaptureCheck,
    CaptureExport,
    CaptureImport,
    CaptureMask,
    CaptureSegment,
    CaptureSynth,
    CaptureTruth,
)
from recon.cli.commands.setting import Command

COMMANDS: Mapping[str, type[Command]] = {
    "match": Match,
    "reconstruct": Reconstruct,
    "fuse": Fuse,
    "export": Export,
    "models": Models,
    "render": Render,
    "capture synth": CaptureSynth,
    "capture truth": CaptureTruth,
    "capture export": CaptureExport,
    "capture board": CaptureBoard,
    "capture mask": CaptureMask,
    "capture import": CaptureImport,
    "capture calibrate": CaptureCalibrate,
    "capture segment": CaptureSegment,
    "capture check": CaptureCheck,
    "validate sphere": ValidateSphere,
    "validate cuboid": ValidateCuboid,
    "validate object": ValidateObject,
    "validate views": ValidateViews,
    "validate mesh": ValidateMesh,
    "validate cloud": ValidateCloud,
    "validate films": ValidateFilms,
    "experiment paper": ExperimentPaper,
    "demo": Demo,
}
