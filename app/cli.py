"""The one command of the product: studies and analysis here, the reconstruction backend's commands mounted.

What a command needs is imported when it runs, so that `--help` is quick and the server loads no backend.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.errors import UnavailableError
from recon.cli import app as recon_app
from recon.console import JsonOption, ProgressLine, print_result

if TYPE_CHECKING:
    from app.settings import Settings
    from app.timetable import Step

DEMO_SECONDS = 5.0
DEMO_FRAMES = 6
BACKEND_PACKAGES = ("cv2", "numba", "pyrender", "skimage", "trimesh")
DEFAULT_URL = "http://127.0.0.1:8000"

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Objective and subjective evaluation of multi-stereo 3D reconstruction.",
)
app.add_typer(recon_app)
study_app = typer.Typer(no_args_is_help=True, help="Studies: create, import, export, invite, balance, list.")
admin_app = typer.Typer(no_args_is_help=True, help="Experimenters.")
token_app = typer.Typer(no_args_is_help=True, help="Tokens with which analysts fetch results.")
db_app = typer.Typer(no_args_is_help=True, help="The database.")
stimuli_app = typer.Typer(no_args_is_help=True, help="Stimulus sets.")
experiment_app = typer.Typer(no_args_is_help=True, help="Whole experiments, from the recording to the report.")
for name, group in {
    "experiment": experiment_app,
    "stimuli": stimuli_app,
    "study": study_app,
    "admin": admin_app,
    "token": token_app,
    "db": db_app,
}.items():
    app.add_typer(group, name=name)

UrlOption = Annotated[str, typer.Option(help="Where the server is reached, for the links that are printed.")]


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for everything that is made; starting again resumes.")] = Path(
        "demo"
    ),
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the server; 0 for any free one.")] = 8000,
    participants: Annotated[int, typer.Option(min=0, help="Simulated participants.")] = 8,
    serve: Annotated[bool, typer.Option(help="Serve the study afterwards, until interrupted.")] = True,
    as_json: JsonOption = False,
) -> None:
    """The main job on a synthetic recording: models, videos, a study, votes, scores; then serve it."""
    from app.demo import ability_sentence, demo_front, demo_scores
    from app.main import running_server
    from app.settings import Settings
    from app.timetable import Timetable

    settings, front = Settings(data_dir=out / "study", database_url=None), out / "front"
    progress = ProgressLine(note=lambda: timetable.left())
    timetable = Timetable(_demo_steps(out, settings, participants, progress), out / "seconds.json")
    progress.say(f"The whole way once, from a recording to scores, into {out}: {timetable.left()}.")
    timetable.run(progress.say)
    with running_server(settings, port=_free_port(port), front=front) as url:
        links = {name: url + path for name, path in demo_front(settings, out, front, DEMO_FRAMES).items()}
        analysis = demo_scores(out)
        scores = "" if analysis is None else (
            f"\nScores in natural log-odds, best first (simulated participants prefer {ability_sentence()}):\n"
            f"{_score_sentences(analysis)}\nReport: {out / 'analysis/report.html'}\n"
        )  # fmt: skip
        sentences = (
            f"{scores}\nBegin here:          {url}\nAs a participant:    {links['participant']}\n"
            f"As an experimenter:  {links['experimenter']}"
        )
        result = {"out": str(out), "url": url, **links, **({"scores": analysis["scores"]} if analysis else {})}
        print_result(result, sentences, as_json=as_json)
        if serve:
            progress.say("Serving until you press Ctrl-C; started again, it serves within seconds.")
            _wait_for_interrupt()


def _demo_steps(out: Path, settings: Settings, participants: int, progress: ProgressLine) -> list[Step]:
    """The demo's work, with seconds on two idle cores; each step makes only what is missing."""
    from app.demo import demo_analysis, demo_study, demo_votes
    from app.main import running_server
    from app.timetable import Step
    from recon.capture.format import CAPTURE_FILE
    from recon.capture.segment import segment_capture
    from recon.flythrough import RenderOptions
    from recon.pipeline import ReconstructOptions, reconstruct, render
    from recon.preview import write_stage_pictures
    from recon.run import read_run
    from recon.studio import SynthParameters, synthesise

    capture, run, stimuli = out / "capture", out / "run", out / "stimuli"

    def record() -> None:
        if not (capture / CAPTURE_FILE).exists():
            parameters = SynthParameters(scene="ball", n_frames=DEMO_FRAMES, size=(540, 960), fps=5.0)
            synthesise(capture, parameters, progress=progress)
            segment_capture(capture, progress=progress)

    def make_models() -> None:
        reconstruct(capture, run, ReconstructOptions(), progress)
        write_stage_pictures(read_run(run.resolve()), 0, out / "front")

    def film() -> None:
        options = RenderOptions(size=(960, 540), seconds=DEMO_SECONDS, loop="repeat")
        render([run], stimuli, options, progress)

    def make_study() -> None:
        demo_study(settings, stimuli, DEMO_SECONDS, _counted(progress))

    def take_votes() -> None:
        with running_server(settings) as url:
            demo_votes(settings, url, participants, _counted(progress))
            demo_analysis(settings, url, out / "analysis")

    return [
        Step("record a moving person with three synthetic stereo sensors", 8, record, f"{capture}/S2/left/0000.png"),
        Step("reconstruct it by six approaches: depth, clouds, models", 55, make_models, f"{run}/previews/0000.png"),
        Step("film every model from the same moving camera", 40, film, f"{stimuli}/ball/pm_fb.mp4"),
        Step("make a study of the films: pairs, orders, an invitation", 25, make_study),
        Step(
            f"let {participants} artificial people vote over HTTP, and turn votes into scores",
            8,
            take_votes,
            f"{out}/analysis/report.html" if participants else "",
        ),
    ]


@experiment_app.command("paper")
def experiment_paper(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for all that is made; starting again resumes.")],
    scale: Annotated[str, typer.Option(help="small: minutes; full: full HD, 15 s, hours to days.")] = "small",
    workers: Annotated[int, typer.Option(min=1, help="Local processes, one thread each; 1 uses all cores.")] = 1,
    cluster: Annotated[str | None, typer.Option(help="A Dask scheduler whose workers do the heavy work.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Start `full` without asking.")] = False,
    as_json: JsonOption = False,
) -> None:
    """The paper's experiment on synthetic recordings and artificial people, and a report beside the paper's numbers."""
    from app.experiment import StudyPart, study_step
    from app.experiment_report import read_results, write_experiment_report
    from app.timetable import Step, Timetable, duration
    from recon.experiment import SCALES, Experiment, measured_pace, steps

    if scale not in SCALES:
        raise typer.BadParameter(f"--scale is {scale!r}, expected {' or '.join(SCALES)}")
    experiment, study = Experiment(out.resolve(), SCALES[scale], workers, cluster), StudyPart(out.resolve())
    progress = ProgressLine(note=lambda: timetable.left())
    pace = measured_pace(ProgressLine()) if scale == "full" else 1.0
    timetable = Timetable(
        [
            *(Step(name, seconds, partial(do, progress)) for name, seconds, do in steps(experiment, pace)),
            study_step(study, pace * experiment.scale.film_megapixels, _counted(progress)),
        ],
        out / "seconds.json",
    )
    progress.say(f"Into {out}: {timetable.left()} on this machine{' alone' if cluster else ''}.")
    if scale == "full" and not yes:
        _ask_to_go_on(f"It takes about {duration(timetable.seconds_left())}")
    seconds = timetable.run(progress.say)
    report = write_experiment_report(read_results(study, seconds), scale)
    progress.close()
    _tell_of_experiment(out, report, as_json=as_json)


@stimuli_app.command("check")
def stimuli_check(
    stimulus_set: Annotated[Path, typer.Argument(help="Folder of the stimulus set, or its manifest.json.")],
    as_json: JsonOption = False,
) -> None:
    """Check a stimulus set: files, digests, and that every video can be decoded."""
    from app.stimuli import read_stimulus_set

    progress = ProgressLine()
    found = read_stimulus_set(stimulus_set, _counted(progress))
    progress.close()
    result = {"name": found.name, "datasets": list(found.datasets), "conditions": list(found.conditions)}
    sentence = f"{len(found.stimuli)} videos of {len(found.datasets)} datasets are whole: {stimulus_set}"
    print_result(result, sentence, as_json=as_json)


@stimuli_app.command("import")
def stimuli_import(
    folder: Annotated[Path, typer.Argument(help="Folder with DATASET/CONDITION.mp4, and conditions.csv for factors.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the stimulus set, new.")],
    practice: Annotated[
        str | None, typer.Option(help="The dataset to practise on, with two videos; it is not compared.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make a stimulus set of somebody else's videos."""
    from app.stimulus_import import import_stimuli

    progress = ProgressLine()
    found = import_stimuli(folder, out, practice=practice, progress=_counted(progress))
    progress.close()
    result = {
        "name": found.name,
        "path": str(out),
        "datasets": list(found.datasets),
        "conditions": list(found.conditions),
        "factors": found.factors,
        "videos": len(found.stimuli),
    }
    sentence = (
        f"{len(found.stimuli)} videos: {len(found.conditions)} conditions of {len(found.datasets)} datasets: {out}\n"
        f"A study of it: reconstudy study create {out} --name NAME"
    )
    print_result(result, sentence, as_json=as_json)


@study_app.command("create")
def study_create(
    stimulus_set: Annotated[Path, typer.Argument(help="Folder of the stimulus set, or its manifest.json.")],
    study_name: Annotated[str, typer.Option("--name", help="What participants and experimenters read.")],
    exposure: Annotated[
        float | None, typer.Option(help="Seconds a pair is shown; default: as long as the shortest video.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of everybody's order; default: drawn.")] = None,
    options_file: Annotated[
        Path | None,
        typer.Option("--options", help="TOML: optional_stages (practice, interview), consent, questions, …"),
    ] = None,
    both_orders: Annotated[
        bool, typer.Option("--both-orders", help="Show every pair twice, with A and B exchanged the second time.")
    ] = False,
    repeated_pairs: Annotated[
        int | None, typer.Option(min=0, help="Pairs of each dataset that come again, to see whether choices repeat.")
    ] = None,
    identical_pairs: Annotated[
        int | None, typer.Option(min=0, help="Pairs of each dataset that hold one stimulus twice, to check attention.")
    ] = None,
    free_exposure: Annotated[
        bool,
        typer.Option("--free-exposure", help="Let the participant end the exposure; the videos repeat until then."),
    ] = False,
    reference: Annotated[
        str | None, typer.Option(help="Condition to show as the reference beside every pair, and not to compare.")
    ] = None,
    second_codec: Annotated[
        str | None, typer.Option(help="vp9 or av1: make every film in this codec too, for browsers without H.264.")
    ] = None,
    fallback: Annotated[
        str | None,
        typer.Option(help="Where no film of both plays: webcodecs (default), 'two videos' (flagged), or ''."),
    ] = None,
    break_every: Annotated[
        int | None, typer.Option(min=0, help="Trials after which a break is offered; 0: never; default: 25.")
    ] = None,
    url: UrlOption = DEFAULT_URL,
    as_json: JsonOption = False,
) -> None:
    """Create a study of a stimulus set, with an open invitation."""
    from app.operate import create_study, read_options
    from app.settings import Settings

    given = {
        "both_orders": both_orders or None,
        "repeated_pairs": repeated_pairs,
        "identical_pairs": identical_pairs,
        "free_exposure": free_exposure or None,
        "reference": reference,
        "second_codec": second_codec,
        "fallback": fallback,
        "break_every": break_every,
    }
    options = read_options(options_file, {name: value for name, value in given.items() if value is not None})
    progress = ProgressLine()
    study = create_study(
        Settings(),
        stimulus_set,
        study_name,
        exposure_s=exposure,
        seed=seed,
        options=options,
        progress=_counted(progress),
    )
    progress.close()
    _tell_of_study(study, url, as_json=as_json)


@study_app.command("import")
def study_import(
    file: Annotated[Path, typer.Argument(help="TOML: name, stimuli, exposure_s, seed, [options]; see study export.")],
    stimuli: Annotated[
        Path | None, typer.Option(help="Folder of the stimulus set; default: the one that the file names.")
    ] = None,
    url: UrlOption = DEFAULT_URL,
    as_json: JsonOption = False,
) -> None:
    """Create a study as a study file says, with an open invitation."""
    from app.operate import import_study
    from app.settings import Settings

    progress = ProgressLine()
    study = import_study(Settings(), file, stimuli=stimuli, progress=_counted(progress))
    progress.close()
    _tell_of_study(study, url, as_json=as_json)


@study_app.command("export")
def study_export(
    study: Annotated[str, typer.Argument(help="The study's name in addresses, as `study list` shows it.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write; default: standard output.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a study as a study file, from which `study import` makes it again."""
    from app.operate import export_study
    from app.settings import Settings

    text = export_study(Settings(), study)
    if out is not None:
        out.write_text(text, encoding="utf-8")
    result = {"study": study, "toml": text, "file": str(out) if out else None}
    print_result(result, f"Wrote {out}." if out else text.rstrip(), as_json=as_json)


@study_app.command("invite")
def study_invite(
    study: Annotated[str, typer.Argument(help="The study's name in addresses, as `study list` shows it.")],
    places: Annotated[
        int | None, typer.Option(min=1, help="For so many participants; default: as many as come.")
    ] = None,
    url: UrlOption = DEFAULT_URL,
    as_json: JsonOption = False,
) -> None:
    """Make another invitation to a study."""
    from app.operate import add_invitation
    from app.settings import Settings

    made = add_invitation(Settings(), study, places=places)
    made["link"] = url + made["path"]
    people = "as many participants as come" if places is None else f"{places} participant{'s' * (places > 1)}"
    print_result(made, f"For {people}: {made['link']}", as_json=as_json)


@study_app.command("balance")
def study_balance(
    study: Annotated[str, typer.Argument(help="The study's name in addresses, as `study list` shows it.")],
    as_json: JsonOption = False,
) -> None:
    """Whether everybody's order follows from the seed, and whether labels, first looks and datasets are balanced."""
    from app.operate import study_balance as balance_of
    from app.settings import Settings

    report = balance_of(Settings(), study)
    print_result(report, "\n".join(_balance_lines(report)), as_json=as_json)


@study_app.command("attach")
def study_attach(
    results: Annotated[
        list[Path], typer.Argument(help="Folders that `reconstudy validate` and `reconstudy models` wrote.")
    ],
    study: Annotated[str | None, typer.Option(help="The study's slug; default: the only one there is.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Attach objective measures, reports and models to a study; again: they are replaced."""
    from app.operate import attach_results
    from app.settings import Settings

    found = attach_results(Settings(), results, study)
    sentences = []
    if found["measures"]:
        sentences.append(f"Attached {found['n_values']} values to {found['study']}: {', '.join(found['measures'])}")
    if found["models"]:
        sentences.append(f"Attached {found['models']} models to {found['study']}")
    if found["ignored"]:
        sentences.append(f"The study does not compare {', '.join(found['ignored'])}: left out.")
    print_result(found, "\n".join(sentences), as_json=as_json)


@study_app.command("list")
def study_list(as_json: JsonOption = False) -> None:
    """All studies with their progress, the newest first."""
    from app.operate import list_studies
    from app.settings import Settings

    found = list_studies(Settings())
    lines = [_study_sentence(study) for study in found] or [
        "There is no study yet; `reconstudy study create` makes one."
    ]
    print_result({"studies": found}, "\n".join(lines), as_json=as_json)


@app.command()
def serve(
    host: Annotated[str, typer.Option(help="Address to listen on; 0.0.0.0 for every network.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 for any free one.")] = 8000,
    workers: Annotated[int, typer.Option(min=1, help="Processes; more than one needs PostgreSQL.")] = 1,
) -> None:
    """Serve all studies until interrupted."""
    from app.main import serve as serve_studies
    from app.operate import list_studies, set_up_path
    from app.settings import Settings

    settings = Settings()

    def announce(url: str) -> None:
        print(f"Serving at {url} until you press Ctrl-C.", flush=True)
        for study in list_studies(settings):
            for code in study["invitations"]:
                print(f"  participants of {study['name']}: {url}/s/{code}", flush=True)
        print(f"  experimenters: {url}/admin (sign-in link by `reconstudy admin add NAME --url {url}`)", flush=True)
        if path := set_up_path(settings):
            print(f"  set up the first experimenter, once: {url}{path}", flush=True)

    serve_studies(settings, host, port, workers=workers, on_start=announce)


@admin_app.command("add")
def admin_add(
    experimenter: Annotated[str, typer.Argument(metavar="NAME", help="The experimenter's name.")],
    role: Annotated[
        str | None, typer.Option(help="viewer, experimenter or owner; default: as it is, or owner for a new one.")
    ] = None,
    url: UrlOption = DEFAULT_URL,
    as_json: JsonOption = False,
) -> None:
    """A sign-in link for an experimenter, good for a week; an older link of theirs ends."""
    from app.operate import add_experimenter
    from app.settings import Settings
    from app.store.experimenters import ROLES

    if role is not None and role not in ROLES:
        raise typer.BadParameter(f"--role is {role!r}, expected one of {', '.join(ROLES)}")
    added = add_experimenter(Settings(), experimenter, next((known for known in ROLES if known == role), None))
    added["link"] = url + added["path"]
    print_result(added, f"{added['name']} signs in with {added['link']}", as_json=as_json)


@token_app.command("add")
def token_add(
    token_name: Annotated[str, typer.Argument(metavar="NAME", help="Who or what the token is for.")],
    scope: Annotated[
        list[str] | None, typer.Option(help="read, personal or audit; may be repeated; default: all of them.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """A bearer token for fetching results over REST; it is shown this once."""
    from app.operate import add_token
    from app.settings import Settings
    from app.store.tokens import SCOPES

    if unknown := sorted(set(scope or ()) - SCOPES.keys()):
        raise typer.BadParameter(f"--scope is {unknown[0]!r}, expected some of {', '.join(SCOPES)}")
    added = add_token(Settings(), token_name, tuple(scope or SCOPES))
    print_result(added, f"Token of {added['name']}, shown this once: {added['token']}", as_json=as_json)


@app.command()
def backup(
    file: Annotated[Path, typer.Argument(help="ZIP file to write.")],
    media: Annotated[bool, typer.Option("--media", help="The pair videos too.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write all that is stored to a file, as it is at one moment; the server may run."""
    from app.settings import Settings
    from app.upkeep import back_up

    result = back_up(Settings(), file, with_media=media)
    n_rows = sum(result["tables"].values())
    print_result(result, f"{n_rows} rows and {result['videos']} videos are in {file}.", as_json=as_json)


@app.command()
def restore(
    file: Annotated[Path, typer.Argument(help="What `reconstudy backup` wrote, on either kind of database.")],
    replace: Annotated[bool, typer.Option("--replace", help="Drop the studies that the database holds.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Bring a backup back, all of it or nothing; the server may run."""
    from app.settings import Settings
    from app.upkeep import restore as restore_backup

    result = restore_backup(Settings(), file, replace=replace)
    print_result(
        result, f"{sum(result['tables'].values())} rows and {result['videos']} videos are back.", as_json=as_json
    )


@db_app.command("check")
def db_check(as_json: JsonOption = False) -> None:
    """Everything wrong with the database and the videos it names; exit 1 if anything is."""
    from app.settings import Settings
    from app.upkeep import check

    result = check(Settings())
    print_result(result, "\n".join(result["faults"]) or "Nothing is wrong.", as_json=as_json)
    if result["faults"]:
        raise typer.Exit(1)


@db_app.command("upgrade")
def db_upgrade(as_json: JsonOption = False) -> None:
    """Bring the database to the newest version."""
    from app.operate import upgrade_database
    from app.settings import Settings

    result = upgrade_database(Settings())
    print_result(result, f"The database is at version {result['version']}.", as_json=as_json)


@app.command()
def simulate(
    study: Annotated[str, typer.Option(help="The study's name in addresses, as `study list` shows it.")],
    url: Annotated[str | None, typer.Option(help="A running server of this database; default: one of its own.")] = None,
    participants: Annotated[int, typer.Option(min=1, help="How many take the whole study.")] = 22,
    abilities: Annotated[
        Path | None,
        typer.Option(
            help="JSON: condition, or dataset/condition, -> ability in natural log-odds; default: drawn by the seed."
        ),
    ] = None,
    tie_rate: Annotated[float, typer.Option(min=0, max=0.99, help="Chance of no preference between equals.")] = 0.2,
    seed: Annotated[int, typer.Option(help="Of the abilities and choices.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Artificial participants of known preference take the whole study over HTTP."""
    from app.main import running_server
    from app.settings import Settings
    from app.simulate import simulate_study

    settings = Settings()
    known = None if abilities is None else _read_abilities(abilities)
    progress = ProgressLine()
    with nullcontext(url) if url else running_server(settings) as base_url:
        result = simulate_study(
            settings, base_url, study, participants, known, tie_rate, seed, progress=_counted(progress)
        )
    progress.close()
    print_result(result, f"{participants} simulated participants voted {result['votes']} times.", as_json=as_json)


@app.command()
def analyse(
    votes: Annotated[Path, typer.Argument(help="Votes as CSV, Parquet or JSON.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for analysis.json, tables, figures and report.")],
    items: Annotated[Path | None, typer.Option(help="CSV: item, then a column for each factor.")] = None,
    measures: Annotated[
        Path | None, typer.Option(help="CSV: dataset, item, then a column for each objective measure.")
    ] = None,
    ties: Annotated[str, typer.Option(help="davidson, rao-kupper, half or drop.")] = "davidson",
    factor: Annotated[list[str] | None, typer.Option(help="Factor of --items to analyse; default: all.")] = None,
    participants: Annotated[
        Path | None, typer.Option(help="CSV: participant, then a column for each grouping (experience, age, …).")
    ] = None,
    group: Annotated[
        list[str] | None, typer.Option(help="Grouping of --participants to compare; default: all.")
    ] = None,
    penalty: Annotated[str, typer.Option(help="Estimate where no maximum exists: firth or ridge.")] = "firth",
    by: Annotated[str, typer.Option(help="dataset: also every dataset by itself; none: only pooled.")] = "dataset",
    order_effect: Annotated[
        bool, typer.Option("--order-effect", help="Estimate the advantage of being shown first.")
    ] = False,
    bootstrap: Annotated[int, typer.Option(min=0, help="Replicates over participants for the intervals.")] = 0,
    seed: Annotated[int, typer.Option(help="Of the bootstrap.")] = 0,
    exclude: Annotated[
        list[str] | None, typer.Option(help="Participant to leave out, as a recorded decision; may be repeated.")
    ] = None,
    columns: Annotated[
        str | None, typer.Option(help="Where names differ: participant=judge,item_a=left,item_b=right.")
    ] = None,
    choices: Annotated[str | None, typer.Option(help="Where words differ: none=tie,a=1,b=0.")] = None,
    as_json: JsonOption = False,
) -> None:
    """The whole analysis of any pair-comparison votes: triads, scores, standard errors, figures, report."""
    from app.analysis import AnalysisSettings, analyse_file

    if by not in ("dataset", "none"):
        raise typer.BadParameter(f"--by is {by!r}, expected dataset or none")
    settings = AnalysisSettings(
        ties=ties,
        order_effect=order_effect,
        bootstrap=bootstrap,
        seed=seed,
        penalty=penalty,
        by_dataset=by == "dataset",
        exclude=tuple(exclude or ()),
    )
    analysis = analyse_file(
        votes,
        out,
        settings,
        items=items,
        columns=_parse_mapping(columns, "--columns"),
        choices=_parse_mapping(choices, "--choices"),
        factors=factor,
        measures=measures,
        participants=participants,
        groups=group,
    )
    print_result(analysis, _score_sentences(analysis) + f"\nReport: {out / 'report.html'}", as_json=as_json)


@app.command()
def plan(
    conditions: Annotated[int, typer.Option(min=2, help="Conditions compared within a dataset, every pair of them.")],
    datasets: Annotated[int, typer.Option(min=1, help="Datasets.")],
    participants: Annotated[int, typer.Option(min=2, help="Participants.")],
    effect: Annotated[float, typer.Option(help="True difference of two conditions, JOD (log-odds / ln 3).")] = 0.5,
    tie_rate: Annotated[float, typer.Option(min=0, max=0.99, help="Chance of no preference between equals.")] = 0.2,
    replicates: Annotated[int, typer.Option(min=10, help="Simulated studies for each power.")] = 400,
    seed: Annotated[int, typer.Option(help="Of the simulation.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Power and sample size of a study by simulation."""
    import numpy as np

    from app.analysis.power import StudyPlan, plan_study

    design = StudyPlan(conditions, datasets, participants, tie_rate=tie_rate)
    result = plan_study(design, np.random.default_rng(seed), effect_jod=effect, replicates=replicates)
    sentences = (
        f"{result['votes_per_participant']} votes by each of {participants} participants.\n"
        f"A difference of {effect:g} JOD is found with a power of {result['power_one_dataset']:.2f} in one dataset, "
        f"{result['power_pooled']:.2f} over all.\n"
        f"Found with a power of 0.8: {_jod(result['detectable_jod_one_dataset'])} in one dataset, "
        f"{_jod(result['detectable_jod_pooled'])} over all."
    )
    print_result(result, sentences, as_json=as_json)


def main() -> None:
    """Run the command line: exit 0 done, 1 it failed with a sentence that says why, 2 wrong use."""
    try:
        app()
    except ModuleNotFoundError as error:
        if error.name not in BACKEND_PACKAGES:
            raise
        _fail(
            f"this command needs the reconstruction backend ({error.name} is missing): pip install 'reconstudy[recon]'"
        )
    except KeyboardInterrupt:
        _fail("interrupted", code=130)
    except (ValueError, OSError, RuntimeError) as error:
        if "RECONSTUDY_DEBUG" in os.environ:
            raise
        _fail(str(error))
    except UnavailableError as error:
        _fail(error.detail)


def _fail(sentence: str, code: int = 1) -> None:
    print(f"reconstudy: {sentence}", file=sys.stderr)
    sys.exit(code)


def _counted(progress: ProgressLine) -> Callable[[int, int, str], None]:
    """Progress as the server reports it; the first word names the step, the rest the item at hand."""
    return lambda done, total, what: progress(what.split(" ")[0], done, total) if what else None


def _study_sentence(study: Mapping[str, Any]) -> str:
    return (
        f"{study['slug']} ({study['state']}): {study['n_finished']} of {study['n_started']} participants finished, "
        f"{study['n_votes']} votes; invitations {', '.join(study['invitations'])}"
    )


def _tell_of_study(study: dict[str, Any], url: str, *, as_json: bool) -> None:
    study["link"] = url + study["path"]
    sentences = (
        f"Created the study {study['slug']}: {study['n_pairs']} pairs of {study['n_conditions']} conditions, "
        f"{study['exposure_s']:g} s each.\nInvite participants with {study['link']} once `reconstudy serve` runs."
    )
    print_result(study, sentences, as_json=as_json)


def _balance_lines(report: Mapping[str, Any]) -> Iterator[str]:
    yield f"Orders from the seed {report['seed']}: {'balanced' if report['ok'] else 'NOT BALANCED'}"
    yield "Participants: " + ", ".join(f"{n} {state}" for state, n in report["participants"].items())
    for rule in report["rules"]:
        verdict = "ok" if rule["ok"] else "NO"
        yield f"  {verdict} {rule['worst']:>4} (at most {rule['allowed']})  {rule['of']}: {rule['rule']}"


def _parse_mapping(text: str | None, option: str) -> dict[str, str] | None:
    """The pairs of "ours=theirs,ours=theirs"."""
    if text is None:
        return None
    pairs = [pair.partition("=") for pair in text.split(",")]
    if not all(ours.strip() and theirs.strip() for ours, _, theirs in pairs):
        raise typer.BadParameter(f"{option} is {text!r}, expected ours=theirs, comma between")
    return {ours.strip(): theirs.strip() for ours, _, theirs in pairs}


def _read_abilities(path: Path) -> dict[str, float]:
    from recon.files import read_json

    content = read_json(path)
    wrong = [name for name, value in content.items() if isinstance(value, bool) or not isinstance(value, int | float)]
    if wrong:
        raise ValueError(f"{path}: the ability of {wrong[0]} is {content[wrong[0]]!r}, expected a number")
    return {name: float(value) for name, value in content.items()}


def _score_sentences(analysis: Mapping[str, Any]) -> str:
    """The pooled scores, a line each, best first."""
    rows = [row for row in analysis["scores"] if row["comparison"] == "all" and row["dataset"] == "all"]
    rows.sort(key=lambda row: (row["score"] is None, -(row["score"] or 0)))
    width = max((len(row["item"]) for row in rows), default=0)
    return "\n".join(f"  {row['item']:<{width}}  {_score_text(row)}" for row in rows)


def _score_text(row: Mapping[str, Any]) -> str:
    if row["score"] is None:
        return f"no score ({row['status']})"
    interval = "" if row["ci_low"] is None else f"  95 % interval {row['ci_low']:+.3f} to {row['ci_high']:+.3f}"
    return f"{row['score']:+.3f}{interval}"


def _jod(difference: float | None) -> str:
    return "no difference considered" if difference is None else f"{difference:.2f} JOD"


def _ask_to_go_on(sentence: str) -> None:
    """Go on if a person says so; a script says --yes beforehand."""
    if not sys.stdin.isatty():
        raise typer.BadParameter(f"{sentence}, and nobody can be asked here: add --yes to start it")
    typer.confirm(f"{sentence}. Start?", abort=True, err=True)


def _tell_of_experiment(out: Path, report: Mapping[str, Any], *, as_json: bool) -> None:
    lines = [
        f"  {'agrees ' if check['agrees'] else 'DIFFERS'} {check['question']}: put in {check['put_in']}, came out "
        f"{check['came_out']}"
        for check in report["checks"]
    ]
    sentences = ["Conclusions, and the truth that was put in:", *lines, f"Report: {out / 'report.html'}"]
    print_result({"report": str(out / "report.html"), **report}, "\n".join(sentences), as_json=as_json)


def _free_port(wanted: int) -> int:
    """The wanted port, or 0 (any free one) if another program has it."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", wanted))
        except OSError:
            return 0
    return wanted


def _wait_for_interrupt() -> None:
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        print(file=sys.stderr)
