"""The commands that simulate votes and analyse them."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from click import Choice

from app.cli.shared import by_step
from app.files import read_json
from recon.cli.console import JsonOption, ProgressLine, print_result
from recon.cli.options import wrong_use

if TYPE_CHECKING:
    from app.analysis import AnalysisSettings
    from app.analysis.reading.description import QuestionError, Told
    from app.analysis.reading.read_votes import Source

app = typer.Typer()


@app.command()
def simulate(
    study: Annotated[str, typer.Option(help="The study's short name, as `study list` shows it.")],
    url: Annotated[str | None, typer.Option(help="A running server of this database; default: start one.")] = None,
    participants: Annotated[int, typer.Option(min=1, help="How many simulated participants take the study.")] = 22,
    abilities: Annotated[
        Path | None,
        typer.Option(
            help="JSON file: {condition or dataset/condition: ability in natural log-odds}; default: in the order of "
            "the films' measured likeness to the truth, or else the paper's."
        ),
    ] = None,
    tie_rate: Annotated[float, typer.Option(min=0, max=0.99, help="Chance of no preference between equals.")] = 0.2,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the choices.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Let artificial participants of known preference take the whole study over HTTP."""
    from app.experiment.study import fetched
    from app.main import running_server
    from app.settings import Settings
    from app.simulation.known_order import came_back, came_out, came_out_sentence, put_in_sentence
    from app.simulation.participants import simulate_study

    settings = Settings()
    known = None if abilities is None else _read_abilities(abilities)
    progress = ProgressLine()
    with nullcontext(url) if url else running_server(settings) as base_url:
        result = simulate_study(
            settings, base_url, study, participants, known, tie_rate, seed, progress=by_step(progress)
        )
        progress.say("Analysing the votes.")
        scores = came_out(fetched(settings, base_url, study, ("analysis",))["analysis"])
    progress.close()
    put_in = result["put_in"]
    result |= {"came_out": scores, "came_back": came_back(put_in, scores)}
    sentences = (
        f"{participants} simulated participants voted {result['votes']} times.",
        put_in_sentence(put_in, result["order"] if known is None else f"as {abilities} says"),
        came_out_sentence(put_in, scores),
    )
    print_result(result, "\n".join(sentences), as_json=as_json)


# Options of `analyse`, in the order of its parameters.
VotesArgument = Annotated[
    list[Path],
    typer.Argument(help="File of votes, or several, or one of ratings: CSV, TSV, Excel, Parquet or JSON."),
]
OutOption = Annotated[
    Path | None, typer.Option("--out", "-o", help="Folder for analysis.json, tables, figures and report.")
]
ItemsOption = Annotated[Path | None, typer.Option(help="CSV file: item, then a column for each factor.")]
MeasuresOption = Annotated[
    Path | None,
    typer.Option(
        help="CSV file of objective measures: measures.csv of `validate`, or dataset, item and a column for each."
    ),
]
TiesOption = Annotated[
    str, typer.Option(help="How to treat votes without preference: davidson, rao-kupper, half or drop.")
]
FactorOption = Annotated[list[str] | None, typer.Option(help="Factor of --items to analyse; default: all.")]
ParticipantsOption = Annotated[
    Path | None, typer.Option(help="CSV file: participant, then a column for each grouping (experience, age, …).")
]
GroupOption = Annotated[list[str] | None, typer.Option(help="Grouping of --participants to compare; default: all.")]
PenaltyOption = Annotated[str, typer.Option(help="Penalty where the likelihood has no maximum: firth or ridge.")]
ByOption = Annotated[str, typer.Option(help="dataset: also analyse each dataset by itself; none: only all together.")]
OrderEffectOption = Annotated[bool, typer.Option("--order-effect", help="Estimate how much being shown first helps.")]
BootstrapOption = Annotated[
    int,
    typer.Option(min=0, help="Bootstrap replicates over participants for the intervals; 0: t intervals."),
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the bootstrap.")]
EquivalenceOption = Annotated[
    float | None,
    typer.Option(help="Margin in JOD; tests which pairs of conditions differ by less (two one-sided tests)."),
]
JodPriorOption = Annotated[
    str, typer.Option(help="Prior on distances for the JOD of Thurstone's Case V: none, or pwcmp's.")
]
RandomEffectsOption = Annotated[
    str,
    typer.Option(help="Fit the scores also with random effects: participants (other people) or participants,datasets."),
]
LapsesOption = Annotated[
    bool,
    typer.Option(
        "--lapses",
        help="Fit the scores also with careless answers weighted down, by a lapse rate for each participant.",
    ),
]
ExcludeOption = Annotated[
    list[str] | None, typer.Option(help="Participant to leave out; the report says so. May be repeated.")
]
PlannedOption = Annotated[
    int | None, typer.Option(min=1, help="Participants that the study was planned for; results of fewer are interim.")
]
AdaptiveOption = Annotated[
    bool, typer.Option("--adaptive-pairs", help="The pairs were chosen from the votes so far; the report says so.")
]
ColumnsOption = Annotated[
    str | None,
    typer.Option(help="Names of the file's columns where they differ: participant=judge,item_a=type_a+level_a."),
]
ChoicesOption = Annotated[
    str | None, typer.Option(help="Words of the file's choices where they differ: none=tie,a=1,b=0.")
]
FormatOption = Annotated[
    str,
    typer.Option(
        "--format", help="Name of the file's layout or program, as docs/formats.md lists them; default: recognised."
    ),
]
EncodingOption = Annotated[
    str, typer.Option(help="Encoding of a text file, e.g. latin-1; default: UTF-8 or marked UTF-16.")
]
SheetOption = Annotated[
    str, typer.Option(help="Sheet of a workbook (default: the first), or the question whose answers are taken.")
]
RatingsOption = Annotated[
    Path | None, typer.Option(help="File of ratings of the same items, to put on one scale with the votes.")
]
ScaleOption = Annotated[
    str | None, typer.Option(help="Ends of the ratings' scale, e.g. 1:9 or 0:100; default: 1:5, compared -3:3.")
]
WidthOption = Annotated[str, typer.Option(help="Width of the figures: one or two columns of a journal (88 or 181 mm).")]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Only say how the files are understood; write nothing.")]


@app.command()
def analyse(
    context: typer.Context,
    votes: VotesArgument,
    out: OutOption = None,
    items: ItemsOption = None,
    measures: MeasuresOption = None,
    ties: TiesOption = "davidson",
    factor: FactorOption = None,
    participants: ParticipantsOption = None,
    group: GroupOption = None,
    penalty: PenaltyOption = "firth",
    by: ByOption = "dataset",
    order_effect: OrderEffectOption = False,
    bootstrap: BootstrapOption = 0,
    seed: SeedOption = 0,
    equivalence: EquivalenceOption = None,
    jod_prior: JodPriorOption = "none",
    random_effects: RandomEffectsOption = "",
    lapses: LapsesOption = False,
    exclude: ExcludeOption = None,
    planned: PlannedOption = None,
    adaptive_pairs: AdaptiveOption = False,
    columns: ColumnsOption = None,
    choices: ChoicesOption = None,
    layout: FormatOption = "",
    encoding: EncodingOption = "",
    sheet: SheetOption = "",
    ratings: RatingsOption = None,
    scale: ScaleOption = None,
    width: WidthOption = "two",
    dry_run: DryRunOption = False,
    as_json: JsonOption = False,
) -> None:
    """Analyse any pair-comparison votes or ratings: scores, standard errors, figures and a report."""
    from app.analysis import AnalysisSettings, analyse_file, analyse_ratings_file
    from app.analysis.analyse_files import read_measures_of
    from app.analysis.drawing.charts_in_common import WIDTHS
    from app.analysis.ratings.reading import understand_ratings
    from app.analysis.reading.description import Told, pairs_of

    ends = _parse_scale(scale)
    _check_choice("--width", width, WIDTHS)
    _check_choice("--by", by, ("dataset", "none"))
    with wrong_use():
        mappings = pairs_of(columns or "", "--columns"), pairs_of(choices or "", "--choices")
    sources = _recognised(votes, Told(*mappings, format=layout, encoding=encoding, sheet=sheet), can_ask=not as_json)
    rated = _rated_source(context, sources)
    with wrong_use():
        settings = AnalysisSettings(
            ties=ties,
            order_effect=order_effect,
            bootstrap=bootstrap,
            seed=seed,
            equivalence_margin=equivalence,
            penalty=penalty,
            jod_prior=jod_prior,
            random_effects=random_effects,
            lapses=lapses,
            by_dataset=by == "dataset",
            exclude=tuple(exclude or ()),
            planned_participants=planned,
            adaptive_pairs=adaptive_pairs,
        )
    if out is None and not dry_run:
        raise typer.BadParameter("--out is missing: the folder for the results (or --dry-run, which writes nothing)")
    if ends and not rated and ratings is None:
        raise typer.BadParameter("--scale is for ratings, and the file holds votes; did you mean --ratings FILE?")
    if out is None or dry_run:
        beside_votes = {
            "items": items, "factors": factor, "measures": measures, "participants": participants, "groups": group,
        }  # fmt: skip
        understood = [] if rated else _understood_votes(sources, settings, beside_votes)
        if beside := rated or ratings:
            table, sentences = understand_ratings(beside, ends)
            understood += sentences
            if rated and measures:
                understood += _understood_measures(*read_measures_of(table, measures))
        print_result({"understood": understood}, "\n".join(understood), as_json=as_json)
        return
    if rated:
        analysis = analyse_ratings_file(rated, out, ends, exclude or (), width=WIDTHS[width], measures=measures)
        scores = _rating_sentences(analysis)
    else:
        analysis = analyse_file(
            sources,
            out,
            settings,
            items=items,
            factors=factor,
            measures=measures,
            participants=participants,
            groups=group,
            ratings=ratings,
            scale=ends,
            width=WIDTHS[width],
        )
        scores = score_sentences(analysis)
    print_result(analysis, f"{_found_sentences(analysis)}{scores}\nReport: {out / 'report.html'}", as_json=as_json)


MOST_SCORES = 40  # lines of scores in the terminal
MOST_NAMED = 8  # conditions that a dry run lists
OPTIONS_OF_RATINGS = (
    *("votes", "out", "measures", "scale", "exclude", "width", "dry_run", "as_json"),
    *("columns", "choices", "layout", "encoding", "sheet"),
)


def _recognised(paths: Sequence[Path], told: Told, *, can_ask: bool) -> list[Source]:
    """Read and recognise files; in a terminal, what can be read in several ways is asked."""
    from app.analysis.reading.description import QuestionError
    from app.analysis.reading.read_votes import recognise_file

    sources: list[Source] = []
    while len(sources) < len(paths):
        try:
            sources.append(recognise_file(paths[len(sources)], told))
        except QuestionError as question:
            if not (can_ask and sys.stdin.isatty() and sys.stderr.isatty()):
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


def _rated_source(context: typer.Context, sources: Sequence[Source]) -> Source | None:
    """Return the file of ratings; None for files of votes. Raise if ratings come with what is for votes."""
    rated = [source for source in sources if not source.holds_votes]
    if not rated:
        return None
    if len(sources) > 1:
        raise typer.BadParameter(f"{rated[0].path} holds ratings; analyse ratings one file at a time")
    _refuse_options_of_votes(context)
    return rated[0]


def _check_choice(option: str, given: str, expected: Iterable[str]) -> None:
    if given not in expected:
        raise typer.BadParameter(f"{option} is {given!r}, expected {' or '.join(expected)}")


def _refuse_options_of_votes(context: typer.Context) -> None:
    """Raise if an option was given that says nothing about ratings."""
    for parameter in context.command.params:
        source = context.get_parameter_source(str(parameter.name))
        if source is not None and source.name == "COMMANDLINE" and parameter.name not in OPTIONS_OF_RATINGS:
            raise typer.BadParameter(f"{parameter.opts[0]} is for votes, and the file holds ratings; leave it out")


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
    from app.analysis.reading.phrases import counted
    from app.analysis.reading.read_votes import understand_votes

    votes, sentences = understand_votes(sources)
    settings, notes = read_beside(votes, settings, **beside)
    used = used_votes(votes, settings)
    people = counted(len(votes.participants), "participant") if votes.has_participants else "unknown participants"
    datasets = counted(len(votes.datasets), "dataset") if votes.has_datasets else "no named dataset"
    return [
        *sentences,
        f"Together: {votes.n_votes} votes, of which {used.n_votes} count; {people}, {datasets}, "
        f"{len(votes.items)} conditions: {_few(votes.items)}",
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
    lines = [f"  {row['item']:<{width}}  {_with_interval(row, 'score', '+.3f')}" for row in listed]
    return "\n".join([*lines, f"  … and {more} more, in scores.csv"] if more > 0 else lines)


def _rating_sentences(analysis: Mapping[str, Any]) -> str:
    """List the mean opinion scores, or the scores of comparisons, over all datasets, a line each, best first."""
    if analysis.get("rating_conditions"):
        rows, name, form = list(analysis["rating_conditions"]), "mos", ".2f"
    else:
        datasets = [row["dataset"] for row in analysis["comparison_items"]]
        last = "all" if "all" in datasets else None
        rows = [row for row in analysis["comparison_items"] if last in (None, row["dataset"])]
        name, form = "score", "+.2f"
    rows.sort(key=lambda row: -row[name])
    width = max((len(row["condition"]) for row in rows), default=0)
    return "\n".join(f"  {row['condition']:<{width}}  {_with_interval(row, name, form)}" for row in rows)


def _with_interval(row: Mapping[str, Any], name: str, form: str) -> str:
    if row[name] is None:
        return f"no score ({row['status']})"
    interval = "" if row["ci_low"] is None else f"  95 % interval {row['ci_low']:{form}} to {row['ci_high']:{form}}"
    return f"{row[name]:{form}}{interval}"
