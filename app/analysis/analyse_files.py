"""Read files of votes or ratings, analyse them, and write tables, figures and a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.analysis.analyse import analyse, used_votes
from app.analysis.drawing.charts_in_common import FULL
from app.analysis.model.settings import AnalysisSettings
from app.analysis.ratings.alignment import align
from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.ratings.comparisons import analyse_comparisons
from app.analysis.ratings.content import NO_VOTES, with_measures, with_tables
from app.analysis.ratings.reading import understand_ratings
from app.analysis.ratings.score_sets import comparison_score_sets, opinion_score_sets
from app.analysis.ratings.table import ComparisonTable, RatingTable
from app.analysis.reading.attributes import MeasureValues, read_items, read_measures, read_participants
from app.analysis.reading.description import Told
from app.analysis.reading.phrases import counted
from app.analysis.reading.read_votes import understand_votes
from app.analysis.reading.sources import WARNING, Source, in_several
from app.analysis.reading.votes_table import ALL, VotesError, VotesTable
from app.analysis.report.figures import font_warnings
from app.analysis.report.write import refuse_to_replace, write_analysis

File = Path | str
MOST_NAMED = 5  # of what is not among the votes


def analyse_file(
    path: File | Source | Sequence[File | Source],
    out: File,
    settings: AnalysisSettings | None = None,
    *,
    items: File | None = None,
    columns: Mapping[str, str] | None = None,
    choices: Mapping[str, str] | None = None,
    factors: Sequence[str] | None = None,
    measures: File | None = None,
    participants: File | None = None,
    groups: Sequence[str] | None = None,
    ratings: File | None = None,
    scale: tuple[float, float] | None = None,
    width: int = FULL,
    told: Told | None = None,
) -> dict[str, Any]:
    """Read votes, analyse them, and write tables, figures and report to the folder `out`.

    Parameters
    ----------
    path : file of votes, or several, as `read_votes` takes them
    out : a folder, made if missing
    settings : how to analyse; `items` replaces its factors
    items : CSV with `item` and one column per factor
    columns, choices : our names -> those in the file, where they differ: {"participant": "judge"}, {"none": "tie"}
    factors : the factors to analyse out of those in `items`; all of them by default
    measures : CSV with objective measures, to be compared with the scores: the long table of `reconstudy validate`,
        or `dataset`, `item` and one column per measure
    participants : CSV with `participant` and one column per grouping, whose groups are compared
    groups : the groupings to compare out of those in `participants`; all of them by default
    ratings : CSV with ratings of the same items, to be put on one scale with the votes
    scale : ends of the ratings' scale; 1 and 5 by default
    width : of the figures, in pixels; `WIDTHS` has those of a journal's columns
    told : all that was said of the files of votes, instead of columns and choices

    Returns
    -------
    dict, the content of analysis.json

    Raises
    ------
    VotesError
        Naming the file, the row and the value, and if no vote counts: nothing is written then.
    ValueError
        For a factor that is not in `items`.
    """
    files = [path] if isinstance(path, Path | str | Source) else list(path)
    paths = [file.path if isinstance(file, Source) else Path(file) for file in files]
    refuse_to_replace([*paths, items, measures, participants, ratings], out)
    source = ", ".join(path.name for path in paths)
    votes, understood = understand_votes(files, told or Told(columns or {}, choices or {}))
    settings, notes = read_beside(
        votes, settings or AnalysisSettings(), items=items, factors=factors, measures=measures,
        participants=participants, groups=groups,
    )  # fmt: skip
    rated, excluded = None, settings.exclude
    if ratings is not None:
        table, how = _single_ratings(ratings, scale)
        understood += [*how, *in_several([votes.participants, table.participants])]
        rated = table.without(excluded)
        only_rated = set(table.participants).difference(votes.participants)
        settings = replace(settings, exclude=tuple(name for name in excluded if name not in only_rated))
    analysis = analyse(votes, settings) | {"understood": understood}
    analysis["settings"]["exclude"] = list(excluded)
    _refuse_nothing(analysis["votes"], source)
    analysis["warnings"] += [*notes, *warnings_in(understood)]
    if rated is not None:
        analysis = _with_ratings(analysis, rated, used_votes(votes, settings))
    analysis["warnings"] += font_warnings(analysis)
    write_analysis(analysis, out, source=source, width=width)
    return analysis


def warnings_in(sentences: Sequence[str]) -> list[str]:
    """Return the sentences on how files were understood that are warnings."""
    return [text.removeprefix(WARNING) for text in sentences if text.startswith(WARNING)]


def read_beside(
    votes: VotesTable,
    settings: AnalysisSettings,
    *,
    items: File | None = None,
    factors: Sequence[str] | None = None,
    measures: File | None = None,
    participants: File | None = None,
    groups: Sequence[str] | None = None,
) -> tuple[AnalysisSettings, list[str]]:
    """Read the files that may lie beside votes.

    Parameters
    ----------
    votes : whose datasets and items the measures are of
    settings : how to analyse
    items, factors, measures, participants, groups : as in `analyse_file`

    Returns
    -------
    the settings with their factors, groupings and measures; sentences on what of the measures was averaged or left out

    Raises
    ------
    ValueError
        As in `analyse_file`.
    """
    settings = _with_groups(_with_factors(settings, items, factors), participants, groups)
    if measures is None:
        return settings, []
    return _with_measures(settings, votes.datasets if votes.has_datasets else (), votes.items, measures)


def _with_factors(settings: AnalysisSettings, items: File | None, factors: Sequence[str] | None) -> AnalysisSettings:
    """Return the settings with the factors of a file of items, if there is one."""
    if items is None:
        if factors:
            raise ValueError(f"the factor {factors[0]!r} needs an items file that gives each item's level")
        return settings
    known = read_items(Path(items))
    _chosen(known, factors, "factor", items)
    return replace(settings, factors=known, analysed_factors=tuple(factors or known))


def _with_groups(
    settings: AnalysisSettings, participants: File | None, groups: Sequence[str] | None
) -> AnalysisSettings:
    """Return the settings with the groupings of a file of participants, if there is one."""
    if participants is None:
        if groups:
            raise ValueError(
                f"the grouping {groups[0]!r} needs a participants file that gives each participant's group"
            )
        return settings
    return replace(settings, groups=_chosen(read_participants(Path(participants)), groups, "grouping", participants))


def _with_measures(
    settings: AnalysisSettings, datasets: Sequence[str], items: Sequence[str], path: File, what: str = "votes"
) -> tuple[AnalysisSettings, list[str]]:
    """Return the settings with the measures of a file, and sentences on what was averaged or left out."""
    known = read_measures(Path(path))
    notes = _measure_notes(known, datasets, items, path, what)
    return replace(settings, measures=known.on(datasets or (ALL,)), better=known.better), notes


def _with_ratings(analysis: Mapping[str, Any], rated: RatingTable, votes: VotesTable) -> dict[str, Any]:
    """Return an analysis with what ratings of the same items say, on one scale with the votes."""
    result = with_tables(analysis, analyse_ratings(rated) | align(rated, votes))
    (shared,) = result["alignment"]
    if shared["status"] != "ok":
        result["warnings"].append(
            f"ratings and votes are not on one scale: {shared['status']} ({shared['n_shared']} items in common)"
        )
    if shared["left_out"]:
        result["warnings"].append(
            f"ratings and votes: {shared['left_out']} left out of the common scale, as nobody rated it and votes on it "
            "all go one way"
        )
    return result


def _refuse_nothing(votes: Mapping[str, Any], source: str) -> None:
    """Raise if no vote counts."""
    if not votes["analysed"]:
        raise VotesError(
            f"{source}: none of {counted(votes['votes'], 'vote')} counts: {votes['practice']} practice, "
            f"{votes['checks']} checks, {votes['excluded']} excluded; expected at least one other"
        )


def analyse_ratings_file(
    path: File | Source,
    out: File,
    scale: tuple[float, float] | None = None,
    exclude: Sequence[str] = (),
    *,
    width: int = FULL,
    measures: File | None = None,
    told: Told | None = None,
    planned: int | None = None,
) -> dict[str, Any]:
    """Read ratings, analyse them, and write tables, figures and report to the folder `out`.

    Parameters
    ----------
    path : ratings in any format that votes may have: of single items, or comparisons of two
    out : a folder, made if missing
    scale : ends of the scale; 1 and 5 by default, for comparisons -3 and 3
    exclude : participants left out
    width : of the figures, in pixels
    measures : CSV with objective measures, as in `analyse_file`, to be compared with the scores
    told : what was said of the file's columns and cells
    planned : number of participants; results of fewer are called interim

    Returns
    -------
    dict, the content of analysis.json

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    source = path
    path = source.path if isinstance(source, Source) else Path(source)
    refuse_to_replace([path, measures], out)
    table, understood = understand_ratings(source, scale, told)
    unknown = [name for name in exclude if name not in table.participants]
    if unknown:
        raise VotesError(
            f"{path}: the participant to exclude, {unknown[0]!r}, is not among the {len(table.participants)} who rated"
        )
    table = table.without(exclude)
    if not len(table):
        raise VotesError(f"{path}: no rating is left after the exclusions")
    empty = NO_VOTES | {
        "settings": {"exclude": list(exclude), "planned_participants": planned},
        "understood": understood,
    }
    tables = analyse_ratings(table) if isinstance(table, RatingTable) else analyse_comparisons(table)
    analysis = with_tables(empty, tables)
    if measures is not None:
        analysis = _with_measures_of(analysis, table, measures)
    analysis["warnings"] += [*warnings_in(understood), *font_warnings(analysis)]
    write_analysis(analysis, out, source=path.name, width=width)
    return analysis


def read_measures_of(table: RatingTable | ComparisonTable, path: File) -> tuple[AnalysisSettings, list[str]]:
    """Read objective measures of what was rated, as in `analyse_ratings_file`; returns the same as `read_beside`."""
    datasets = list(dict.fromkeys(dataset for dataset, _ in table.items))
    items = list(dict.fromkeys(condition for _, condition in table.items))
    return _with_measures(AnalysisSettings(), datasets, items, path, "ratings")


def _with_measures_of(analysis: Mapping[str, Any], table: RatingTable | ComparisonTable, path: File) -> dict[str, Any]:
    """Return an analysis of ratings with the comparison of a file's measures with their scores."""
    settings, notes = read_measures_of(table, path)
    if isinstance(table, RatingTable):
        result = with_measures(analysis, opinion_score_sets(table), settings)
    else:
        result = with_measures(analysis, comparison_score_sets(analysis["comparison_items"]), settings)
    return result | {"warnings": [*result["warnings"], *notes]}


def _single_ratings(path: File, scale: tuple[float, float] | None) -> tuple[RatingTable, list[str]]:
    table, understood = understand_ratings(path, scale)
    if isinstance(table, ComparisonTable):
        raise VotesError(f"{path}: compares items, expected ratings of single ones to put on one scale with the votes")
    return table, understood


def _measure_notes(
    measures: MeasureValues, datasets: Sequence[str], items: Sequence[str], path: File, what: str
) -> list[str]:
    """Return sentences on what was averaged or left out of measures; raise if no item is among those of the votes."""
    strangers = measures.strangers(datasets, items)
    more = f" and {len(strangers) - MOST_NAMED} more" if len(strangers) > MOST_NAMED else ""
    named = ", ".join(strangers[:MOST_NAMED]) + more
    n_places = len({(d, item) for by in measures.values.values() for d, row in by.items() for item in row})
    if len(strangers) == n_places:
        raise VotesError(
            f"{path}: measures {named or 'nothing'}; the {what} are on {', '.join(items[:MOST_NAMED])} … in "
            f"{', '.join(datasets[:MOST_NAMED]) or 'all (no dataset is named)'}; name datasets and items as they do"
        )
    left_out = [f"measures: {named} not among the {what} and left out"] if strangers else []
    return [*left_out, *(f"measures: {note}" for note in measures.notes)]


def _chosen(
    known: Mapping[str, dict[str, str]], names: Sequence[str] | None, what: str, path: File
) -> dict[str, dict[str, str]]:
    unknown = sorted(set(names or ()).difference(known))
    if unknown:
        raise ValueError(f"{path}: has no {what} {unknown[0]!r}; it has {', '.join(known)}")
    return {name: known[name] for name in names or known}
