"""The commands that simulate votes and analyse them."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from click import Choice

from app.cli.shared import by_step, server_settings
from app.files import read_json
from app.operations.commands.analysis import Analyse
from app.operations.commands.studies import Simulate
from recon.cli.commands.setting import settings_of
from recon.cli.console import ProgressLine, counted, print_result
from recon.cli.flags import with_settings
from recon.cli.options import wrong_use

if TYPE_CHECKING:
    from app.analysis import AnalysisSettings
    from app.analysis.reading.description import QuestionError, Told
    from app.analysis.reading.sources import Source

app = typer.Typer()


@app.command()
@with_settings(Simulate)
def simulate(asked: Simulate, *, as_json: bool) -> None:
    """Let artificial participants of known preference take the whole study over HTTP."""
    with ProgressLine():  # what is loaded takes seconds
        from app.experiment.study import fetched
        from app.main import running_server
        from app.operations.running import alone, running_url
        from app.simulation.known_order import came_back, came_out, came_out_sentence, put_in_sentence
        from app.simulation.participants import simulate_study

    settings = server_settings()
    known = None if asked.abilities is None else _read_abilities(asked.abilities)
    with ProgressLine() as progress, ExitStack() as started:
        base_url = asked.url or running_url(settings)
        if base_url is None:
            started.enter_context(alone(settings))
            base_url = started.enter_context(running_server(settings))
        people = (asked.study, asked.participants, known, asked.tie_rate, asked.seed)
        result = simulate_study(settings, base_url, *people, progress=by_step(progress))
        progress.say("Analysing the votes.")
        scores = came_out(fetched(settings, base_url, asked.study, ("analysis",))["analysis"])
    put_in = result["put_in"]
    result |= {"came_out": scores, "came_back": came_back(put_in, scores)}
    sentences = (
        f"{counted(asked.participants, 'simulated participant')} gave {counted(result['votes'], 'answer')}.",
        put_in_sentence(put_in, result["order"] if known is None else f"as {asked.abilities} says"),
        came_out_sentence(put_in, scores),
    )
    print_result(result, "\n".join(sentences), as_json=as_json)


@app.command()
@with_settings(Analyse)
def analyse(asked: Analyse, *, as_json: bool) -> None:
    """Analyse any pair-comparison votes or ratings: scores, standard errors, figures and a report."""
    from app.analysis import AnalysisSettings, analyse_file, analyse_ratings_file
    from app.analysis.analyse_files import read_measures_of
    from app.analysis.drawing.charts_in_common import WIDTHS
    from app.analysis.ratings.reading import understand_ratings
    from app.analysis.reading.description import Told, pairs_of

    ends, out, width = _parse_scale(asked.scale), asked.out, WIDTHS[asked.width]
    with wrong_use():
        mappings = pairs_of(asked.columns or "", "--columns"), pairs_of(asked.choices or "", "--choices")
    told = Told(*mappings, format=asked.layout, encoding=asked.encoding, sheet=asked.sheet)
    sources = _recognised(asked.votes, told, can_ask=not as_json)
    rated = _rated_source(asked, sources)
    with wrong_use():
        settings = AnalysisSettings(
            **asked.model_dump(include=SETTINGS_OF_ANALYSIS),
            equivalence_margin=asked.equivalence,
            by_dataset=asked.by == "dataset",
            exclude=tuple(asked.exclude or ()),
            planned_participants=asked.planned,
        )
    if out is None and not asked.dry_run:
        raise typer.BadParameter("--out is missing: the folder for the results (or --dry-run, which writes nothing)")
    if ends and not rated and asked.ratings is None:
        raise typer.BadParameter("--scale is for ratings, and the file holds votes; did you mean --ratings FILE?")
    beside_votes: dict[str, Any] = {
        **asked.model_dump(include={"items", "measures", "participants"}),
        "factors": asked.factor,
        "groups": asked.group,
    }
    if out is None or asked.dry_run:
        understood = [] if rated else _understood_votes(sources, settings, beside_votes)
        if beside := rated or asked.ratings:
            table, sentences = understand_ratings(beside, ends)
            understood += sentences
            if rated and asked.measures:
                understood += _understood_measures(*read_measures_of(table, asked.measures))
        print_result({"understood": understood}, "\n".join(understood), as_json=as_json)
        return
    with ProgressLine():
        if rated:
            analysis = analyse_ratings_file(
                rated, out, ends, asked.exclude or (), width=width, measures=asked.measures, planned=asked.planned
            )
        else:
            analysis = analyse_file(
                sources, out, settings, **beside_votes, ratings=asked.ratings, scale=ends, width=width
            )
    scores = _rating_sentences(analysis) if rated else score_sentences(analysis)
    print_result(analysis, f"{_found_sentences(analysis)}{scores}\nReport: {out / 'report.html'}", as_json=as_json)


SETTINGS_OF_ANALYSIS = {  # that are called so on the command line
    *("ties", "order_effect", "bootstrap", "seed", "penalty", "jod_prior", "random_effects", "lapses"),
    "adaptive_pairs",
}
MOST_SCORES = 40  # lines of scores in the terminal
MOST_NAMED = 8  # conditions that a dry run lists
OPTIONS_OF_RATINGS = (
    *("votes", "out", "measures", "scale", "exclude", "width", "dry_run", "planned"),
    *("columns", "choices", "layout", "encoding", "sheet"),
)


def _recognised(paths: Sequence[Path], told: Told, *, can_ask: bool) -> list[Source]:
    """Read and recognise files; in a terminal, what can be read in several ways is asked."""
    from app.analysis.reading.description import QuestionError
    from app.analysis.reading.sources import recognise_file

    sources: list[Source] = []
    while len(sources) < len(paths):
        try:
            sources.append(recognise_file(paths[len(sources)], told))
        except QuestionError as question:
            is_answered = can_ask and len(question.readings) > 1 and sys.stdin.isatty() and sys.stderr.isatty()
            if not is_answered:
                raise
            told = told.and_told(_answer(question))
    return sources


def _answer(question: QuestionError) -> Told:
    """Ask which reading is meant, on the terminal, and return what to tell for it."""
    typer.echo(question, err=True)
    numbers = [str(number) for number in range(1, len(question.readings) + 1)]
    answer = typer.prompt(f"Which ({' or '.join(numbers)})", type=Choice(numbers), show_choices=False, err=True)
    told = question.readings[int(answer) - 1].told
    typer.echo(f"To say so without being asked: {told}", err=True)
    return told


def _rated_source(asked: Analyse, sources: Sequence[Source]) -> Source | None:
    """Return the file of ratings; None for files of votes. Raise if ratings come with what is for votes."""
    rated = [source for source in sources if not source.holds_votes]
    if not rated:
        return None
    if len(sources) > 1:
        raise typer.BadParameter(f"{rated[0].path} holds ratings; analyse ratings one file at a time")
    _refuse_options_of_votes(asked)
    return rated[0]


def _refuse_options_of_votes(asked: Analyse) -> None:
    """Raise if an option was given that says nothing about ratings."""
    for name, info, setting in settings_of(Analyse):
        if name not in OPTIONS_OF_RATINGS and getattr(asked, name) != info.default:
            raise typer.BadParameter(f"{setting.flag(name)} is for votes, and the file holds ratings; leave it out")


def _parse_scale(text: str | None) -> tuple[float, float] | None:
    """Read "low:high"."""
    if text is None:
        return None
    try:
        low, high = (float(end) for end in text.split(":"))
    except ValueError as error:
        raise typer.BadParameter(f"--scale is {text!r}, expected two numbers such as 1:5") from error
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise typer.BadParameter(f"--scale is {text!r}, expected its low end first, such as 1:5")
    return low, high


def _read_abilities(path: Path) -> dict[str, float]:
    content = read_json(path)
    for name, value in content.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"{path}: the ability of {name} is {value!r}, expected a number")
    return {name: float(value) for name, value in content.items()}


def _understood_votes(
    sources: Sequence[Source],
    settings: AnalysisSettings,
    beside: Mapping[str, Any],
) -> list[str]:
    """Return how votes, and the files beside them that `read_beside` takes, are understood."""
    from app.analysis.analyse import used_votes
    from app.analysis.analyse_files import read_beside
    from app.analysis.reading.read_votes import understand_votes

    votes, sentences = understand_votes(sources)
    settings, notes = read_beside(votes, settings, **beside)
    used = used_votes(votes, settings)
    people = counted(len(votes.participants), "participant") if votes.has_participants else "unknown participants"
    datasets = counted(len(votes.datasets), "dataset") if votes.has_datasets else "no named dataset"
    return [
        *sentences,
        f"Together: {counted(votes.n_votes, 'vote')}, {used.n_votes} of them counted; {people}, {datasets}, "
        f"{counted(len(votes.items), 'condition')}: {_few(votes.items)}",
        *(f"Factor {name}: {_few(levels.values())}" for name, levels in settings.factors.items()),
        *(f"Grouping {name}: {_few(groups.values())}" for name, groups in settings.groups.items()),
        *_understood_measures(settings, notes),
    ]


def _understood_measures(settings: AnalysisSettings, notes: Sequence[str]) -> list[str]:
    return ([f"Measures: {_few(settings.measures)}"] if settings.measures else []) + [*notes]


def _few(names: Iterable[str]) -> str:
    """Name the first of some names, each once."""
    unlike = list(dict.fromkeys(names))
    return ", ".join(unlike[:MOST_NAMED]) + (" …" if len(unlike) > MOST_NAMED else "")


def _found_sentences(analysis: Mapping[str, Any]) -> str:
    """List how the files were understood, what was found, and what to know before reading on."""
    lines = [f"Read {text}" for text in analysis.get("understood", ())]
    lines += [row["text"] for row in analysis["findings"]]
    lines += [f"Note: {text}" for text in analysis["warnings"]]
    return "".join(f"{line}\n" for line in lines)


def score_sentences(analysis: Mapping[str, Any]) -> str:
    """List the scores over all datasets, a line each, best first."""
    rows = [row for row in analysis["scores"] if row["comparison"] == "all" and row["dataset"] == "all"]
    rows.sort(key=lambda row: (row["score"] is None, -(row["score"] or 0)))
    listed, more = rows[:MOST_SCORES], len(rows) - MOST_SCORES
    width = max((len(row["item"]) for row in listed), default=0)
    lines = [f"  {row['item']:<{width}}  {_with_interval(row, 'score', '+z.3f')}" for row in listed]
    return "\n".join([*lines, f"  … and {more} more, in scores.csv"] if more > 0 else lines)


def _rating_sentences(analysis: Mapping[str, Any]) -> str:
    """List the mean opinion scores, or the scores of comparisons, over all datasets, a line each, best first."""
    if analysis.get("rating_conditions"):
        rows, name, form = list(analysis["rating_conditions"]), "mos", ".2f"
    else:
        datasets = [row["dataset"] for row in analysis["comparison_items"]]
        last = "all" if "all" in datasets else None
        rows = [row for row in analysis["comparison_items"] if last in (None, row["dataset"])]
        name, form = "score", "+z.2f"
    rows.sort(key=lambda row: -row[name])
    width = max((len(row["condition"]) for row in rows), default=0)
    return "\n".join(f"  {row['condition']:<{width}}  {_with_interval(row, name, form)}" for row in rows)


def _with_interval(row: Mapping[str, Any], name: str, form: str) -> str:
    if row[name] is None:
        return f"no score ({row['status']})"
    interval = "" if row["ci_low"] is None else f"  95 % interval {row['ci_low']:{form}} to {row['ci_high']:{form}}"
    return f"{row[name]:{form}}{interval}"
