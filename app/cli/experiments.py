"""The commands that do everything at once: the demo, and the paper's experiment."""

from __future__ import annotations

import shlex
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from app.cli.analysis import score_sentences
from app.cli.shared import by_step
from app.files import free_gb, read_json, write_json
from ground.progress import duration
from recon.cli.commands.experiments import DEMO_SIZE, Demo, ExperimentPaper
from recon.cli.console import ProgressLine, print_result
from recon.cli.flags import with_settings
from recon.cli.kernels import DEPTH, RENDER, STUDIO, tell_of_compiling
from recon.cli.options import parse_approaches, parse_names, parse_size

if TYPE_CHECKING:
    from app.settings import Settings

DEMO_SECONDS, DEMO_FPS = 2.4, 20.0  # of a film: each frame stays for three pictures of a display of 60 Hz
DEMO_EXPOSURE_S = 4.8  # each film plays twice
DEMO_FRAMES = 4  # played back and forth, twice in a film, which ends as it begins
DEMO_FILM_STEP = 7  # every seventh frame is measured; a model stays for four
DEMO_WORKERS = 2  # that make models and films, each on one thread
PRACTICE_SCENE = "box"  # small, as it is only to be told from its coarse twin
PRACTICE_FRAMES = 2
COARSE_MM = 40.0  # voxels, twice as large as the good model's
DEMO_TAKES = "two to three minutes on two idle cores"

app = typer.Typer()
experiment_app = typer.Typer(no_args_is_help=True, help="Run whole experiments, from recording to report.")
app.add_typer(experiment_app, name="experiment")


class Step(NamedTuple):
    """A part of the work; it makes only what is missing."""

    name: str
    run: Callable[[], None]
    look: str = ""  # the file in which to see what was made


@app.command()
@with_settings(Demo)
def demo(asked: Demo, *, as_json: bool) -> None:
    """Do the main job on a synthetic recording: models, videos, a study, votes and scores; then serve the study."""
    from app.experiment.demo import demo_front, demo_put_in, demo_scores
    from app.main import running_server
    from app.operations.jobs.beside_server import worker_beside
    from app.operations.running import alone, noted
    from app.settings import DATA_FOLDER, Settings

    out = asked.out
    settings = Settings(data_dir=out / DATA_FOLDER, database_url=None, allowed_hosts="")
    front, film_size = out / "front", _demo_size(out, asked.size)
    with alone(settings), ProgressLine() as progress:
        progress.say(
            f"From a recording to scores, into {out}. This takes {DEMO_TAKES}, less where it was begun before."
        )
        tell_of_compiling(progress, STUDIO, DEPTH, RENDER)
        steps = _demo_steps(out, settings, film_size, asked.participants, progress)
        run_steps(steps, out / "seconds.json", progress.say)
    with (
        alone(settings),
        running_server(settings, port=_free_port(asked.port), front=front) as url,
        noted(settings, url),
        worker_beside(settings, int(asked.serve)),
    ):
        links = {name: url + path for name, path in demo_front(settings, out, front, DEMO_FRAMES).items()}
        analysis = demo_scores(out)
        scores = "" if analysis is None else (
            f"\nScores in natural log-odds, best first:\n{score_sentences(analysis)}\n"
            + "".join(f"{sentence}\n" for sentence in demo_put_in(out))
            + f"Report: {out / 'analysis/report.html'}\n"
        )  # fmt: skip
        served = {
            "Begin here": url,
            "As a participant": links["participant"],
            "As an experimenter": links["experimenter"],
        }
        ended = {"To see its pages": shlex.join(["reconstudy", "demo", "--out", str(out)])}
        data = {"Data folder": f"{settings.data_dir} (further commands on it: cd {out}, then reconstudy status)"}
        places = (served if asked.serve else ended) | data
        sentences = scores + "".join(f"\n{name + ':':<20} {place}" for name, place in places.items())
        result = {"out": str(out), "url": url, **links, **({"scores": analysis["scores"]} if analysis else {})}
        print_result(result, sentences, as_json=as_json)
        if asked.serve:
            progress.say("Serving until you press Ctrl-C; started again, it serves within seconds.")
            _wait_for_interrupt()


def _demo_size(out: Path, wanted: str | None) -> tuple[int, int]:
    """Return the films' size: the wanted one, or that of the films which an earlier start made its study of."""
    from app.intake.stimuli import MANIFEST

    manifest = out / "stimuli" / MANIFEST
    if not manifest.is_file():
        return parse_size(wanted or DEMO_SIZE)
    film = read_json(manifest)["stimuli"][0]
    width, height = film["width"], film["height"]
    if wanted is not None and parse_size(wanted) != (width, height):
        raise typer.BadParameter(
            f"--size is {wanted}, but {out} has films of {width}x{height} and a study of them; leave --size out, or "
            "choose another folder with --out"
        )
    return width, height


def _demo_steps(
    out: Path, settings: Settings, film_size: tuple[int, int], participants: int, progress: ProgressLine
) -> list[Step]:
    """List the demo's steps; each makes only what is missing."""
    from app.experiment.demo import demo_analysis, demo_scores, demo_study, demo_votes
    from app.main import running_server
    from recon.capture.format import CAPTURE_FILE, read_capture
    from recon.capture.masks.segment import segment_capture
    from recon.methods.approaches import PHOTOGRAPHS
    from recon.models.scene_file import SCENE_FILE
    from recon.pipeline.film import RenderOptions
    from recon.pipeline.job import ReconstructOptions
    from recon.pipeline.preview import write_stage_pictures
    from recon.pipeline.reconstruct import reconstruct
    from recon.pipeline.render import render
    from recon.pipeline.run import read_run
    from recon.studio import SynthParameters, synthesise
    from recon.studio.truth_models import TRUTH, write_truth_models
    from recon.surface import SurfaceParameters
    from recon.validation.films.evaluation import FilmSettings, measure_films
    from recon.validation.films.report import write_films_report

    capture, run, truth, stimuli, measured, practice = (
        out / name for name in ("capture", "run", TRUTH, "stimuli", "validation/films", "practice")
    )

    films = stimuli / "ball"

    def record() -> None:
        ball = SynthParameters(scene="ball", n_frames=DEMO_FRAMES, size=(540, 960), fps=5.0)
        box = SynthParameters(scene=PRACTICE_SCENE, n_frames=PRACTICE_FRAMES, size=(270, 480), fps=5.0)
        for folder, parameters in ((capture, ball), (practice / "capture", box)):
            if not (folder / CAPTURE_FILE).exists():
                synthesise(folder, parameters, progress=progress)
            if read_capture(folder).sensors[0].mask is None:  # a start may have been stopped between the two
                segment_capture(folder, progress=progress)

    def make_models() -> None:
        reconstruct(capture, run, ReconstructOptions(colours=(PHOTOGRAPHS,), workers=DEMO_WORKERS), progress)
        write_stage_pictures(read_run(run.resolve()), 0, out / "front")
        good = ReconstructOptions(depths=("dr",), fusions=("fb",))
        coarse = ReconstructOptions(depths=("id",), fusions=("fa",), surface=SurfaceParameters(voxel_mm=COARSE_MM))
        reconstruct(practice / "capture", practice / "good", good, progress)
        reconstruct(practice / "capture", practice / "coarse", coarse, progress)

    def film() -> None:
        if not (truth / SCENE_FILE).exists():
            write_truth_models(read_capture(capture), truth)
        options = RenderOptions(
            size=film_size, fps=DEMO_FPS, seconds=DEMO_SECONDS, loop="bounce", master=False, workers=DEMO_WORKERS
        )
        folders = [run, truth, practice / "good", practice / "coarse"]
        render(folders, stimuli, options, progress, practice=PRACTICE_SCENE)

    def measure() -> None:
        if not (measured / "report.html").exists():
            write_films_report(*measure_films(stimuli, FilmSettings(TRUTH, every=DEMO_FILM_STEP), progress), measured)

    def make_study() -> None:
        demo_study(settings, stimuli, measured, DEMO_EXPOSURE_S, by_step(progress))

    def take_votes() -> None:
        with running_server(settings) as url:
            if demo_scores(out) is None:
                demo_votes(settings, url, participants, out, by_step(progress))
            demo_analysis(settings, url, out / "analysis")

    return [
        Step("record a moving person with three synthetic stereo sensors", record, f"{capture}/S2/left/0000.png"),
        Step("reconstruct it by six approaches: depth, clouds, models", make_models, f"{run}/previews/0000.png"),
        Step("film every model, and the true one, from the same moving camera", film, f"{films}/pm_fb_photographs.mp4"),
        Step("compare every film with that of the true model", measure, f"{measured}/report.html"),
        Step("make a study of the films: pairs, orders, an invitation", make_study),
        Step(
            f"let {participants} artificial people vote over HTTP, and turn votes into scores",
            take_votes,
            f"{out}/analysis/report.html" if participants else "",
        ),
    ]


@experiment_app.command("paper")
@with_settings(ExperimentPaper)
def experiment_paper(asked: ExperimentPaper, *, as_json: bool) -> None:
    """Repeat the paper's experiment on synthetic recordings with artificial people, and report it beside the paper."""
    from app.experiment.reconstruction import SCALES, Experiment, steps
    from app.experiment.report import read_results, write_experiment_report
    from app.experiment.study import StudyPart

    if asked.scale not in SCALES:
        raise typer.BadParameter(f"--scale is {asked.scale!r}, expected {' or '.join(SCALES)}")
    out = asked.out
    experiment = Experiment(
        out.resolve(),
        SCALES[asked.scale].resized(asked.frames, asked.seconds),
        parse_approaches(asked.approach),
        parse_names(asked.colour),
        tuple(asked.models or ()),
        asked.workers,
        asked.cluster,
        asked.device,
    )
    study = StudyPart(out.resolve(), has_ratings=asked.ratings)
    sentence = (
        f"The experiment takes about {duration(3600 * experiment.scale.hours)} on two idle cores "
        f"and {experiment.scale.gigabytes:.0f} GB of disk ({free_gb(out):.0f} GB are free)"
    )
    if asked.scale == "full" and not asked.yes:
        _ask_to_go_on(sentence)
    with ProgressLine() as progress:
        progress.say(f"{sentence}, less where it was begun before. All of it goes into {out}.")
        tell_of_compiling(progress, STUDIO, DEPTH, RENDER)
        planned = [Step(name, partial(work, progress)) for name, work in steps(experiment)]
        planned.append(Step("let people take the study", partial(study.take, by_step(progress))))
        taken = run_steps(planned, out / "seconds.json", progress.say)
        report = write_experiment_report(read_results(study, taken), asked.scale)
    _tell_of_experiment(out, report, as_json=as_json)


def run_steps(
    steps: Sequence[Step], notes: Path, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic
) -> dict[str, float]:
    """Announce and run every step; returns seconds by name.

    `notes` keeps how long each step took until it was done, what it took before it failed or was interrupted included,
    and no less after a later start, which only finds that all is there.
    """
    seconds = read_json(notes) if notes.is_file() else {}
    for number, step in enumerate(steps, start=1):
        say(f"{number} of {len(steps)}: {step.name}")
        unfinished = f"{step.name}, not done"
        started = clock()
        try:
            step.run()
        finally:
            seconds[unfinished] = round(seconds.get(unfinished, 0.0) + clock() - started, 1)
            write_json(notes, seconds)
        seconds[step.name] = max(seconds.get(step.name, 0.0), seconds.pop(unfinished))
        write_json(notes, seconds)
        if step.look:
            say(f"   look at {step.look}")
    return {step.name: seconds[step.name] for step in steps}


def _ask_to_go_on(sentence: str) -> None:
    """Ask whether to start; a script has to say --yes instead."""
    if not sys.stdin.isatty():
        raise typer.BadParameter(f"{sentence}, and nobody can be asked here: add --yes to start it")
    typer.confirm(f"{sentence}. Start?", abort=True, err=True)


def _tell_of_experiment(out: Path, report: Mapping[str, Any], *, as_json: bool) -> None:
    lines = [
        f"  {check['grade']:14} {check['question']}: put in {check['put_in']}, came out {check['came_out']}"
        for check in report["checks"]
    ]
    sentences = ["Conclusions, and the truth that was put in:", *lines, f"Report: {out / 'report.html'}"]
    print_result({"report": str(out / "report.html"), **report}, "\n".join(sentences), as_json=as_json)


def _free_port(wanted: int) -> int:
    """Return the wanted port, or 0 (any free one) if another program has it."""
    try:
        socket.create_server(("127.0.0.1", wanted)).close()
    except OSError:
        return 0
    return wanted


def _wait_for_interrupt() -> None:
    try:
        threading.Event().wait()
    except KeyboardInterrupt:
        print(file=sys.stderr)
