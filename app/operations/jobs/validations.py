"""Jobs that measure runs, films and clouds."""

from __future__ import annotations

import os.path
from dataclasses import replace

from app.errors import InvalidError
from app.files import read_json
from app.intake.stimuli import MANIFEST
from app.intake.summaries import RUN_FILE
from app.operations.jobs.fields import SETS, Entries, Entry, Values, place
from app.operations.jobs.kind import JobKind
from app.operations.jobs.shared_fields import CAPTURE, report_name
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


CLOUD = Entry(name="cloud", label="Cloud", shelves=("clouds",), takes="file")
CLOUDS = Entries(
    name="clouds",
    label="Clouds",
    help="files, or folders of them: one for each sensor and place",
    shelves=("clouds",),
    takes="files",
)

VALIDATIONS = (
    JobKind(
        name="validate-views",
        title="Validate a run by photographs",
        help="Compares the sensors with each other, and the models with photographs.",
        command="validate views",
        places={
            "run": Entry(name="run", label="Run", shelves=("runs",), holds=RUN_FILE),
            "out": report_name("{run}-views"),
            "capture": replace(CAPTURE, help="none: where the run says that it was", otherwise=recording_of),
        },
    ),
    JobKind(
        name="validate-films",
        title="Validate films",
        help="Compares the films of a stimulus set with those of a reference: PSNR, SSIM, MS-SSIM, VMAF and flicker.",
        command="validate films",
        places={
            "stimulus_set": Entry(name="set", label="Stimulus set", shelves=(SETS,), holds=MANIFEST),
            "out": report_name("{set}-films"),
        },
    ),
    JobKind(
        name="validate-clouds",
        title="Validate clouds or models",
        help="Compares clouds, or the models of a run, with a reference: D1, D2, Chamfer, F-score, colours, PointSSIM.",
        command="validate cloud",
        places={
            "clouds": Entries(
                name="clouds",
                label="Clouds",
                help="runs; or files, or folders with one for each frame",
                shelves=("runs", "clouds"),
                takes="either",
            ),
            "reference": Entry(
                name="reference",
                label="Reference",
                help="a file, a folder with one for each frame, or a synthetic capture, which has the truth",
                shelves=("clouds", "captures"),
                takes="either",
            ),
            "out": report_name("{clouds}-clouds"),
        },
    ),
    JobKind(
        name="validate-sphere",
        title="Validate a sphere",
        help="Fits spheres of known radius to clouds, and reports signed errors and inliers.",
        command="validate sphere",
        places={"clouds": CLOUDS, "out": report_name("{clouds}-sphere")},
    ),
    JobKind(
        name="validate-cuboid",
        title="Validate a cuboid",
        help="Fits cuboids of known size to clouds, and reports planes, angles and edges.",
        command="validate cuboid",
        places={"clouds": CLOUDS, "out": report_name("{clouds}-cuboid")},
    ),
    JobKind(
        name="validate-object",
        title="Validate a known object",
        help="Finds a known mesh in a cloud, and reports signed distances and inliers.",
        command="validate object",
        places={
            "model": replace(CLOUD, name="model", label="Known object", help="its mesh"),
            "cloud": CLOUD,
            "out": report_name("{cloud}-object"),
        },
    ),
    JobKind(
        name="validate-mesh",
        title="Validate a model by its truth",
        help="Reports accuracy, completeness and F-score of a mesh or cloud against the true one.",
        command="validate mesh",
        places={
            "mesh": replace(CLOUD, name="mesh", label="Model", help="in mm"),
            "truth": replace(CLOUD, name="truth", label="Truth", help="in the same coordinates"),
            "out": report_name("{mesh}-mesh"),
        },
    ),
)
