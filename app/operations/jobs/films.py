"""Jobs that make models of captures, and stimulus sets of models or films."""

from __future__ import annotations

from app.operations.jobs.fields import SETS, Choice, Choices, Entries, Entry, NewName, Number, Switch, Text
from app.operations.jobs.kind import JobKind, named
from app.operations.jobs.shared_fields import CAPTURE, FRAMES, NAMES_FORM, PRACTICE

FILMS = (
    JobKind(
        name="reconstruct",
        title="Reconstruct",
        help="Makes depth maps, clouds and models of a capture by every approach, a depth method with a fusion.",
        command=("reconstruct",),
        fields=(
            CAPTURE,
            NewName(name="name", label="Name", help="of the run", shelf="runs", pattern="{capture}"),
            Choices(
                name="depth",
                label="Depth methods",
                help="none chosen: id, dr and pm, or given if the capture holds depth maps alone",
                option="--depth",
                choices={
                    "id": "whole disparities, the quickest",
                    "dr": "disparities refined",
                    "pm": "PatchMatch, the slowest",
                    "sgm": "semi-global matching, to compare with",
                    "given": "the capture's own depth maps",
                },
            ),
            Choices(
                name="fusion",
                label="Fusions",
                help="none chosen: fa and fb",
                option="--fusion",
                choices={
                    "fa": "a surface of each sensor, then merged",
                    "fb": "one surface of all sensors",
                    "poisson": "screened Poisson, to compare with",
                    "tsdf": "signed distances in voxels, to compare with",
                },
            ),
            Choices(
                name="colour",
                label="Colours",
                help="none chosen: vertices",
                option="--colour",
                choices={
                    "vertices": "averaged as the surface is",
                    "photographs": "a texture as sharp as the pictures",
                },
            ),
            FRAMES,
            Number(
                name="voxel",
                label="Voxel",
                help="size, mm; empty: chosen from the depth resolution",
                option="--voxel",
                low=0.01,
                high=10_000,
            ),
            Switch(
                name="temporal",
                label="Filter depth in time",
                help="reduces flicker",
                off_option="--no-temporal",
                default=True,
            ),
            Switch(
                name="balance",
                label="Balance colours",
                help="makes the sensors' colours agree",
                option="--balance-colours",
            ),
            Number(
                name="close_holes",
                label="Close holes",
                help="whose rim is no longer than this, mm; empty: leave them open",
                option="--close-holes",
                low=0,
                high=100_000,
            ),
            Number(
                name="erode",
                label="Cut off at masks",
                help="pixels along the masks' edges; empty: none",
                option="--erode",
                low=0,
                high=100,
                is_whole=True,
            ),
        ),
        output=named("runs"),
        more=lambda _, settings: [
            *(["--device=gpu"] if settings.jobs_device == "gpu" else []),
            *([f"--cluster={settings.jobs_cluster}"] if settings.jobs_cluster else []),
        ],
    ),
    JobKind(
        name="render",
        title="Render films",
        help="Films every approach of runs and models by the same camera and light: a stimulus set for studies.",
        command=("render",),
        fields=(
            Entries(
                name="sources",
                label="Runs and models",
                help="all of one scene are filmed alike",
                shelves=("runs", "models"),
                is_required=True,
            ),
            NewName(name="name", label="Name", help="of the stimulus set", shelf=SETS, pattern="{sources}"),
            Text(
                name="size",
                label="Size",
                help="WIDTHxHEIGHT, pixels, both even",
                option="--size",
                default="1920x1080",
                form=r"[1-9]\d{0,2}[02468]x[1-9]\d{0,2}[02468]",
                example="1920x1080",
            ),
            Number(name="fps", label="Frames a second", option="--fps", default=25, low=1, high=120),
            Number(
                name="seconds",
                label="Seconds",
                help="of every film",
                option="--seconds",
                default=15,
                low=0.04,
                high=600,
            ),
            Choice(
                name="background",
                label="Background",
                option="--background",
                default="studio",
                choices={"studio": "a bright studio", "dark": "a dark room", "plain": "one colour"},
            ),
            Choice(
                name="path",
                label="Camera's way",
                option="--path",
                default="auto",
                choices={
                    "auto": "along the sensors, or to both sides of a single one",
                    "sensors": "along the sensors",
                    "orbit": "once around",
                    "swing": "to both sides of the first sensor",
                },
            ),
            Choice(
                name="loop",
                label="A short recording",
                option="--loop",
                default="bounce",
                choices={
                    "bounce": "plays back and forth",
                    "repeat": "starts again",
                    "static": "shows its first model alone",
                },
            ),
            Text(
                name="static",
                label="Still approaches",
                help="approaches of one model beside others that move, with commas",
                option="--static",
                form=NAMES_FORM,
                example="scan",
            ),
            PRACTICE,
        ),
        output=named(SETS),
    ),
    JobKind(
        name="import-films",
        title="Import films",
        help="Makes a stimulus set of films that were made elsewhere, DATASET/CONDITION.mp4.",
        command=("stimuli", "import"),
        fields=(
            Entry(name="films", label="Films", help="a folder of films", shelves=("films",), is_required=True),
            NewName(name="name", label="Name", help="of the stimulus set", shelf=SETS, pattern="{films}"),
            PRACTICE,
        ),
        output=named(SETS),
        needs_recon=False,
    ),
)
