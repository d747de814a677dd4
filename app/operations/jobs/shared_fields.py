"""Fields that several kinds of jobs share."""

from __future__ import annotations

from app.intake.captures import CAPTURE_FILE
from app.operations.jobs.fields import Choice, Entry, Field, NewName, Text
from app.study.kinds import PRESETS, QUICK
from app.study.options.presets import read_preset

CAPTURE = Entry(
    name="capture",
    label="Capture",
    help="recording in the capture format",
    shelves=("captures",),
    holds=CAPTURE_FILE,
)


def report_name(pattern: str) -> NewName:
    """Return the field of a report's name."""
    return NewName(name="name", label="Name", help="of the report's folder", shelf="runs", pattern=pattern)


NOTHING, STUDY = "nothing", "study"
GOALS = {"reconstruct": "models", "render": "films"}  # what a chain of jobs has come to after a kind
STEPS = {"models": "reconstruct it", "films": "film it", STUDY: "make a study of the films"}


def chain_fields(after: tuple[str, ...]) -> tuple[Field, ...]:
    """Return the fields that say how a job goes on by itself.

    Parameters
    ----------
    after : kinds of the jobs that can follow, in order; a study can be made at the end
    """
    steps = [*(GOALS[kind] for kind in after), STUDY]
    goals = {goal: ", then ".join(STEPS[step] for step in steps[: number + 1]) for number, goal in enumerate(steps)}
    names: dict[str, str] = {name: read_preset(name).summary for name in PRESETS}
    return (
        Choice(
            name="then",
            label="When it is done",
            help="each with its usual settings",
            option=None,
            default=NOTHING,
            choices={NOTHING: NOTHING, **goals},
        ),
        Text(
            name="study_name",
            label="Name of the study",
            help="empty: that of the films",
            option=None,
            form=r"[^\x00-\x1f]{1,200}",
            example="Temple",
        ),
        Choice(name="study_preset", label="Kind of study", option=None, default=QUICK, choices=names),
    )
