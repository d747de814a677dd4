"""Say which condition is best and worst, and which conditions the votes tell apart."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from app.analysis.findings.pairs import contrast_between
from app.analysis.model.contrasts import FEWEST_PARTICIPANTS, MOST_ITEMS, SIGNIFICANT
from app.analysis.reading.phrases import (
    counted,
    finding,
    interval,
    listed,
    number_with_interval,
    p_phrase,
    percent,
    signed,
    span,
)
from app.analysis.reading.votes_table import ALL

Row = Mapping[str, Any]

MOST_IN_GROUPS = 12  # conditions whose groups a sentence can name; the table has the letters of more
SMALL, LARGE = 0.634, 0.75  # shares of decided votes: half a JOD, and one
LIKELY = 0.05  # probability to be the best, from which on a sentence names a condition
FEWEST_FOR_RANKS = 8  # participants; with fewer the probability to be the best was not simulated (docs/simulation.md)
BOLD = " With so few people the largest of these is about 10 points too high where conditions hardly differ."
EQUAL = 1e-9  # log-odds; scores that differ by less are the same
LETTER = re.compile(r"\w\.*")


class Condition(NamedTuple):
    """A condition with its value and interval in words, and its letters."""

    name: str
    value: str
    letters: str | None


def overall(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of all conditions on all datasets together."""
    return [row for row in rows if row["comparison"] == row["dataset"] == ALL]


def ranking_findings(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Yield what the scores over all datasets say about the conditions."""
    scored = sorted(
        (row for row in overall(analysis["scores"]) if row["score"] is not None), key=lambda row: -row["score"]
    )
    model = overall(analysis["models"])[0]
    if not scored:
        yield finding("ranking", _why_no_scores(model))
        yield from _within_islands(analysis)
    elif scored[0]["score"] - scored[-1]["score"] < EQUAL:
        yield finding("ranking", f"{both_or_all(len(scored))} have the same score: the votes prefer none of them.")
    else:
        yield from _best_and_worst(analysis, scored, model)
    yield from _never_judged(analysis)


def _within_islands(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Say what the votes show within each group of conditions that no vote links to the others."""
    contrasts = overall(analysis["island_contrasts"])
    for number in dict.fromkeys(row["group"] for row in overall(analysis["island_scores"])):
        scored = [row for row in overall(analysis["island_scores"]) if row["group"] == number]
        scored = sorted((row for row in scored if row["score"] is not None), key=lambda row: -row["score"])
        pairs = [row for row in contrasts if row["group"] == number]
        if len(scored) > 1:
            best, worst = (
                f"{row['item']}, {number_with_interval(row, 'score', show=signed)}" for row in (scored[0], scored[-1])
            )
            n_differ = sum(row["p_holm"] < SIGNIFICANT for row in pairs)
            tested = f"; {n_differ} of {pairs_differ(len(pairs), n_differ)} (Holm)" if pairs else ""
            names = listed([row["item"] for row in scored])
            is_flat = scored[0]["score"] - scored[-1]["score"] < EQUAL
            ends = "all have the same score" if is_flat else f"highest {best}, lowest {worst}{tested}"
            yield finding("ranking", f"Within {{{names}}}: {ends}.")


def both_or_all(n: int) -> str:
    """Return "Both conditions", or "All 3 conditions"."""
    return "Both conditions" if n == 2 else f"All {n} conditions"


def _why_no_scores(model: Row) -> str:
    groups = model["groups"]
    named = "; ".join("{" + listed(group) + "}" for group in groups[:5])
    more = f" and {len(groups) - 5} more groups" if len(groups) > 5 else ""
    return (
        f"No vote links these groups of conditions: {named}{more}. So there is no ranking of all conditions; "
        "compare them only within a group."
    )


def _best_and_worst(analysis: Mapping[str, Any], scored: Sequence[Row], model: Row) -> Iterator[dict[str, str]]:
    contrasts = overall(analysis["contrasts"])
    conditions = [
        Condition(row["item"], number_with_interval(row, "score", show=signed), row["letters"]) for row in scored
    ]
    if not contrasts:
        yield untested_ranking(conditions, "score", _why_not_tested(analysis, scored))
        return
    if model["status"] == "separated":
        yield finding("ranking", _separated(analysis, model))
    yield from tested_ranking(
        conditions,
        contrasts,
        "score",
        _difference(scored[0]["item"], scored[-1]["item"], analysis, model),
        where=_among_several(analysis),
        beyond=_over_datasets(contrasts),
    )
    people = analysis["votes"]["participants"]
    if len(scored) > 2 and scored[0]["p_best"] is not None and (people is None or people >= FEWEST_FOR_RANKS):
        differ = any(row["p_holm"] < SIGNIFICANT for row in contrasts)
        is_bold = people is not None and people < FEWEST_PARTICIPANTS and not differ
        yield finding("ranks", _ranks(scored, _among_several(analysis)) + (BOLD if is_bold else ""))
    margin = analysis["settings"]["equivalence_margin"]
    if margin is not None:
        yield finding("equivalent", _equivalent(contrasts, margin))


def _ranks(scored: Sequence[Row], where: str) -> str:
    """Say how probable it is that each condition is the best, and which ranks the tests leave open."""
    likely = sorted((row for row in scored if row["p_best"] >= LIKELY), key=lambda row: -row["p_best"])
    named = [f"{row['item']} ({percent(row['p_best'])})" for row in likely]
    rest = f"; each other less than {percent(LIKELY)}" if len(likely) < len(scored) else ""
    text = (
        f"Probability to have the highest true score{where}, by these votes alone: {listed(named, len(named))}{rest}."
    )
    ranks: dict[tuple[int, int], list[str]] = {}
    for row in scored:
        ranks.setdefault((row["rank_low"], row["rank_high"]), []).append(row["item"])
    if len(ranks) == 1 or len(scored) > MOST_IN_GROUPS:
        return text
    places = [
        f"{listed(items, len(items))}: {low if low == high else f'{low} to {high}'}"
        for (low, high), items in ranks.items()
    ]
    return f"{text} Possible ranks, together with at least 95 % confidence: {'; '.join(places)}."


def _equivalent(contrasts: Sequence[Row], margin: float) -> str:
    """Say which pairs are shown to differ by less than the margin."""
    alike = [
        row for row in contrasts if row["p_equivalent_holm"] is not None and row["p_equivalent_holm"] < SIGNIFICANT
    ]
    method = f"difference below {margin:g} JOD, two one-sided tests, 5 % level, Holm, which is cautious"
    if not alike:
        return f"No pair of conditions is shown to be equivalent ({method})."
    pairs = [f"{row['item_a']} with {row['item_b']}" for row in alike]
    return f"Equivalent: {listed(pairs)} ({method})."


def _separated(analysis: Mapping[str, Any], model: Row) -> str:
    """Say what the votes leave open, and what the tests rest on instead."""
    units = "votes" if analysis["votes"]["participants"] is None else "participants"
    return (
        f"Some differences have no finite estimate: {_one_way(model)}. The scores shown are penalised ones; where all "
        f"votes of a pair go one way, it has an exact sign test over {units} and a one-sided limit. The others are "
        "compared by the scores of their group."
    )


def _one_way(model: Row) -> str:
    if len(model["groups"]) > 1:
        order = " over ".join("{" + listed(group) + "}" for group in model["groups"][:5])
        return f"no vote, or only votes without preference, went against the order {order}"
    return "the share of votes without preference has no finite estimate"


def untested_ranking(conditions: Sequence[Condition], score: str, why: str) -> dict[str, str]:
    """Return the sentence on highest and lowest where differences have no test.

    Parameters
    ----------
    conditions : the best first
    score : what the values are called
    why : there is no test
    """
    best, worst = conditions[0], conditions[-1]
    if best.value == worst.value:
        ends = f"All conditions have the {score} {best.value}"
    else:
        ends = f"{best.name} has the highest {score}, {best.value}, and {worst.name} the lowest, {worst.value}"
    return finding("ranking", f"{ends}. Whether conditions differ was not tested: {why}.")


def here(analysis: Mapping[str, Any]) -> str:
    """Say which datasets a sentence holds for; empty where datasets have no names."""
    n = len(analysis["votes"]["datasets"])
    return f" on these {n} datasets" if n > 1 else " on this dataset" if n else ""


def _among_several(analysis: Mapping[str, Any]) -> str:
    return here(analysis) if len(analysis["votes"]["datasets"]) > 1 else ""


def counted_votes(analysis: Mapping[str, Any], first: str, second: str, comparison: str = ALL) -> str:
    """Return how many decided votes of a pair, over all datasets, are for the first item: "27 of 29 decided votes".

    It is empty where no vote compares them.

    Parameters
    ----------
    analysis : the content of analysis.json
    first, second : the conditions, or levels of a factor
    comparison : the factor; `all` for conditions
    """
    votes = {first: 0.0, second: 0.0}
    for row in analysis["pairs"]:  # in both orders where the model has an order effect
        is_whole = (row["comparison"], row["dataset"]) == (comparison, ALL)
        if is_whole and {row["item_a"], row["item_b"]} == {first, second}:
            votes[row["item_a"]] += row["a"]
            votes[row["item_b"]] += row["b"]
    decided = sum(votes.values())
    return f"{votes[first]:.0f} of {decided:.0f} decided votes" if decided else ""


def _over_datasets(contrasts: Sequence[Row]) -> str:
    """Say how many pairs differ for datasets like these; empty where that is not known."""
    known = [row["p_datasets_holm"] for row in contrasts if row["p_datasets_holm"] is not None]
    if not known:
        return ""
    n_differ = sum(p < SIGNIFICANT for p in known)
    differ = pairs_differ(len(known), n_differ)
    return f" For datasets like these, as a sample, {n_differ} of {differ} (Holm, a cautious test with few datasets)."


def pairs_differ(n: int, n_differ: int) -> str:
    """Return "15 pairs differ", or "15 pairs differs" where that is one of them, or there is one."""
    return f"{counted(n, 'pair')} {'differs' if 1 in (n, n_differ) else 'differ'}"


def tested_ranking(
    conditions: Sequence[Condition],
    contrasts: Sequence[Row],
    score: str,
    difference: str,
    *,
    where: str,
    beyond: str,
) -> Iterator[dict[str, str]]:
    """Yield the best, the worst, the difference between them, and which conditions are told apart.

    Parameters
    ----------
    conditions : the best first
    contrasts : of all pairs, with `item_a`, `item_b` and `p_holm`
    score : what the values are called
    difference : a sentence on the best and the worst, used if any pair differs
    where : the datasets that the tests hold for
    beyond : a sentence on other datasets
    """
    differing = [row for row in contrasts if row["p_holm"] < SIGNIFICANT]
    if differing:
        yield finding("best", _placed(conditions[0], contrasts, "best", f"highest {score}", where))
        yield finding("worst", _placed(conditions[-1], contrasts, "worst", f"lowest {score}", where))
        yield finding("difference", difference)
    yield finding("told apart", _told_apart(conditions, contrasts, differing, score, where) + beyond)


def _why_not_tested(analysis: Mapping[str, Any], scored: Sequence[Row]) -> str:
    if analysis["votes"]["participants"] == 1:
        return "a single participant voted, which says nothing about other people"
    if len(scored) > MOST_ITEMS:
        return f"{len(scored)} conditions have too many pairs"
    n = analysis["votes"]["participants"]
    return f"{n} participants are too few, or vote too much alike, to know how much other people would differ"


def _placed(condition: Condition, contrasts: Sequence[Row], place: str, score: str, where: str) -> str:
    """Say that a condition is best or worst, from which others it is not told apart, or which of them pass it.

    Where conditions are on different datasets, the highest mean may be lower on those that two have in common.
    """
    against = [pair for pair in contrasts if condition.name in (pair["item_a"], pair["item_b"])]
    alike = [_other(pair, condition.name) for pair in against if pair["p_holm"] >= SIGNIFICANT]
    beyond = [_other(pair, condition.name) for pair in against if _passes(pair, condition.name, place)]
    if beyond:
        verb, side = "is" if len(beyond) == 1 else "are", "higher" if place == "best" else "lower"
        return (
            f"{condition.name} has the {score}, {condition.value}, but {listed(beyond)} {verb} {side} where the same "
            "people judged both."
        )
    if alike:
        return f"{condition.name} has the {score}, {condition.value}, but is not told apart from {listed(alike)}."
    others = "the other condition" if len(against) == 1 else "every other condition"
    return f"{condition.name} is {place}: it has the {score}, {condition.value}, and differs from {others}{where}."


def _passes(pair: Row, item: str, place: str) -> bool:
    """Is the other condition of a pair better than the best, or worse than the worst?"""
    above = pair["difference"] if pair["item_a"] == item else -pair["difference"]
    return bool(pair["p_holm"] < SIGNIFICANT and (above < 0 if place == "best" else above > 0))


def _other(pair: Row, item: str) -> str:
    return str(pair["item_b"] if pair["item_a"] == item else pair["item_a"])


def _difference(best: str, worst: str, analysis: Mapping[str, Any], model: Row) -> str:
    """Say how much the best condition is preferred to the worst: what was counted, then what the model predicts."""
    pair = contrast_between(overall(analysis["contrasts"]), best, worst)
    counts, where = counted_votes(analysis, best, worst), _among_several(analysis)
    votes = (
        f"Of {best} and {worst}, {best} is preferred in {counts};"
        if counts
        else f"No vote compares {best} and {worst}; for {best}"
    )
    assert pair is not None
    log_theta = model.get("log_theta") or 0.0
    if pair["ci_simultaneous_low"] is None or pair["ci_simultaneous_high"] is None:
        return _open_difference(pair, log_theta)
    ends = ("ci_simultaneous_low", "ci_simultaneous_high")
    share, low, high = (percent(preferred_share(pair[name], log_theta)) for name in ("difference", *ends))
    return (
        f"{votes} the model predicts {share} ({interval(low, high)}{_cautious(analysis)}), "
        f"{size_of(preferred_share(pair['difference'], log_theta))}, "
        f"{p_phrase(pair['p_holm'])} (Holm{',' if where else ''}{where}){_doubt(pair)}{of_few(analysis, 'difference')}."
    )


def _cautious(analysis: Mapping[str, Any]) -> str:
    """Say what the interval of the extreme pair is, which of a single pair holds more often (docs/simulation.md)."""
    several = len(overall(analysis["contrasts"])) > 1
    return ", simultaneous over all pairs and so cautious for one" if several else ""


def of_few(analysis: Mapping[str, Any], what: str) -> str:
    """Say that what few people show is larger than it is, for which no interval allows (docs/simulation.md)."""
    people = analysis["votes"]["participants"]
    is_few = people is not None and 1 < people < FEWEST_PARTICIPANTS
    return f"; with so few people, a small {what} that is found looks larger than it is" if is_few else ""


def size_of(share: float) -> str:
    """Say how large a difference is by the share of decided votes for the better condition.

    Half a JOD, which is 63 %, and one JOD, which is 75 %, are the bounds.
    """
    return "a small difference" if share < SMALL else "a moderate difference" if share < LARGE else "a large difference"


def _open_difference(pair: Row, log_theta: float) -> str:
    """Say how much the first condition is preferred at least, where all votes go one way."""
    best, worst = pair["item_a"], pair["item_b"]
    if pair["ci_low"] is None:
        return f"How much {best} is preferred to {worst} has no estimate and no limit ({pair['method']})."
    share = percent(preferred_share(pair["ci_low"], log_theta))
    return (
        f"Of {best} and {worst}, every decided vote prefers {best}: its share is at least {share} (one-sided 95 % "
        f"limit), {p_phrase(pair['p_holm'])} ({pair['method']}, Holm){_doubt(pair)}."
    )


def _doubt(pair: Row) -> str:
    if pair["p_holm"] >= SIGNIFICANT:
        return ", which chance can explain"
    over = pair["p_datasets_holm"]
    return ", but not shown for datasets like these" if over is not None and over >= SIGNIFICANT else ""


def preferred_share(difference: float, log_theta: float) -> float:
    """Return the share of decided votes for the first of two conditions.

    Parameters
    ----------
    difference : log-odds, first score less second
    log_theta : tie parameter of Rao and Kupper's model, 0 in the others
    """
    win, loss = (1 / (1 + np.exp(log_theta - side)) for side in (difference, -difference))
    return float(win / (win + loss))


def _told_apart(
    conditions: Sequence[Condition], contrasts: Sequence[Row], differing: Sequence[Row], score: str, where: str
) -> str:
    n, n_pairs = len(conditions), len(contrasts)
    method = f"5 % level, all pairs, Holm{',' if where else ''}{where}"
    if not differing:
        best, worst = conditions[0], conditions[-1]
        what = "the two conditions" if n == 2 else f"any of the {n_pairs} pairs of {n} conditions"
        return (
            f"The answers do not tell {what} apart ({method}). {best.name} has the highest {score}, {best.value}, "
            f"{worst.name} the lowest, {worst.value}; that does not mean that they are equal."
        )
    if len(differing) == n_pairs:
        return f"{'The two' if n == 2 else f'All {n}'} conditions differ from each other ({method})."
    differ = f"pairs of conditions {'differs' if len(differing) == 1 else 'differ'}"
    return (
        f"{len(differing)} of {n_pairs} {differ} ({method}). {_groups(conditions)}Not told apart does not mean equal."
    )


def _groups(conditions: Sequence[Condition]) -> str:
    if len(conditions) > MOST_IN_GROUPS:
        return "In the table, conditions that share a letter are not told apart. "
    alike = sharing_letters((condition.name, condition.letters) for condition in conditions)
    several = [f"{listed(names, len(names))} ({letter})" for letter, names in alike.items()]
    return f"Not told apart: {'; '.join(several)}. "


def sharing_letters(lettered: Iterable[tuple[str, str | None]]) -> dict[str, list[str]]:
    """Return the names that share a letter, by that letter, of pairs of a name and its letters."""
    groups: dict[str, list[str]] = {}
    for name, letters in lettered:
        for letter in LETTER.findall(letters or ""):
            groups.setdefault(letter, []).append(name)
    return {letter: names for letter, names in groups.items() if len(names) > 1}


def _never_judged(analysis: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Name the conditions that no counted vote is about."""
    judged = {row["item"] for row in overall(analysis["scores"])}
    known = [
        *analysis["votes"]["items"],
        *(item for levels in analysis["settings"]["factors"].values() for item in levels),
    ]
    missing = [item for item in dict.fromkeys(known) if item not in judged]
    if missing:
        verb, them = ("has", "it") if len(missing) == 1 else ("have", "them")
        text = f"{listed(missing)} {verb} no vote that counts: nothing can be said about {them}."
        yield finding("missing", text)


def level_text(row: Row) -> str:
    """Return a level of a factor with its effect and interval."""
    low, high = row["ci_low"], row["ci_high"]
    ends = "" if low is None else f", {span(signed(low), signed(high))}"
    return f"{row['level']} ({signed(row['effect'])}{ends})"
