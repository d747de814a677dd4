"""Measure how far people agree where there are ties and missing votes, test whether they disagree more than their own
noise explains, and find out whether they fall into two camps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from app.analysis.model.contrasts import SIGNIFICANT, critical_value
from app.analysis.reading.votes_table import NONE, A, B, VotesTable, numbered, only_compared

Array = NDArray[np.float64]

PERMUTED, FEWEST_PERMUTED = 199, 39  # times the votes of a cell change hands
WORK = 40_000_000  # votes permuted, about 2 s
TOGETHER = 2_000_000  # of them in memory
LARGEST_JACKKNIFE = 5_000_000  # participants times cells
CAMPS = 0.01  # level of their test; its null is a normal distribution, which opinions only resemble
SMALLEST_CAMP = 0.15  # share of the participants; fewer are outliers, no camp
FEWEST_PEOPLE = 8  # fewer cannot be told to form camps
MOST_ITEMS = 60
ROUNDING = 1e-9  # of a sum of squares
ALPHA = ("alpha", "alpha_low", "alpha_high")


def disagreement(votes: VotesTable, *, by_order: bool = False) -> dict[str, Any] | None:
    """Return how far people agree over all votes, and whether they disagree beyond their own noise.

    Parameters
    ----------
    votes : VotesTable, the votes analysed
    by_order : as in `heterogeneity`

    Returns
    -------
    dict, `alpha`, `alpha_low`, `alpha_high`, `by_dataset` (the same of each named dataset) and `heterogeneity`; None
    with fewer than two participants
    """
    if not votes.has_participants or votes.n_voters < 2:
        return None
    names = [(name, votes.where(votes.dataset == index)) for index, name in enumerate(votes.datasets) if name]
    rows = [{"dataset": name, **krippendorff_alpha(part)} for name, part in names if len(part)]
    return {**krippendorff_alpha(votes), "by_dataset": rows, "heterogeneity": heterogeneity(votes, by_order=by_order)}


def krippendorff_alpha(votes: VotesTable) -> dict[str, float | None]:
    """Return Krippendorff's alpha with its 95 % interval: 1 if all agree on every pair, 0 by chance.

    A vote is +1, 0 (no preference) or -1, distances are squared differences, a unit is a pair on a dataset. Every unit
    is entered in both directions, so that alpha does not depend on which item is named first; with neither ties nor
    missing votes it is Kendall's u but for the correction of a small sample. The interval is that of the jackknife over
    participants.

    Returns
    -------
    dict, `alpha`, `alpha_low`, `alpha_high`; None where no pair has votes of two people, or all are without preference

    Source
    ------
    Krippendorff (2004), "Content analysis", chapter 11, with the interval metric.
    """
    values, judged = _by_person(votes)
    units = judged.sum(axis=0), (values * judged).sum(axis=0), (values**2 * judged).sum(axis=0)
    alpha = float(_alpha(*(part[None] for part in units))[0])
    n_people = len(values)
    if not np.isfinite(alpha):
        return dict.fromkeys(ALPHA)
    if n_people < 3 or values.size > LARGEST_JACKKNIFE:
        return dict.fromkeys(ALPHA) | {"alpha": alpha}
    without = _alpha(units[0] - judged, units[1] - values * judged, units[2] - values**2 * judged)
    if not np.isfinite(without).all():
        return dict.fromkeys(ALPHA) | {"alpha": alpha}
    error = float(np.sqrt((n_people - 1) / n_people * np.sum((without - without.mean()) ** 2)))
    if error < ROUNDING:  # all agree, or whoever is left out changes nothing
        return dict.fromkeys(ALPHA) | {"alpha": alpha}
    half = critical_value(n_people) * error
    return dict(zip(ALPHA, (alpha, max(alpha - half, -1.0), min(alpha + half, 1.0)), strict=True))


def _by_person(votes: VotesTable) -> tuple[Array, Array]:
    """Return each participant's vote on each pair of each dataset, and whether there is one, float64 (J, U)."""
    people, who = numbered(votes.participant, len(votes.participants))
    key = votes.dataset.astype(np.int64) * len(votes.items) ** 2 + votes.pair
    cells, cell = np.unique(key, return_inverse=True)
    size = len(people) * len(cells)
    unit = who * len(cells) + cell
    total = np.bincount(unit, _signs(votes) * votes.count, size).reshape(len(people), -1)
    judged = np.bincount(unit, minlength=size).reshape(len(people), -1) > 0
    return np.sign(total), judged.astype(np.float64)


def _signs(votes: VotesTable) -> Array:
    """Return +1 for the item of lower index, -1 for the other, 0 for neither, float64 (N,)."""
    return np.where(votes.choice == NONE, 0.0, np.where(votes.prefers_lower, 1.0, -1.0))


def _alpha(n: Array, total: Array, squares: Array) -> Array:
    """Return alpha, float64 (B,), from each unit's number of values, their sum and sum of squares, each (B, U)."""
    is_paired = n > 1
    n_values = 2 * np.sum(n * is_paired, axis=1)
    within = np.where(is_paired, 2 * (n * squares - total**2) / np.where(is_paired, n - 1, 1.0), 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        observed = 2 * within.sum(axis=1) / n_values
        expected = 2 * 2 * np.sum(squares * is_paired, axis=1) / (n_values - 1)
        return np.asarray(1 - observed / expected)


def heterogeneity(votes: VotesTable, *, by_order: bool = False) -> dict[str, Any] | None:
    """Test whether people disagree more than their own noise explains, and whether they fall into two camps.

    If people differed in nothing, it would not matter who cast which vote on a pair: votes of a pair on a dataset
    change hands at random. The statistic is the sum over people of the squared balance of every item, which grows if
    somebody's votes go together.

    Parameters
    ----------
    votes : VotesTable, the votes analysed
    by_order : votes change hands only where the same item was shown first

    Returns
    -------
    dict, `ratio` (of the statistic to its mean by chance), `p_value`, `n_permuted`, and `camps` (see `find_camps`) or
    None; None with fewer than three participants or too many votes
    """
    n_permuted = min(PERMUTED, WORK // max(len(votes), 1))
    compared = only_compared(votes) if len(votes) else votes
    if not votes.has_participants or n_permuted < FEWEST_PERMUTED or len(compared.items) > MOST_ITEMS:
        return None
    people, who = numbered(compared.participant, len(compared.participants))
    if len(people) < 3:
        return None
    key = compared.dataset.astype(np.int64) * len(compared.items) ** 2 + compared.pair
    _, cell = np.unique(key * 3 + compared.first_shown + 1 if by_order else key, return_inverse=True)
    order = np.argsort(cell, kind="stable")
    ordered, cell, who = compared.where(order), cell[order], who[order]
    value = _signs(ordered) * ordered.count
    sizes = np.bincount(cell)
    value = value - (np.bincount(cell, value) / sizes)[cell]
    n = len(compared.items)
    low, high = np.minimum(ordered.item_a, ordered.item_b), np.maximum(ordered.item_a, ordered.item_b)
    first, second = who * n + low, who * n + high
    size = len(people) * n

    def balances(values: Array) -> Array:
        return np.asarray(np.bincount(first, values, size) - np.bincount(second, values, size)).reshape(-1, n)

    rng = np.random.default_rng(len(votes))
    observed = balances(value)
    statistic = float(np.sum(observed**2))
    if (sizes == sizes[0]).all():
        shuffled = (rng.permuted(value.reshape(len(sizes), -1), axis=1).ravel() for _ in range(n_permuted))
    else:
        shuffled = (value[np.argsort(cell + rng.random(len(cell)))] for _ in range(n_permuted))
    by_chance = np.array([np.sum(balances(values) ** 2) for values in shuffled])
    if by_chance.max() < ROUNDING:
        return None
    p_value = (1 + np.count_nonzero(by_chance >= statistic - ROUNDING)) / (n_permuted + 1)
    names = [compared.participants[index] for index in people]
    camps = find_camps(observed, names, compared.items, rng) if p_value < SIGNIFICANT else None
    if camps is not None and not all(_has_taste(compared, part) for part in camps["participants"]):
        camps = None
    if camps is not None:
        camps["votes"] = [_decided(compared, camps, part) for part in camps["participants"]]
    ratio = statistic / float(by_chance.mean())
    return {"ratio": ratio, "p_value": float(p_value), "n_permuted": n_permuted, "camps": camps}


def _has_taste(votes: VotesTable, people: list[str]) -> bool:
    """Do these people together prefer anything? Those who throw a coin differ from the others, and are no camp."""
    kept = votes.where(np.isin(np.array(votes.participants, object), people)[votes.participant])
    decided = kept.where(kept.choice != NONE)
    n = len(votes.items)
    signs = np.where(decided.choice == A, 1.0, -1.0) * decided.count
    balance = np.bincount(decided.item_a, signs, n) - np.bincount(decided.item_b, signs, n)
    both = np.bincount(decided.item_a.astype(np.int64) * n + decided.item_b, decided.count.astype(float) ** 2, n * n)
    both = both.reshape(n, n) + both.reshape(n, n).T
    covariance = np.diag(both.sum(axis=1)) - both
    statistic = float(balance @ np.linalg.pinv(covariance, hermitian=True) @ balance)
    return bool(chi2.sf(statistic, np.linalg.matrix_rank(covariance, hermitian=True)) < CAMPS)


def _decided(votes: VotesTable, camps: dict[str, Any], people: list[str]) -> list[int]:
    """Count a camp's votes for the item that the first camp prefers against the other's, and the decided ones."""
    is_in = np.isin(np.array(votes.participants, object), people)[votes.participant]
    first, second = (votes.items.index(camps[name]) for name in ("item_first", "item_second"))
    forth, back = ((votes.item_a == a) & (votes.item_b == b) & is_in for a, b in ((first, second), (second, first)))
    for_first = votes.count[(forth & (votes.choice == A)) | (back & (votes.choice == B))].sum()
    decided = votes.count[(forth | back) & (votes.choice != NONE)].sum()
    return [int(for_first), int(decided)]


def find_camps(
    balances: Array, names: list[str], items: tuple[str, ...], rng: np.random.Generator
) -> dict[str, Any] | None:
    """Return two camps if people fall into two more clearly than if their opinions spread around one.

    The balances are projected on the direction in which people differ most, and split where the parts differ most. The
    share of the spread that the split explains is compared with that of people whose balances are normally distributed
    with the same covariance.

    Parameters
    ----------
    balances : float64 (J, n), how far each person prefers each item
    names : of the J people
    items : their n names
    rng : Generator

    Returns
    -------
    dict, `p_value`, `share`, `item_first` and `item_second` (what the first camp prefers, and the second does, relative
    to each other) and `participants`, the names of each camp; None where no camps are shown
    """
    n_people = len(balances)
    if n_people < FEWEST_PEOPLE:
        return None
    smallest = max(2, int(np.ceil(SMALLEST_CAMP * n_people)))
    spread = balances.T @ balances / n_people
    values, vectors = np.linalg.eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    n_drawn = max(FEWEST_PERMUTED, min(PERMUTED, TOGETHER // balances.size))
    drawn = rng.standard_normal((n_drawn, n_people, len(spread))) @ root.T
    drawn -= drawn.mean(axis=1, keepdims=True)
    share, places, along = _clearest_split(balances[None], smallest)
    by_chance, _, _ = _clearest_split(drawn, smallest)
    p_value = (1 + int(np.count_nonzero(by_chance >= share[0]))) / (n_drawn + 1)
    if p_value > CAMPS:
        return None
    order = np.argsort(along[0], kind="stable")
    parts = order[: places[0]], order[places[0] :]
    first, second = (balances[part].mean(axis=0) for part in parts)
    return {
        "p_value": p_value,
        "share": float(share[0]),
        "item_first": items[int(np.argmax(first - second))],
        "item_second": items[int(np.argmin(first - second))],
        "participants": [[names[index] for index in np.sort(part)] for part in parts],
    }


def _clearest_split(balances: Array, smallest: int) -> tuple[Array, NDArray[np.intp], Array]:
    """Return how much of the spread along the first principal axis a split in two explains, where, and the axis.

    Parameters
    ----------
    balances : float64 (B, J, n)
    smallest : people in a part

    Returns
    -------
    share : float64 (B,)
    places : intp (B,), people in the lower part
    along : float64 (B, J)
    """
    axes = np.linalg.eigh(np.swapaxes(balances, 1, 2) @ balances)[1][:, :, -1]
    along = (balances @ axes[:, :, None])[..., 0]
    ordered = np.sort(along - along.mean(axis=1, keepdims=True), axis=1)
    n = ordered.shape[1]
    sizes = np.arange(1, n)
    sums = np.cumsum(ordered, axis=1)[:, :-1]
    between = sums**2 * n / (sizes * (n - sizes))
    inside = (sizes >= smallest) & (sizes <= n - smallest)
    between = np.where(inside, between, -1.0)
    total = np.maximum(np.sum(ordered**2, axis=1), 1e-300)
    return between.max(axis=1) / total, between.argmax(axis=1) + 1, along
