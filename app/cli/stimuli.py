"""The commands on stimulus sets."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from app.cli.shared import by_step
from app.operations.commands.studies import StimuliCheck, StimuliImport, StimuliMerge
from recon.cli.console import ProgressLine, counted, print_result
from recon.cli.flags import with_settings

if TYPE_CHECKING:
    from app.intake.merge import NewSet

FEWEST_CONDITIONS = 2  # of a dataset that a study compares

app = typer.Typer()
stimuli_app = typer.Typer(no_args_is_help=True, help="Check, import and merge stimulus sets.")
app.add_typer(stimuli_app, name="stimuli")


@stimuli_app.command("check")
@with_settings(StimuliCheck)
def stimuli_check(asked: StimuliCheck, *, as_json: bool) -> None:
    """Check a stimulus set: its files, their digests, and that every video can be decoded."""
    from app.intake.stimuli import read_stimulus_set

    with ProgressLine() as progress:
        checked = read_stimulus_set(asked.stimulus_set, by_step(progress))
    result = {"name": checked.name, "datasets": list(checked.datasets), "conditions": list(checked.conditions)}
    whole = f"{counted(len(checked.stimuli), 'video')} of {counted(len(checked.datasets), 'dataset')}"
    sentence = f"{whole} {'is' if len(checked.stimuli) == 1 else 'are'} whole: {asked.stimulus_set}"
    print_result(result, sentence, as_json=as_json)


@stimuli_app.command("import")
@with_settings(StimuliImport)
def stimuli_import(asked: StimuliImport, *, as_json: bool) -> None:
    """Make a stimulus set from videos that were not made by reconstudy."""
    from app.intake.import_videos import import_stimuli

    with ProgressLine() as progress:
        made = import_stimuli(
            asked.folder,
            asked.out,
            practice=asked.practice,
            is_conformed=asked.conform,
            untagged_range=asked.untagged_range,
            progress=by_step(progress),
        )
    _tell_of_set(made, asked.out, as_json=as_json)


@stimuli_app.command("merge")
@with_settings(StimuliMerge)
def stimuli_merge(asked: StimuliMerge, *, as_json: bool) -> None:
    """Join stimulus sets: the films of a dataset must have the same size, frame rate, length and camera path."""
    from app.intake.merge import merge_sets

    if len(asked.sets) < 2:
        raise typer.BadParameter(f"{asked.sets[0]} alone has nothing to be merged with; name two sets or more")
    with ProgressLine() as progress:
        made = merge_sets(asked.sets, asked.out, progress=by_step(progress))
    _tell_of_set(made, asked.out, as_json=as_json)


def _tell_of_set(new: NewSet, out: Path, *, as_json: bool) -> None:
    made = new.stimulus_set
    result = {
        "name": made.name,
        "path": str(out),
        "datasets": list(made.datasets),
        "conditions": list(made.conditions),
        "factors": made.factors,
        "videos": len(made.stimuli),
        "notes": list(new.notes),
    }
    conditions, datasets = counted(len(made.conditions), "condition"), counted(len(made.datasets), "dataset")
    films = f"{counted(len(made.stimuli), 'video')}: {conditions} of {datasets}: {out}"
    folder = shlex.quote(str(out))
    alone = [dataset for dataset in made.datasets if len(made.of_dataset(dataset)) < FEWEST_CONDITIONS]
    follows = (
        f"A study compares two or more conditions of each dataset, and {', '.join(alone)} has one. Import the films of "
        f"another condition, too, or join this set with another: reconstudy stimuli merge OTHER_SET {folder} -o SET"
        if alone
        else f"A study of it: reconstudy study create {folder} --name NAME"
    )
    print_result(result, "\n".join([films, *new.notes, follows]), as_json=as_json)
