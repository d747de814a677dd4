"""The commands on stimulus sets and studies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.shared import DEFAULT_URL, UrlOption, by_step
from recon.cli.console import JsonOption, ProgressLine, print_result

if TYPE_CHECKING:
    from app.intake.merge import NewSet

StudyArgument = Annotated[str, typer.Argument(help="The study's short name, as `study list` shows it.")]

app = typer.Typer()
stimuli_app = typer.Typer(no_args_is_help=True, help="Check, import and merge stimulus sets.")
study_app = typer.Typer(
    no_args_is_help=True, help="Create, import, export, list and check studies; invite; attach measures."
)
app.add_typer(stimuli_app, name="stimuli")
app.add_typer(study_app, name="study")


@stimuli_app.command("check")
def stimuli_check(
    stimulus_set: Annotated[Path, typer.Argument(help="Folder of the stimulus set, or its manifest.json.")],
    as_json: JsonOption = False,
) -> None:
    """Check a stimulus set: its files, their digests, and that every video can be decoded."""
    from app.intake.stimuli import read_stimulus_set

    progress = ProgressLine()
    checked = read_stimulus_set(stimulus_set, by_step(progress))
    progress.close()
    result = {"name": checked.name, "datasets": list(checked.datasets), "conditions": list(checked.conditions)}
    sentence = f"{len(checked.stimuli)} videos of {len(checked.datasets)} datasets are whole: {stimulus_set}"
    print_result(result, sentence, as_json=as_json)


@stimuli_app.command("import")
def stimuli_import(
    folder: Annotated[
        Path,
        typer.Argument(help="Folder with DATASET/CONDITION.mp4; conditions.csv in it gives factors; masters are kept."),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="New folder for the stimulus set.")],
    practice: Annotated[
        str | None, typer.Option(help="Dataset of two videos for practice; it is not compared.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make a stimulus set from videos that were not made by reconstudy."""
    from app.intake.import_videos import import_stimuli

    progress = ProgressLine()
    made = import_stimuli(folder, out, practice=practice, progress=by_step(progress))
    progress.close()
    _tell_of_set(made, out, as_json=as_json)


@stimuli_app.command("merge")
def stimuli_merge(
    sets: Annotated[list[Path], typer.Argument(help="Two or more stimulus sets: from render, import or merge.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="New folder for the stimulus set of all of them.")],
    as_json: JsonOption = False,
) -> None:
    """Join stimulus sets: the films of a dataset must have the same size, frame rate, length and camera path."""
    from app.intake.merge import merge_sets

    if len(sets) < 2:
        raise typer.BadParameter(f"{sets[0]} alone has nothing to be merged with; name two sets or more")
    progress = ProgressLine()
    made = merge_sets(sets, out, progress=by_step(progress))
    progress.close()
    _tell_of_set(made, out, as_json=as_json)


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
    films = f"{len(made.stimuli)} videos: {len(made.conditions)} conditions of {len(made.datasets)} datasets: {out}"
    is_comparable = all(len(made.of_dataset(dataset)) > 1 for dataset in made.datasets)
    follows = (
        f"A study of it: reconstudy study create {out} --name NAME"
        if is_comparable
        else f"To be compared with others: reconstudy stimuli merge OTHER_SET {out} -o SET"
    )
    print_result(result, "\n".join([films, *new.notes, follows]), as_json=as_json)


@study_app.command("create")
def study_create(
    stimulus_set: Annotated[Path, typer.Argument(help="Folder of the stimulus set, or its manifest.json.")],
    study_name: Annotated[
        str, typer.Option("--name", help="The study's name, as participants and experimenters read it.")
    ],
    exposure: Annotated[
        float | None, typer.Option(help="Seconds that a pair is shown; default: length of the shortest video.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of all participants' orders; default: random.")] = None,
    protocol: Annotated[
        str | None,
        typer.Option(
            help="How to judge: PC (which of two is better, default), CCR (how much better), ACR (films one by one), "
            "ACR-HR (the reference hidden among them) or DCR (against the reference)."
        ),
    ] = None,
    scale: Annotated[
        str | None, typer.Option(help="Of ACR, ACR-HR and DCR: 5 (default), 9 or 11 grades, or slider (0 to 100).")
    ] = None,
    preset: Annotated[
        str, typer.Option(help="Options to start from: paper (a laboratory), quick (pairs only) or online (at home).")
    ] = "quick",
    options_file: Annotated[
        Path | None,
        typer.Option("--options", help="TOML file: optional_stages, consent, questions, …; it overrides the preset."),
    ] = None,
    both_orders: Annotated[
        bool, typer.Option("--both-orders", help="Show every pair twice, the second time with A and B exchanged.")
    ] = False,
    repeated_pairs: Annotated[
        int | None, typer.Option(min=0, help="How many pairs of each dataset to repeat, to see whether choices agree.")
    ] = None,
    identical_pairs: Annotated[
        int | None,
        typer.Option(min=0, help="How many pairs of each dataset to make of one stimulus twice, to check attention."),
    ] = None,
    free_exposure: Annotated[
        bool,
        typer.Option("--free-exposure", help="Let participants end the exposure; videos repeat until then."),
    ] = False,
    practice: Annotated[
        str | None,
        typer.Option(
            metavar="DATASET",
            help="Dataset to practise with, which no trial shows; default: the set's own, or two films.",
        ),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            help="Condition to show as reference: beside every pair, in ACR-HR hidden, in DCR before each film."
        ),
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(help="Condition of the set to leave out, such as truth, which measures alone need; repeatable."),
    ] = None,
    second_codec: Annotated[
        str | None, typer.Option(help="vp9 or av1: also make every film in this codec, for browsers without H.264.")
    ] = None,
    fallback: Annotated[
        str | None,
        typer.Option(
            help="Where a pair's film does not play: webcodecs (default), 'two videos' (flags votes), or '' for none."
        ),
    ] = None,
    break_every: Annotated[
        int | None, typer.Option(min=0, help="Offer a break after so many trials; 0: never; default: 25.")
    ] = None,
    url: UrlOption = DEFAULT_URL,
    as_json: JsonOption = False,
) -> None:
    """Create a study from a stimulus set, with an open invitation."""
    from app.operations.create import create_study, read_options
    from app.settings import Settings
    from app.study.protocols import typed_scale
    from app.study.stages import PRACTICE

    given = {
        "protocol": protocol,
        "scale": typed_scale(scale) if scale else None,
        "both_orders": both_orders or None,
        "repeated_pairs": repeated_pairs,
        "identical_pairs": identical_pairs,
        "free_exposure": free_exposure or None,
        "practice_dataset": practice,
        "reference": reference,
        "without": without or None,
        "second_codec": second_codec,
        "fallback": fallback,
        "break_every": break_every,
    }
    options = read_options(options_file, {name: value for name, value in given.items() if value is not None}, preset)
    if practice is not None:
        options = options.with_stage(PRACTICE)
    progress = ProgressLine()
    study = create_study(
        Settings(),
        stimulus_set,
        study_name,
        exposure_s=exposure,
        seed=seed,
        options=options,
        progress=by_step(progress),
    )
    progress.close()
    _tell_of_study(study, url, as_json=as_json)


@study_app.command("import")
def study_import(
    file: Annotated[
        Path, typer.Argument(help="TOML file: name, stimuli, exposure_s, seed, [options]; `study export` writes one.")
    ],
    stimuli: Annotated[Path | None, typer.Option(help="Folder of the stimulus set; default: the file's.")] = None,
    url: UrlOption = DEFAULT_URL,
    as_json: JsonOption = False,
) -> None:
    """Create a study from a study file, with an open invitation."""
    from app.operations.create import import_study
    from app.settings import Settings

    progress = ProgressLine()
    study = import_study(Settings(), file, stimuli=stimuli, progress=by_step(progress))
    progress.close()
    _tell_of_study(study, url, as_json=as_json)


@study_app.command("export")
def study_export(
    study: StudyArgument,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write; default: standard output.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a study file, from which `study import` makes the study again."""
    from app.operations.manage import export_study
    from app.settings import Settings

    text = export_study(Settings(), study)
    if out is not None:
        out.write_text(text, encoding="utf-8")
    result = {"study": study, "toml": text, "file": str(out) if out else None}
    print_result(result, f"Wrote {out}." if out else text.rstrip(), as_json=as_json)


@study_app.command("invite")
def study_invite(
    study: StudyArgument,
    places: Annotated[
        int | None, typer.Option(min=1, help="How many participants may use it; default: any number.")
    ] = None,
    url: UrlOption = DEFAULT_URL,
    as_json: JsonOption = False,
) -> None:
    """Add an invitation to a study."""
    from app.operations.manage import add_invitation
    from app.settings import Settings

    made = add_invitation(Settings(), study, places=places)
    made["link"] = url + made["path"]
    people = "as many participants as come" if places is None else f"{places} participant{'s' * (places > 1)}"
    print_result(made, f"For {people}: {made['link']}", as_json=as_json)


@study_app.command("balance")
def study_balance(
    study: StudyArgument,
    as_json: JsonOption = False,
) -> None:
    """Check that all orders follow from the seed, and that labels, first looks and datasets are balanced."""
    from app.operations.manage import study_balance as balance_of
    from app.settings import Settings

    report = balance_of(Settings(), study)
    print_result(report, "\n".join(_balance_lines(report)), as_json=as_json)


@study_app.command("attach")
def study_attach(
    results: Annotated[
        list[Path],
        typer.Argument(
            help="Folders that `reconstudy validate` and `reconstudy models` wrote, or CSV tables of measures."
        ),
    ],
    study: Annotated[str | None, typer.Option(help="The study's short name; default: the only study.")] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(help="Measure to compare with the scores, once for each; default: all of them."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Attach objective measures, reports and models to a study, in place of those attached before."""
    from app.operations.attach import listed
    from app.operations.manage import attach_results
    from app.settings import Settings

    attached = attach_results(Settings(), results, study, only=only or ())
    sentences = []
    if attached["measures"]:
        sentences.append(
            f"Attached {attached['n_values']} values to {attached['study']}: {', '.join(attached['measures'])}"
        )
    elif attached["reports"]:
        sentences.append(
            f"Attached {attached['reports']} reports to {attached['study']}; they name no approach to compare"
        )
    if attached["models"]:
        sentences.append(f"Attached {attached['models']} models to {attached['study']}")
    if attached["ignored"]:
        sentences.append(f"The study does not compare {listed(attached['ignored'])}: left out.")
    sentences += [f"{note}." for note in attached["notes"]]
    print_result(attached, "\n".join(sentences), as_json=as_json)


@study_app.command("list")
def study_list(as_json: JsonOption = False) -> None:
    """List all studies with their progress, newest first."""
    from app.operations.manage import list_studies
    from app.settings import Settings

    studies = list_studies(Settings())
    lines = [_study_sentence(study) for study in studies] or [
        "There is no study yet; `reconstudy study create` makes one."
    ]
    print_result({"studies": studies}, "\n".join(lines), as_json=as_json)


def _study_sentence(study: Mapping[str, Any]) -> str:
    return (
        f"{study['slug']} ({study['state']}): {study['n_finished']} of {study['n_started']} participants finished, "
        f"{study['n_votes']} votes; invitations {', '.join(study['invitations'])}"
    )


def _tell_of_study(study: dict[str, Any], url: str, *, as_json: bool) -> None:
    study["link"] = url + study["path"]
    left_out = f" Left out: {', '.join(study['without'])}." if study["without"] else ""
    shown = "pairs" if study["n_pairs"] else "trials"
    n_shown = study["n_pairs"] or study["n_trials"]
    sentences = [
        f"Created the study {study['slug']}: {n_shown} {shown} of {study['n_conditions']} conditions, "
        f"{study['exposure_s']:g} s each.{left_out}",
        _languages_sentence(study["languages"]),
        *(f"{note}." for note in study.get("notes", ())),
        f"Invite participants with {study['link']} once `reconstudy serve` runs.",
    ]
    print_result(study, "\n".join(sentences), as_json=as_json)


def _languages_sentence(languages: Mapping[str, str]) -> str:
    offered = [tag for tag, state in languages.items() if state == "offered"]
    refusals = [state for state in languages.values() if state != "offered"]
    return f"Participants read it in {', '.join(offered)}." + "".join(f" Not offered: {state}." for state in refusals)


def _balance_lines(report: Mapping[str, Any]) -> Iterator[str]:
    yield f"Orders from the seed {report['seed']}: {'balanced' if report['ok'] else 'NOT BALANCED'}"
    yield "Participants: " + ", ".join(f"{n} {state}" for state, n in report["participants"].items())
    for rule in report["rules"]:
        verdict = "ok" if rule["ok"] else "NO"
        yield f"  {verdict} {rule['worst']:>4} (at most {rule['allowed']})  {rule['of']}: {rule['rule']}"
