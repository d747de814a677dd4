"""The whole analysis of a votes table, as the object that becomes analysis.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from app.analysis.agreement import agreement_rows
from app.analysis.bootstrap import Bootstrap, bootstrap_scores, participant_weights
from app.analysis.bradley_terry import Fit, fit_scores, only_compared
from app.analysis.contrasts import SIGNIFICANT, contrasts, holm, letters
from app.analysis.correlation import ScoreSet, correlation_rows
from app.analysis.factors import (
    Effect,
    ModelTest,
    check_factors,
    datasets_differ,
    effects_of,
    fit_additive,
    model_tests,
    order_test,
    votes_on_factor,
)
from app.analysis.observers import observer_rows
from app.analysis.settings import LEVEL, AnalysisSettings
from app.analysis.ties import TIE_MODELS
from app.analysis.triads import Triads, pooled_p_value, triads
from app.analysis.votes import NONE, A, B, VotesTable

Array = NDArray[np.float64]

ALL = "all"
LOG_ODDS_PER_JOD = float(
    np.log(3)
)  # one just-objectionable difference: preferred by 75 %, Perez-Ortiz and Mantiuk (2017)
MOST_PAIRS = 10_000  # of one comparison that are listed
MANY_REPEATS = 5  # repeated votes that are named one by one


@dataclass(frozen=True)
class Comparison:
    """A model fitted to the votes of one comparison (`all`, or a factor) and one dataset (or `all`)."""

    comparison: str
    dataset: str
    votes: VotesTable
    fit: Fit
    bootstrap: Bootstrap | None


def analyse(votes: VotesTable, settings: AnalysisSettings | None = None) -> dict[str, Any]:
    """Analyse votes: screening, scores, factors, agreement.

    Returns
    -------
    dict
        The content of analysis.json; only lists, dictionaries, text, numbers and None.

    Raises
    ------
    VotesError
        If an item has no level of a factor.
    """
    settings = settings or AnalysisSettings()
    used = _used(votes, settings)
    check_factors(used, settings.factors)
    compared = list(compare(used, settings))
    screened = triads(used)
    effects, tests = _factor_results(used, settings, compared)
    return {
        "schema_version": 1,
        "settings": settings.as_dict(),
        "votes": _tally(votes, used),
        "scores": [row for one in compared for row in _score_rows(one)],
        "scores_with_excluded": _scores_with_excluded(votes, used, settings),
        "models": [_model_row(one) for one in compared],
        "tie_models": [row for one in compared for row in _tie_model_rows(one, settings)],
        "contrasts": [row for one in compared for row in _contrast_rows(one)],
        "effects": effects,
        "tests": tests,
        "triads": [_triads_row(row) for row in screened],
        "triads_pooled": _pooled_triads(screened),
        "measures": _measure_rows(compared, settings),
        "agreement": agreement_rows(used),
        "observers": observer_rows(used, screened, ties=settings.ties),
        "pairs": [row for one in compared if len(one.fit.counts.first) <= MOST_PAIRS for row in _pair_rows(one)],
        "warnings": _warnings(votes, used, compared),
    }


def compare(votes: VotesTable, settings: AnalysisSettings) -> Iterator[Comparison]:
    """Fit every comparison and dataset in turn; the replicates of a participant bootstrap are the same draws for all
    of them.
    """
    weights = None
    if settings.bootstrap and votes.has_participants and len(votes):
        rng = np.random.default_rng(settings.seed)
        present, who = np.unique(votes.participant, return_inverse=True)
        names = tuple(votes.participants[index] for index in present)
        votes = replace(votes, participants=names, participant=who.astype(np.int32))
        weights = participant_weights(len(present), settings.bootstrap, rng)
    for comparison in (ALL, *settings.comparisons):
        chosen = votes if comparison == ALL else votes_on_factor(votes, settings.factors, comparison)
        for dataset in _datasets(votes, settings):
            part = _of_dataset(chosen, dataset)
            if len(part):
                yield _compare(comparison, dataset, only_compared(part), settings, weights)


def _factor_results(
    votes: VotesTable, settings: AnalysisSettings, compared: Sequence[Comparison]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the additive model's effects, and all tests between models."""
    effects: list[Effect] = []
    tests: list[ModelTest | None] = []
    additive: dict[str, Fit] = {}
    for dataset in _datasets(votes, settings) if settings.factors else ():
        part = only_compared(_of_dataset(votes, dataset))
        fit = fit_additive(part, settings.factors, ties=settings.ties, order_effect=settings.order_effect)
        if fit is not None and fit.status == "ok":
            additive[dataset] = fit
            if settings.order_effect:
                without = fit_additive(part, settings.factors, ties=settings.ties, order_effect=False)
                tests.append(None if without is None else order_test(fit, without, "additive", dataset))
            effects += effects_of(fit, settings.factors, dataset)
            tests += model_tests(
                part, settings.factors, dataset, ties=settings.ties, order_effect=settings.order_effect
            )
    for one in compared if settings.order_effect else ():
        without = fit_scores(one.votes, ties=settings.ties)
        tests.append(order_test(one.fit, without, one.comparison, one.dataset))
    for model in dict.fromkeys(one.comparison for one in compared):
        tests.append(_datasets_test(model, {one.dataset: one.fit for one in compared if one.comparison == model}))
    tests.append(_datasets_test("additive", additive))
    return [_effect_row(effect) for effect in effects], _test_rows([test for test in tests if test is not None])


def _measure_rows(compared: Sequence[Comparison], settings: AnalysisSettings) -> list[dict[str, Any]]:
    if not settings.measures:
        return []
    of_items = [one for one in compared if one.comparison == ALL and one.fit.scores is not None]
    single = [one for one in of_items if one.dataset != ALL] or of_items
    return correlation_rows(
        {one.dataset: _score_set(one) for one in single}, settings.measures, np.random.default_rng([settings.seed, 1])
    )


def _score_set(one: Comparison) -> ScoreSet:
    fit = one.fit
    assert fit.scores is not None
    place = {item: index for index, item in enumerate(fit.items)}
    different = [
        (place[c.item_a], place[c.item_b]) if c.difference > 0 else (place[c.item_b], place[c.item_a])
        for c in contrasts(fit)
        if c.p_holm < SIGNIFICANT
    ]
    replicates = np.zeros((0, len(fit.items)))
    if one.bootstrap is not None:
        replicates = np.full((len(one.bootstrap.kept), len(fit.items)), np.nan)
        replicates[one.bootstrap.kept] = one.bootstrap.scores
    return ScoreSet(fit.items, fit.scores, replicates, different)


def _datasets_test(model: str, fits: dict[str, Fit]) -> ModelTest | None:
    separate = [fit for dataset, fit in fits.items() if dataset != ALL]
    return datasets_differ(model, fits[ALL], separate) if ALL in fits else None


def _effect_row(effect: Effect) -> dict[str, Any]:
    if effect.se_participant is None or effect.n_participants is None:
        half = float(norm.ppf((1 + LEVEL) / 2)) * effect.se
    else:
        half = float(student.ppf((1 + LEVEL) / 2, effect.n_participants - 1)) * effect.se_participant
    return asdict(effect) | {"ci_low": effect.effect - half, "ci_high": effect.effect + half}


def _test_rows(tests: Sequence[ModelTest]) -> list[dict[str, Any]]:
    """Return the tests with Holm's correction over each family: one kind of test, on the single datasets or on all
    together.
    """
    families: dict[tuple[str, bool], list[ModelTest]] = {}
    for test in tests:
        families.setdefault((test.name.split()[0], test.dataset == ALL), []).append(test)
    rows = []
    for family in families.values():
        own = [test.p_value if test.p_participant is None else test.p_participant for test in family]
        for test, corrected in zip(family, holm(np.array(own)).tolist(), strict=True):
            rows.append(asdict(test) | {"p_holm": corrected})
    return rows


def _scores_with_excluded(votes: VotesTable, used: VotesTable, settings: AnalysisSettings) -> list[dict[str, Any]]:
    """Return the scores as they would be without any exclusion; empty if nothing was excluded."""
    everybody = replace(votes, excluded=np.zeros(len(votes), bool)).used()
    if len(everybody) == len(used):
        return []
    plain = replace(settings, bootstrap=0)
    return [row for one in compare(everybody, plain) for row in _score_rows(one)]


def _of_dataset(votes: VotesTable, dataset: str) -> VotesTable:
    return votes if dataset == ALL else votes.where(votes.dataset == votes.datasets.index(dataset))


def _datasets(votes: VotesTable, settings: AnalysisSettings) -> tuple[str, ...]:
    return (*(votes.datasets if settings.by_dataset and votes.has_datasets else ()), ALL)


def _compare(
    comparison: str, dataset: str, votes: VotesTable, settings: AnalysisSettings, weights: Array | None
) -> Comparison:
    fit = fit_scores(votes, ties=settings.ties, order_effect=settings.order_effect)
    has_sample = weights is not None and fit.status == "ok" and (fit.n_participants or 0) > 1
    bootstrap = bootstrap_scores(fit, votes, weights) if has_sample and weights is not None else None
    return Comparison(comparison, dataset, votes, fit, bootstrap)


def _used(votes: VotesTable, settings: AnalysisSettings) -> VotesTable:
    unknown = set(settings.exclude).difference(votes.participants)
    if unknown:
        raise ValueError(
            f"the participant to exclude, {sorted(unknown)[0]!r}, is not among the {len(votes.participants)} who voted"
        )
    excluded = np.isin(np.array(votes.participants, object), list(settings.exclude))[votes.participant]
    return replace(votes, excluded=votes.excluded | excluded).used()


def _tally(votes: VotesTable, used: VotesTable) -> dict[str, Any]:
    """Count what was read and what became of it; the parts add up to the whole."""
    practice = int(votes.count[votes.practice].sum())
    total, analysed = votes.n_votes, used.n_votes
    return {
        "rows": len(votes),
        "votes": total,
        "practice": practice,
        "excluded": total - practice - analysed,
        "analysed": analysed,
        "participants": len(np.unique(used.participant)) if votes.has_participants else None,
        "datasets": list(votes.datasets) if votes.has_datasets else [],
        "items": list(votes.items),
        "ties": int(used.count[used.choice == 2].sum()),
    }


def _score_rows(one: Comparison) -> Iterator[dict[str, Any]]:
    fit, n = one.fit, len(one.fit.items)
    wins, losses, ties = _outcomes(one.votes)
    low, high, method = intervals(fit, one.bootstrap)
    shown = _letters(fit)
    for index, item in enumerate(fit.items):
        score = None if fit.scores is None else float(fit.scores[index])
        yield {
            "comparison": one.comparison,
            "dataset": one.dataset,
            "item": item,
            "score": score,
            "se": fit.error(index),
            "se_participant": fit.error(index, by_participant=True),
            "ci_low": None if low is None else float(low[index]),
            "ci_high": None if high is None else float(high[index]),
            "ci_method": method,
            "jod": None if score is None else score / LOG_ODDS_PER_JOD,
            "win_probability": None if fit.scores is None else _win_probability(fit.scores, index) if n > 1 else None,
            "n_votes": wins[index] + losses[index] + ties[index],
            "wins": wins[index],
            "losses": losses[index],
            "ties": ties[index],
            "status": fit.status,
            "penalty": fit.penalty,
            "letters": shown.get(item),
        }


def _letters(fit: Fit) -> dict[str, str]:
    found = contrasts(fit)
    if not found or fit.scores is None:
        return {}
    best_first = [fit.items[index] for index in np.argsort(-fit.scores)]
    return letters(best_first, found)


def _contrast_rows(one: Comparison) -> Iterator[dict[str, Any]]:
    for contrast in contrasts(one.fit):
        yield {"comparison": one.comparison, "dataset": one.dataset} | asdict(contrast)


def _tie_model_rows(one: Comparison, settings: AnalysisSettings) -> Iterator[dict[str, Any]]:
    """The log-likelihoods of all ways of treating ties, side by side; only Davidson's and Rao and Kupper's compare."""
    if one.comparison != ALL or not (one.votes.choice == NONE).any():
        return
    for ties, model in TIE_MODELS.items():
        fit = one.fit if ties == one.fit.ties else fit_scores(one.votes, ties=ties, order_effect=settings.order_effect)
        yield {
            "dataset": one.dataset,
            "ties": ties,
            "parameter": model.parameter,
            "value": fit.tie_parameter,
            "loglik": fit.loglik,
            "deviance": fit.deviance,
            "df": fit.df,
            "status": fit.status,
        }


def intervals(fit: Fit, bootstrap: Bootstrap | None) -> tuple[Array | None, Array | None, str | None]:
    """Return the limits of the scores' 95 % intervals and how they were made.

    Percentiles of the participant bootstrap if there is one; else t(J - 1) on the errors clustered by participant;
    else, without participants, the normal distribution on the errors from the information.
    """
    if fit.scores is None or fit.covariance is None:
        return None, None, None
    if bootstrap is not None and len(bootstrap.scores):
        low, high = bootstrap.interval(LEVEL)
        return low, high, "participant bootstrap"
    n = len(fit.items)
    if fit.participant_covariance is not None and fit.n_participants is not None:
        half = student.ppf((1 + LEVEL) / 2, fit.n_participants - 1) * np.sqrt(np.diag(fit.participant_covariance)[:n])
        return fit.scores - half, fit.scores + half, "t on participant errors"
    half = norm.ppf((1 + LEVEL) / 2) * np.sqrt(np.diag(fit.covariance)[:n])
    return fit.scores - half, fit.scores + half, "normal on information"


def _win_probability(scores: Array, index: int) -> float:
    """Return the probability that the item is preferred to another one taken at random, ties apart."""
    others = np.delete(scores, index)
    return float(np.mean(1 / (1 + np.exp(others - scores[index]))))


def _outcomes(votes: VotesTable) -> tuple[list[int], list[int], list[int]]:
    """Return wins, losses and ties of each item."""
    n = len(votes.items)
    winner = np.where(votes.choice == A, votes.item_a, votes.item_b)
    loser = np.where(votes.choice == A, votes.item_b, votes.item_a)
    decided = votes.choice <= B
    tied = ~decided
    wins = np.bincount(winner[decided], votes.count[decided], n)
    losses = np.bincount(loser[decided], votes.count[decided], n)
    ties = np.bincount(votes.item_a[tied], votes.count[tied], n) + np.bincount(votes.item_b[tied], votes.count[tied], n)
    return wins.astype(int).tolist(), losses.astype(int).tolist(), ties.astype(int).tolist()


def _model_row(one: Comparison) -> dict[str, Any]:
    fit = one.fit
    parameter = TIE_MODELS[fit.ties].parameter
    row: dict[str, Any] = {"comparison": one.comparison, "dataset": one.dataset, "ties": fit.ties}
    if parameter:
        has_error = fit.design.has_tie and fit.tie_parameter is not None
        row[parameter] = fit.tie_parameter
        row[f"{parameter}_se"] = fit.error(-1) if has_error else None
        row[f"{parameter}_se_participant"] = fit.error(-1, by_participant=True) if has_error else None
    order = fit.design.n_effects
    has_order = fit.design.has_order and fit.theta is not None
    return row | {
        "order_effect": fit.order_effect,
        "order_se": fit.error(order) if has_order else None,
        "order_se_participant": fit.error(order, by_participant=True) if has_order else None,
        "loglik": fit.loglik,
        "deviance": fit.deviance,
        "pearson_x2": fit.pearson_x2,
        "df": fit.df,
        "p_value": fit.p_value,
        "converged": fit.status == "ok",
        "iterations": fit.iterations,
        "status": fit.status,
        "groups": [list(group) for group in fit.groups],
        "penalty": fit.penalty,
        "n_votes": one.votes.n_votes,
        "n_participants": fit.n_participants,
        "bootstrap_replicates": None if one.bootstrap is None else len(one.bootstrap.scores),
        "bootstrap_without_maximum": None if one.bootstrap is None else one.bootstrap.n_without_maximum,
    }


def _pair_rows(one: Comparison) -> Iterator[dict[str, Any]]:
    """Observed and expected votes on every pair, for the preference matrix and the residuals."""
    fit = one.fit
    nothing: list[list[float | None]] = [[None] * 3] * len(fit.counts.first)
    expected = nothing if fit.expected is None else fit.expected.T.tolist()
    columns = fit.counts.first, fit.counts.second, fit.counts.wins, fit.counts.losses, fit.counts.ties
    for first, second, wins, losses, ties, (as_win, as_loss, as_tie) in zip(*columns, expected, strict=True):
        yield {
            "comparison": one.comparison,
            "dataset": one.dataset,
            "item_a": fit.items[first],
            "item_b": fit.items[second],
            "a": float(wins),
            "b": float(losses),
            "none": float(ties),
            "expected_a": as_win,
            "expected_b": as_loss,
            "expected_none": as_tie,
        }


def _triads_row(row: Triads) -> dict[str, Any]:
    named = asdict(row)
    return {
        "participant": named["participant"],
        "dataset": named["dataset"],
        "n_items": named["n_items"],
        "complete": named["complete"],
        "circular": named["circular"],
        "circular_expected_ties": named["expected_ties"],
        "circular_max": named["maximum"],
        "zeta": named["zeta"],
        "p_value": named["p_value"],
    }


def _pooled_triads(rows: list[Triads]) -> list[dict[str, Any]]:
    by_participant: dict[str, list[Triads]] = {}
    for row in rows:
        by_participant.setdefault(row.participant, []).append(row)
    return [
        {
            "participant": participant,
            "n_datasets": len(own),
            "circular": sum(row.circular for row in own),
            "circular_expected_ties": sum(row.expected_ties for row in own),
            "p_value": pooled_p_value(own),
        }
        for participant, own in by_participant.items()
    ]


def _warnings(votes: VotesTable, used: VotesTable, compared: list[Comparison]) -> list[str]:
    warnings = [] if len(used) else ["No vote is left after practice and exclusions: there is nothing to analyse."]
    warnings += _repeats(votes)
    for one in compared:
        warnings += _fit_warnings(one)
    return warnings


def _fit_warnings(one: Comparison) -> Iterator[str]:
    fit, where = one.fit, f"comparison {one.comparison}, dataset {one.dataset}"
    if fit.status == "disconnected" and len(fit.groups) > 1:
        islands = "; ".join(", ".join(group) for group in fit.groups)
        yield f"{where}: disconnected, no vote links these groups, so no scores exist on one scale: {islands}"
    if fit.status == "separated" and len(fit.groups) > 1:
        order = " > ".join("{" + ", ".join(group) + "}" for group in fit.groups)
        yield (
            f"{where}: no finite maximum, the votes between these groups all go one way: {order}; "
            f"scores are the {fit.penalty} estimate"
        )
    if fit.status == "separated" and len(fit.groups) == 1:
        yield (
            f"{where}: no finite maximum, the tie parameter grows without limit; scores are the {fit.penalty} estimate"
        )
    if fit.status == "disconnected" and len(fit.groups) == 1:
        yield f"{where}: the votes cannot tell the scores and the other effects apart, so there are none"
    if len(fit.counts.first) > MOST_PAIRS:
        yield f"{where}: {len(fit.counts.first)} pairs are analysed and not listed"
    if fit.theta is not None and fit.covariance is None:
        yield f"{where}: no errors are given for as many as {len(fit.items)} items"
    if fit.n_participants == 1:
        yield f"{where}: a single participant voted, so nothing can be said about other people"
    if one.bootstrap is not None and one.bootstrap.n_without_maximum:
        total = len(one.bootstrap.scores) + one.bootstrap.n_without_maximum
        missing = one.bootstrap.n_without_maximum
        yield f"{where}: {missing} of {total} bootstrap replicates have no maximum and are left out"


def _repeats(votes: VotesTable) -> list[str]:
    """Name the rows in which a participant votes on a pair a second time; they are kept."""
    if not votes.has_participants:
        return []
    low, high = np.minimum(votes.item_a, votes.item_b), np.maximum(votes.item_a, votes.item_b)
    n = np.int64(len(votes.items))
    key = (votes.participant.astype(np.int64) * len(votes.datasets) + votes.dataset) * n * n + low * n + high
    key = np.where(votes.practice | votes.excluded, -1 - np.arange(len(key)), key)
    _, first = np.unique(key, return_index=True)
    rows = np.setdiff1d(np.arange(len(key)), first)
    named = [
        f"row {row + 1} ({votes.participants[votes.participant[row]]}, "
        f"{votes.datasets[votes.dataset[row]] or 'no dataset'}, "
        f"{votes.items[votes.item_a[row]]} - {votes.items[votes.item_b[row]]})"
        for row in rows[:MANY_REPEATS]
    ]
    if not named:
        return []
    more = f" and {len(rows) - len(named)} more" if len(rows) > len(named) else ""
    what = f"{len(rows)} votes repeat a pair that the same participant judged before; all are counted"
    return [f"{what}: {', '.join(named)}{more}"]
