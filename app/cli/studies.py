"""The commands on studies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import typer

from app.cli.shared import LINKS, by_step, once_served, server_settings
from app.cli.study_flags import GIVEN, CommandWithOptionFlags
from app.operations.commands.studies import (
    StudyArchive,
    StudyAttach,
    StudyBalance,
    StudyCheck,
    StudyClose,
    StudyCreate,
    StudyDelete,
    StudyDuplicate,
    StudyExport,
    StudyImport,
    StudyInvite,
    StudyOpen,
    StudyPause,
)
from recon.cli.console import JsonOption, ProgressLine, counted, print_result
from recon.cli.flags import with_settings

if TYPE_CHECKING:
    from app.settings import Settings
    from app.store.studies.studies import Standing


app = typer.Typer()
study_app = typer.Typer(
    no_args_is_help=True,
    help="Create, import, export, list, open, close, copy and delete studies; invite; attach measures.",
)
app.add_typer(study_app, name="study")


@study_app.command("create", cls=CommandWithOptionFlags)
@with_settings(StudyCreate, **LINKS)
def study_create(asked: StudyCreate, *, context: typer.Context, as_json: bool) -> None:
    """Create a study from a stimulus set, with an open invitation. Flags override the file, and it the preset."""
    with ProgressLine():  # what is loaded takes seconds
        from app.operations.studies.create import create_study, read_options
        from app.study.protocols import typed_scale
        from app.study.stages import PRACTICE

    given = context.meta[GIVEN]
    if "scale" in given:
        given["scale"] = typed_scale(given["scale"])
    options = read_options(asked.options, given, asked.preset)
    if "practice_dataset" in given:
        options = options.with_stage(PRACTICE)
    with ProgressLine() as progress:
        settings = server_settings()
        study = create_study(
            settings,
            asked.stimulus_set,
            asked.name,
            exposure_s=asked.exposure,
            seed=asked.seed,
            options=options,
            progress=by_step(progress),
        )
    _tell_of_study(study, settings, asked.url, as_json=as_json)


@study_app.command("import")
@with_settings(StudyImport, **LINKS)
def study_import(asked: StudyImport, *, as_json: bool) -> None:
    """Create a study from a study file, or bring in a whole one with films, texts, votes and measures."""
    from app.intake.zips import is_zip
    from app.operations.studies.create import import_study
    from app.operations.upkeep.travel import import_file

    settings = server_settings()
    if asked.file.is_file() and is_zip(asked.file):
        with ProgressLine() as progress:
            made = import_file(settings, asked.file, name=asked.name, progress=by_step(progress))
        whole = f"{counted(made['n_started'], 'participant')} and {counted(made['n_votes'], 'vote')}"
        notes = [f"{note[0].upper()}{note[1:]}." for note in made["notes"]]
        invite = f"It is {made['state']}, and nobody's code came with it: `reconstudy study invite {made['slug']}`."
        print_result(made, "\n".join([f"{made['slug']} is here with {whole}.", invite, *notes]), as_json=as_json)
        return
    with ProgressLine() as progress:
        study = import_study(settings, asked.file, stimuli=asked.stimuli, progress=by_step(progress))
    _tell_of_study(study, settings, asked.url, as_json=as_json)


@study_app.command("export")
@with_settings(StudyExport)
def study_export(asked: StudyExport, *, as_json: bool) -> None:
    """Write a study file, or a whole study with films, texts, votes and measures; `study import` takes both."""
    from app.files import write_text
    from app.operations.studies.manage import export_study
    from app.operations.upkeep.travel import export_to_file

    study, package, out = asked.study, asked.package, asked.out
    if package is not None:
        if package.suffix.lower() != ".zip" or out is not None:
            raise typer.BadParameter(f"{package}: expected a name that ends in .zip, and no --out beside it")
        with ProgressLine():
            made = export_to_file(server_settings(), study, package, has_outside=asked.outside_ids)
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
@with_settings(StudyInvite, **LINKS)
def study_invite(asked: StudyInvite, *, as_json: bool) -> None:
    """Add an invitation to a study."""
    from app.operations.running import url_for_links
    from app.operations.studies.manage import add_invitation

    settings = server_settings()
    made = add_invitation(settings, asked.study, places=asked.places)
    made["link"] = (asked.url or url_for_links(settings)) + made["link"]
    people = "as many participants as come" if asked.places is None else f"{counted(asked.places, 'participant')}"
    print_result(made, f"For {people}: {made['link']}{once_served(settings)}", as_json=as_json)


@study_app.command("check")
@with_settings(StudyCheck)
def study_check(asked: StudyCheck, *, as_json: bool) -> None:
    """Check a study's films: decode each to its end, and play it in a headless browser where one is installed."""
    from app.operations.studies.check_films import FilmCheck, check_study, in_words

    with ProgressLine() as progress:
        checked = check_study(server_settings(), asked.study, progress=by_step(progress))
    faults = [f"{media}: {fault}" for media, fault in checked["faults"].items()]
    print_result(checked, "\n".join([in_words(FilmCheck(**checked)), *faults]), as_json=as_json)
    if faults:
        raise typer.Exit(1)


@study_app.command("balance")
@with_settings(StudyBalance)
def study_balance(asked: StudyBalance, *, as_json: bool) -> None:
    """Check that orders follow from the seed and are balanced: labels, first looks, datasets; exit with 1 if not."""
    from app.operations.studies.manage import study_balance as balance_of

    report = balance_of(server_settings(), asked.study)
    print_result(report, "\n".join(_balance_lines(report)), as_json=as_json)
    if not report["ok"]:
        raise typer.Exit(1)


@study_app.command("attach")
@with_settings(StudyAttach)
def study_attach(asked: StudyAttach, *, as_json: bool) -> None:
    """Attach objective measures, reports and models to a study, in place of those attached before."""
    with ProgressLine():
        from app.operations.studies.attach import listed
        from app.operations.studies.manage import attach_results

        attached = attach_results(server_settings(), asked.results, asked.study, only=asked.only or ())
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
@with_settings(StudyOpen)
def study_open(asked: StudyOpen, *, as_json: bool) -> None:
    """Open a study, or open it again: people may begin."""
    _change_standing(asked.study, "open", as_json=as_json)


@study_app.command("pause")
@with_settings(StudyPause)
def study_pause(asked: StudyPause, *, as_json: bool) -> None:
    """Pause a study: nobody begins for now; who has begun goes on."""
    _change_standing(asked.study, "paused", as_json=as_json)


@study_app.command("close")
@with_settings(StudyClose)
def study_close(asked: StudyClose, *, as_json: bool) -> None:
    """Close a study: nobody new begins; who has begun goes on."""
    _change_standing(asked.study, "closed", as_json=as_json)


@study_app.command("archive")
@with_settings(StudyArchive)
def study_archive(asked: StudyArchive, *, as_json: bool) -> None:
    """Archive a study: it is closed and out of the way, and may be deleted."""
    _change_standing(asked.study, "archived", as_json=as_json)


def _change_standing(study: str, standing: Standing, *, as_json: bool) -> None:
    from app.operations.studies.manage import change_study_standing

    changed = change_study_standing(server_settings(), study, standing)
    print_result(changed, f"{study} is {standing}; it was {changed['before']}.", as_json=as_json)


@study_app.command("duplicate")
@with_settings(StudyDuplicate)
def study_duplicate(asked: StudyDuplicate, *, as_json: bool) -> None:
    """Create a study of the same stimuli and options, without participants; it stays paused until opened."""
    from app.operations.studies.manage import copy_study

    made = copy_study(server_settings(), asked.study, asked.name)
    sentence = (
        f"{made['study']} is a copy of {asked.study}. It is paused; `reconstudy study open {made['study']}` opens it."
    )
    print_result(made, sentence, as_json=as_json)


@study_app.command("delete")
@with_settings(StudyDelete)
def study_delete(asked: StudyDelete, *, as_json: bool) -> None:
    """Delete a study with all its votes for good; once somebody has begun, archive it first."""
    from app.operations.studies.manage import remove_study

    study = asked.study
    if (
        not asked.yes
        and typer.prompt(f"All votes of {study} will be gone. Type {study} to delete it", err=True) != study
    ):
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
