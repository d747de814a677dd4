"""Jobs that make models of captures, and stimulus sets of models or films."""

from __future__ import annotations

from app.operations.jobs.fields import SETS, Entries, Entry, NewName
from app.operations.jobs.kind import JobKind
from app.operations.jobs.shared_fields import CAPTURE

FILMS = (
    JobKind(
        name="reconstruct",
        then=("render",),
        command="reconstruct",
        title="Reconstruct",
        help="Makes depth maps, clouds and models of a capture by every approach, a depth method with a fusion.",
        places={
            "capture": CAPTURE,
            "out": NewName(name="name", label="Name", help="of the run", shelf="runs", pattern="{capture}"),
        },
        more=lambda _, settings: [
            *(["--device=gpu"] if settings.jobs_device == "gpu" else []),
            *([f"--cluster={settings.jobs_cluster}"] if settings.jobs_cluster else []),
        ],
    ),
    JobKind(
        name="render",
        then=(),
        command="render",
        title="Render films",
        help="Films every approach of runs and models by the same camera and light: a stimulus set for studies.",
        places={
            "folders": Entries(
                name="sources",
                label="Runs and models",
                help="all of one scene are filmed alike",
                shelves=("runs", "models"),
            ),
            "out": NewName(name="name", label="Name", help="of the stimulus set", shelf=SETS, pattern="{sources}"),
        },
    ),
    JobKind(
        name="import-films",
        then=(),
        title="Import films",
        help="Makes a stimulus set of films that were made elsewhere, DATASET/CONDITION.mp4.",
        command="stimuli import",
        places={
            "folder": Entry(name="films", label="Films", help="a folder of films", shelves=("films",)),
            "out": NewName(name="name", label="Name", help="of the stimulus set", shelf=SETS, pattern="{films}"),
        },
        needs_recon=False,
    ),
)
