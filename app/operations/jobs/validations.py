"""Jobs that measure runs, films and clouds."""

from __future__ import annotations

import os.path
from dataclasses import replace

from app.errors import InvalidError
from app.files import read_json
from app.intake.stimuli import MANIFEST
from app.intake.summaries import RUN_FILE
from app.operations.jobs.fields import SETS, Choice, Entries, Entry, Names, Number, Text, Values, place
from app.operations.jobs.kind import JobKind, named
from app.operations.jobs.shared_fields import CAPTURE, FRAMES, NAME_FORM, NAMES_FORM, report_name
from app.settings import Settings


def recording_of(values: Values, settings: Settings) -> str | None:
    """Return the capture that a run was made of; None where it lies elsewhere, or the run names none."""
    run = place(settings, "runs") / values["run"]
    try:
        folder, name = os.path.split(os.path.normpath(run / str(read_json(run / RUN_FILE).get("recording"))))
        is_here = folder == os.path.normpath(place(settings, "captures"))
        return CAPTURE.checked(name, settings) if is_here else None
    except (ValueError, InvalidError):
        return None


DATASET = Text(
    name="dataset",
    label="Dataset",
    help="scene of a study that the results are for; empty: every scene",
    option="--dataset",
    form=NAME_FORM,
    example="ball",
)
APPROACH = Text(
    name="approach",
    label="Approach",
    help="approach of a study that the results are for; empty: none",
    option="--approach",
    form=NAME_FORM,
    example="pm_fb",
)
UNIT = Choice(
    name="unit",
    label="Unit",
    help="of the clouds",
    option="--unit",
    default="mm",
    choices={"mm": "millimetres", "cm": "centimetres", "m": "metres", "in": "inches"},
)
THRESHOLDS = Text(
    name="thresholds",
    label="Thresholds",
    help="of the share of inliers, mm, FROM:TO or FROM:TO:STEP",
    option="--thresholds",
    form=r"\d+(?:\.\d+)?(?::\d+(?:\.\d+)?){1,2}",
    example="5:100",
)
CLOUDS = Entries(
    name="clouds",
    label="Clouds",
    help="PLY files, or folders of them: one for each sensor and place",
    shelves=("clouds",),
    takes="files",
    is_required=True,
)
SENSORS = Names(
    name="sensors",
    label="Sensors",
    help="names for the clouds, in their order; fewer names than clouds repeat; empty: one sensor saw all of them",
    option="--sensor",
    form=NAMES_FORM,
    example="S1,S2",
)


VALIDATIONS = (
    JobKind(
        name="validate-views",
        title="Validate a run by photographs",
        help="Compares the sensors with each other, and the models with photographs.",
        command=("validate", "views"),
        fields=(
            Entry(name="run", label="Run", shelves=("runs",), holds=RUN_FILE, is_required=True),
            report_name("{run}-views"),
            replace(
                CAPTURE,
                option="--capture",
                help="none: where the run says that it was",
                is_required=False,
                otherwise=recording_of,
            ),
            FRAMES,
            Number(
                name="threshold",
                label="Threshold",
                help="two sensors agree within this, mm; empty: the depth of one pixel of disparity",
                option="--threshold",
                low=0.001,
                high=10_000,
            ),
        ),
        output=named("runs"),
    ),
    JobKind(
        name="validate-films",
        title="Validate films",
        help="Compares the films of a stimulus set with those of a reference: PSNR, SSIM, MS-SSIM, VMAF and flicker.",
        command=("validate", "films"),
        fields=(
            Entry(name="set", label="Stimulus set", shelves=(SETS,), holds=MANIFEST, is_required=True),
            Text(
                name="reference",
                label="Reference",
                help="condition that the others are compared with",
                option="--reference",
                is_required=True,
                form=NAME_FORM,
                example="truth",
            ),
            report_name("{set}-films"),
            Number(
                name="every",
                label="Every so many frames",
                help="is measured",
                option="--every",
                default=1,
                low=1,
                high=1000,
                is_whole=True,
            ),
        ),
        output=named("runs"),
    ),
    JobKind(
        name="validate-clouds",
        title="Validate clouds or models",
        help="Compares clouds, or the models of a run, with a reference: D1, D2, Chamfer, F-score, colours, PointSSIM.",
        command=("validate", "cloud"),
        fields=(
            Entries(
                name="clouds",
                label="Clouds",
                help="runs; or PLY files, or folders with one for each frame",
                shelves=("runs", "clouds"),
                takes="either",
                is_required=True,
            ),
            Entry(
                name="reference",
                label="Reference",
                help="a PLY file, a folder with one for each frame, or a synthetic capture, which has the truth",
                option="--reference",
                shelves=("clouds", "captures"),
                takes="either",
                is_required=True,
            ),
            report_name("{clouds}-clouds"),
            FRAMES,
        ),
        output=named("runs"),
    ),
    JobKind(
        name="validate-sphere",
        title="Validate a sphere",
        help="Fits spheres of known radius to clouds, and reports signed errors and inliers.",
        command=("validate", "sphere"),
        fields=(
            CLOUDS,
            Number(
                name="radius",
                label="Radius",
                help="mm",
                option="--radius",
                is_required=True,
                low=0.001,
                high=1e6,
            ),
            SENSORS,
            report_name("{clouds}-sphere"),
            THRESHOLDS,
            UNIT,
            DATASET,
            APPROACH,
        ),
        output=named("runs"),
    ),
    JobKind(
        name="validate-cuboid",
        title="Validate a cuboid",
        help="Fits cuboids of known size to clouds, and reports planes, angles and edges.",
        command=("validate", "cuboid"),
        fields=(
            CLOUDS,
            Text(
                name="size",
                label="Edges",
                help="AxBxC, mm",
                option="--size",
                is_required=True,
                form=r"\d+(?:\.\d+)?(?:x\d+(?:\.\d+)?){2}",
                example="220x320x160",
            ),
            SENSORS,
            report_name("{clouds}-cuboid"),
            THRESHOLDS,
            UNIT,
            DATASET,
            APPROACH,
        ),
        output=named("runs"),
    ),
    JobKind(
        name="validate-object",
        title="Validate a known object",
        help="Finds a known mesh in a cloud, and reports signed distances and inliers.",
        command=("validate", "object"),
        fields=(
            Entry(
                name="model",
                label="Known object",
                help="PLY of its mesh",
                shelves=("clouds",),
                takes="file",
                is_required=True,
            ),
            Entry(name="cloud", label="Cloud", help="PLY", shelves=("clouds",), takes="file", is_required=True),
            report_name("{cloud}-object"),
            THRESHOLDS,
            UNIT,
            replace(UNIT, name="model_unit", label="Unit of the object", help="", option="--model-unit"),
            DATASET,
            APPROACH,
        ),
        output=named("runs"),
    ),
    JobKind(
        name="validate-mesh",
        title="Validate a model by its truth",
        help="Reports accuracy, completeness and F-score of a mesh or cloud against the true one.",
        command=("validate", "mesh"),
        fields=(
            Entry(name="mesh", label="Model", help="PLY, mm", shelves=("clouds",), takes="file", is_required=True),
            Entry(
                name="truth",
                label="Truth",
                help="PLY in the same coordinates",
                option="--truth",
                shelves=("clouds",),
                takes="file",
                is_required=True,
            ),
            report_name("{mesh}-mesh"),
            DATASET,
            APPROACH,
        ),
        output=named("runs"),
    ),
)
