"""The commands on studies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.shared import UrlOption, by_step, once_served, server_settings
from app.cli.study_flags import GIVEN, CommandWithOptionFlags
from recon.cli.console import JsonOption, ProgressLine, counted, print_result

if TYPE_CHECKING:
    from app.settings import Settings
    from app.store.studies.studies import Standing


StudyArgument = Annotated[
    str, typer.Argument(metavar="STUDY", help="The study's short name, as `study list` shows it.")
]

app = typer.Typer()
study_app = typer.Typer(
    no_args_is_help=True,
    help="Create, import, export, list, open, close, copy and delete studies; invite; attach measures.",
)
app.add_typer(study_app, name="study")


@study_app.command("create", cls=CommandWithOptionFlags)
def study_create(
    context: typer.Context,
    stimulus_set: Annotated[
        Path, typer.Argument(help="Folder of the stimulus set, or its manifest.json.", metavar="SET")
    ],
    study_name: Annotated[
        str, typer.Option("--name", help="The study's name, as participants and experimenters read it.")
    ],
    exposure: Annotated[
        float | None, typer.Option(help="Seconds that a pair is shown; default: length of the shortest video.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all participants' orders; default: random.")] = None,
    preset: Annotated[
        str, typer.Option(help="Options to start from: paper (a laboratory), quick (pairs only) or online (at home).")
    ] = "quick",
    options_file: Annotated[
        Path | None,
        typer.Option("--options", help="TOML file: optional_stages, consent, questions, …; it overrides the preset."),
    ] = None,
    url: UrlOption = None,
    as_json: JsonOption = False,
) -> None:
    """Create a study from a stimulus set, with an open invitation. Flags override the file, and it the preset."""
    with ProgressLine():  # what is loaded takes seconds
        from app.operations.studies.create import create_study, read_options
        from app.study.protocols import typed_scale
        from app.study.stages import PRACTICE

    given = context.meta[GIVEN]
    if "scale" in given:
        given["scale"] = typed_scale(given["scale"])
    options = read_options(options_file, given, preset)
    if "practice_dataset" in given:
        options = options.with_stage(PRACTICE)
    with ProgressLine() as progress:
        settings = server_settings()
        study = create_study(
            settings,
            stimulus_set,
            study_name,
            exposure_s=exposure,
            seed=seed,
            options=options,
            progress=by_step(progress),
        )
    _tell_of_study(study, settings, url, as_json=as_json)


@study_app.command("import")
def study_import(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="TOML file: name, stimuli, exposure_s, seed and options; or the zip file of a whole study. "
            "`study export` writes both.",
        ),
    ],
    stimuli: Annotated[
        Path | None, typer.Option(help="Folder of the stimulus set of a TOML file; default: the file's.")
    ] = None,
    study_name: Annotated[
        str, typer.Option("--name", help="Name of a study from a zip file; default: the one it had.")
    ] = "",
    url: UrlOption = None,
    as_json: JsonOption = False,
) -> None:
    """Create a study from a study file, or bring in a whole one with films, texts, votes and measures."""
    from app.intake.zips import is_zip
    from app.operations.studies.create import import_study
    from app.operations.upkeep.travel import import_file

    settings = server_settings()
    if file.is_file() and is_zip(file):
        with ProgressLine() as progress:
            made = import_file(settings, file, name=study_name, progress=by_step(progress))
        whole = f"{counted(made['n_started'], 'participant')} and {counted(made['n_votes'], 'vote')}"
        notes = [f"{note[0].upper()}{note[1:]}." for note in made["notes"]]
        invite = f"It is {made['state']}, and nobody's code came with it: `reconstudy study invite {made['slug']}`."
        print_result(made, "\n".join([f"{made['slug']} is here with {whole}.", invite, *notes]), as_json=as_json)
        return
    with ProgressLine() as progress:
        study = import_study(settings, file, stimuli=stimuli, progress=by_step(progress))
    _tell_of_study(study, settings, url, as_json=as_json)


@study_app.command("export")
def study_export(
    study: StudyArgument,
    package: Annotated[
        Path | None,
        typer.Argument(metavar="FILE.zip", help="Zip file of the whole study; default: its study file alone."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Study file to write; default: standard output.")
    ] = None,
    outside_ids: Annotated[
        bool,
        typer.Option(
            "--outside-ids",
            help="Zip file with outside ids, completion codes, addresses that lead back and names on invitations.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write a study file, or a whole study with films, texts, votes and measures; `study import` takes both."""
    from app.files import write_text
    from app.operations.studies.manage import export_study
    from app.operations.upkeep.travel import export_to_file

    if package is not None:
        if package.suffix.lower() != ".zip" or out is not None:
            raise typer.BadParameter(f"{package}: expected a name that ends in .zip, and no --out beside it")
        with ProgressLine():
            made = export_to_file(server_settings(), study, package, has_outside=outside_ids)
        whole = f"{counted(made['participants'], 'participant')} and {counted(made['votes'], 'vote')}"
        notes = [f"{note[0].upper()}{note[1:]}." for note in made["notes"]]
        print_result(made, "\n".join([f"Wrote {package}: {study} with {whole}.", *notes]), as_json=as_json)
        return
    text = export_study(server_settings(), study)
    if out is not None:
        write_text(out, text)
    result = {"study": study, "toml": text, "file": str(out) if out else None}
    print_result(result, f"Wrote {out}." if out else text.rstrip(), as_json=as_json)


@study_app.command("invite")
def study_invite(
    study: StudyArgument,
    places: Annotated[
        int | None, typer.Option(min=1, help="How many participants may use it; default: any number.")
    ] = None,
    url: UrlOption = None,
    as_json: JsonOption = False,
) -> None:
    """Add an invitation to a study."""
    from app.operations.running import url_for_links
    from app.operations.studies.manage import add_invitation

    settings = server_settings()
    made = add_invitation(settings, study, places=places)
    made["link"] = (url or url_for_links(settings)) + made["link"]
    people = "as many participants as come" if places is None else f"{counted(places, 'participant')}"
    print_result(made, f"For {people}: {made['link']}{once_served(settings)}", as_json=as_json)


@study_app.command("check")
def study_check(study: StudyArgument, as_json: JsonOption = False) -> None:
    """Check a study's films: decode each to its end, and play it in a headless browser where one is installed."""
    from app.operations.studies.check_films import FilmCheck, check_study, in_words

    with ProgressLine() as progress:
        checked = check_study(server_settings(), study, progress=by_step(progress))
    faults = [f"{media}: {fault}" for media, fault in checked["faults"].items()]
    print_result(checked, "\n".join([in_words(FilmCheck(**checked)), *faults]), as_json=as_json)
    if faults:
        raise typer.Exit(1)


@study_app.command("balance")
def study_balance(
    study: StudyArgument,
    as_json: JsonOption = False,
) -> None:
    """Check that orders follow from the seed and are balanced: labels, first looks, datasets; exit with 1 if not."""
    from app.operations.studies.manage import study_balance as balance_of

    report = balance_of(server_settings(), study)
    print_result(report, "\n".join(_balance_lines(report)), as_json=as_json)
    if not report["ok"]:
        raise typer.Exit(1)


@study_app.command("attach")
def study_attach(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULTS",
            help="Folders that `reconstudy validate` and `reconstudy models` wrote, or CSV tables of measures.",
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
    with ProgressLine():
        from app.operations.studies.attach import listed
        from app.operations.studies.manage import attach_results

        attached = attach_results(server_settings(), results, study, only=only or ())
    sentences = []
    if attached["measures"]:
        values = counted(attached["n_values"], "value")
        sentences.append(f"Attached {values} to {attached['study']}: {listed(attached['measures'])}")
    elif attached["reports"]:
        reports = counted(attached["reports"], "report")
        sentences.append(f"Attached {reports} to {attached['study']}, without an approach to compare")
    if attached["models"]:
        sentences.append(f"Attached {counted(attached['models'], 'model')} to {attached['study']}")
    if attached["ignored"]:
        sentences.append(f"The study does not compare {listed(attached['ignored'])}: left out.")
    sentences += [f"{note}." for note in attached["notes"]]
    print_result(attached, "\n".join(sentences), as_json=as_json)


@study_app.command("open")
def study_open(study: StudyArgument, as_json: JsonOption = False) -> None:
    """Open a study, or open it again: people may begin."""
    _change_standing(study, "open", as_json=as_json)


@study_app.command("pause")
def study_pause(study: StudyArgument, as_json: JsonOption = False) -> None:
    """Pause a study: nobody begins for now; who has begun goes on."""
    _change_standing(study, "paused", as_json=as_json)


@study_app.command("close")
def study_close(study: StudyArgument, as_json: JsonOption = False) -> None:
    """Close a study: nobody new begins; who has begun goes on."""
    _change_standing(study, "closed", as_json=as_json)


@study_app.command("archive")
def study_archive(study: StudyArgument, as_json: JsonOption = False) -> None:
    """Archive a study: it is closed and out of the way, and may be deleted."""
    _change_standing(study, "archived", as_json=as_json)


def _change_standing(study: str, standing: Standing, *, as_json: bool) -> None:
    from app.operations.studies.manage import change_study_standing

    changed = change_study_standing(server_settings(), study, standing)
    print_result(changed, f"{study} is {standing}; it was {changed['before']}.", as_json=as_json)


@study_app.command("duplicate")
def study_duplicate(
    study: StudyArgument,
    new_name: Annotated[str, typer.Option("--name", help="Name of the new study.")],
    as_json: JsonOption = False,
) -> None:
    """Create a study of the same stimuli and options, without participants; it stays paused until opened."""
    from app.operations.studies.manage import copy_study

    made = copy_study(server_settings(), study, new_name)
    sentence = f"{made['study']} is a copy of {study}. It is paused; `reconstudy study open {made['study']}` opens it."
    print_result(made, sentence, as_json=as_json)


@study_app.command("delete")
def study_delete(
    study: StudyArgument,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask; there is no way back but a backup.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Delete a study with all its votes for good; once somebody has begun, archive it first."""
    from app.operations.studies.manage import remove_study

    if not yes and typer.prompt(f"All votes of {study} will be gone. Type {study} to delete it", err=True) != study:
        raise ValueError(f"{study} was not deleted: another name was typed")
    gone = remove_study(server_settings(), study)
    held = f"{counted(gone['votes'], 'vote')} of {counted(gone['participants'], 'participant')}"
    sentence = f"{study} is deleted, with {held}."
    print_result(gone, sentence, as_json=as_json)


@study_app.command("list")
def study_list(as_json: JsonOption = False) -> None:
    """List all studies with their progress, newest first."""
    from app.operations.studies.manage import list_studies

    settings = server_settings()
    studies = list_studies(settings)
    nothing = f"There is no study yet in {settings.data_dir.absolute()}; `reconstudy study create` makes one."
    lines = [_study_sentence(study) for study in studies] or [nothing]
    print_result({"studies": studies}, "\n".join(lines), as_json=as_json)


def _study_sentence(study: Mapping[str, Any]) -> str:
    begun, votes = counted(study["n_started"], "participant"), counted(study["n_votes"], "vote")
    came = f"{study['n_finished']} of {begun} finished, {votes}" if study["n_started"] else "nobody has begun"
    return f"{study['slug']} ({study['state']}): {came}; invitations {', '.join(study['invitations'])}"


def _tell_of_study(study: dict[str, Any], settings: Settings, url: str | None, *, as_json: bool) -> None:
    from app.operations.running import url_for_links

    study["link"] = (url or url_for_links(settings)) + study["link"]
    left_out = f" Left out: {', '.join(study['without'])}." if study["without"] else ""
    n_pairs = study["n_pairs"]
    shown = counted(n_pairs, "pair") if n_pairs else counted(study["n_trials"], "trial")
    sentences = [
        f"Created the study {study['slug']}: {shown} of {counted(study['n_conditions'], 'condition')}, "
        f"{study['exposure_s']:g} s each.{left_out}",
        _languages_sentence(settings, study["languages"]),
        *(f"{note}." for note in study.get("notes", ())),
        f"Invite participants with {study['link']}{once_served(settings)}.",
    ]
    print_result(study, "\n".join(sentences), as_json=as_json)


def _languages_sentence(settings: Settings, languages: Mapping[str, str]) -> str:
    from app.operations.studies.languages import find_language_packs

    names = {file.pack.tag: file.pack.name for file in find_language_packs(settings) if file.pack is not None}
    offered = [names.get(tag, tag) for tag, state in languages.items() if state == "offered"]
    refusals = [state for state in languages.values() if state != "offered"]
    return f"Participants read it in {', '.join(offered)}." + "".join(f" Not offered: {state}." for state in refusals)


def _balance_lines(report: Mapping[str, Any]) -> Iterator[str]:
    from app.study.design.balance import has_begun, holds

    standing = "balanced" if has_begun(report) else "nobody has begun"
    yield f"Orders from the seed {report['seed']}: {standing if report['ok'] else 'NOT BALANCED'}"
    yield "Participants: " + ", ".join(f"{n} {state}" for state, n in report["participants"].items())
    for rule in report["rules"]:
        verdict = {"yes": "ok", "no": "NO"}.get(holds(report, rule), "not yet")
        yield f"  {verdict:<7} {rule['worst']:>4} (at most {rule['allowed']})  {rule['of']}: {rule['rule']}"
