"""Put ratings and pair votes on one scale: both come from the same qualities, linearly related."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.sparse import coo_array, csr_array, hstack
from scipy.sparse.csgraph import connected_components

from app.analysis.model.contrasts import critical_value
from app.analysis.model.likelihood.counts import PairCounts
from app.analysis.model.likelihood.existence import recession
from app.analysis.model.likelihood.fit import ALIKE
from app.analysis.model.scales import LOG_ODDS_PER_JOD
from app.analysis.ratings.joint_likelihood import Array, JointLikelihood, Observations
from app.analysis.ratings.table import RatingTable, item_name
from app.analysis.reading.cells import numbered_names
from app.analysis.reading.votes_table import NONE, A, B, VotesTable

FEWEST_SHARED = 3  # items that are both rated and compared; a line through two says nothing
STEEPEST = 50.0  # log-odds per standard deviation of the ratings; beyond it the slope grows without limit
CERTAIN = -0.01  # log-likelihood of all votes; above it they all follow the ratings, and the slope grows without limit
STILL = 1e-6  # of a direction whose largest step is 1
TOLERANCE = 1e-6  # of the gradient, per observation
MOST_ITERATIONS = 500


def align(table: RatingTable, votes: VotesTable) -> dict[str, list[dict[str, Any]]]:
    """Estimate the qualities that explain ratings and pair votes together.

    Every item has a quality q in units of the rating scale. A rating is q plus normal noise; the log-odds of preferring
    an item to another are k times the difference of their qualities, with Davidson's tie parameter if there are ties.
    Qualities, k, noise and tie parameter maximise the joint likelihood. Errors are clustered by participant (a name in
    both tables is one person), intervals are by t with the degrees of freedom of `_Fit.freedom`; there are none where a
    single participant voted, or rated.

    Parameters
    ----------
    table : RatingTable
    votes : VotesTable, only rows that are to be used

    Returns
    -------
    dict, `alignment_items` (`quality` on the rating scale; `score` in log-odds, with mean 0 in each dataset) and
    `alignment`, a single row; its `left_out` names items that nobody rated and that votes place nowhere, as they all go
    one way. Without items in common, or without a maximum, there are no items, and the row's `status`
    says why.

    Source
    ------
    Perez-Ortiz, Mikhailiuk, Zerman, Hulusic, Valenzise and Mantiuk (2020), "From Pairwise Comparisons and Rating to a
    Unified Quality Scale", with the Bradley-Terry-Davidson model in place of Thurstone's.
    """
    seen, left_out = _placed_observations(table, votes)
    compared = np.unique(seen.difference.indices)
    n_shared = len(np.intersect1d(np.unique(seen.rated), compared))
    row: dict[str, Any] = {
        "n_items": len(seen.items),
        "n_shared": n_shared,
        "n_ratings": len(seen.rating),
        "n_votes": int(seen.count.sum()),
        "n_participants": seen.n_participants or None,
        "left_out": ", ".join(item_name(*item) for item in left_out) or None,
        **dict.fromkeys(("slope", "slope_low", "slope_high", "rating_noise", "log_nu", "loglik")),
    }
    if n_shared < FEWEST_SHARED:
        return {"alignment_items": [], "alignment": [row | {"status": "too few items in common"}]}
    fit = _fit(seen)
    if fit is None:
        return {"alignment_items": [], "alignment": [row | {"status": "no maximum"}]}
    return {"alignment_items": _item_rows(seen, fit), "alignment": [row | fit.row() | {"status": "ok"}]}


@dataclass(frozen=True)
class _Fit:
    """Estimates in units of the rating scale: qualities (K,), then k, log noise and, with ties, log nu.

    Parameters
    ----------
    theta : float64 (M,)
    covariance : float64 (M, M), from the information
    influence : what each participant's votes, and ratings, add to the estimates, both float64 (J, M); None where
        participants are unknown
    n_people : numbers of participants who voted, and who rated
    """

    theta: Array
    covariance: Array
    influence: tuple[Array, Array] | None
    n_people: tuple[int, int]
    n_items: int
    loglik: float

    def interval(self, gradient: Array, value: float) -> tuple[float | None, float | None, float | None]:
        """Return the error and 95 % interval of a linear function of the parameters."""
        if self.influence is None:
            error = float(np.sqrt(gradient @ self.covariance @ gradient))
            half = critical_value(None) * error
        elif min(self.n_people) < 2:  # who says nothing about others
            return None, None, None
        else:
            votes, ratings = (part @ gradient for part in self.influence)
            error = float(np.linalg.norm(votes + ratings))
            if error**2 <= ALIKE * float(gradient @ self.covariance @ gradient):  # all agree
                return None, None, None
            half = critical_value(1 + self.freedom(float(votes @ votes), float(ratings @ ratings))) * error
        return error, value - half, value + half

    def freedom(self, *variances: float) -> float:
        """Return the degrees of freedom of an error, of which votes and ratings make these parts.

        Few people who voted are few, however many others rated.

        Source
        ------
        Satterthwaite (1946).
        """
        assert self.influence is not None
        most = len(self.influence[0]) - 1.0
        parts = sum(variance**2 / (n - 1) for variance, n in zip(variances, self.n_people, strict=True))
        return min(most, sum(variances) ** 2 / parts) if parts else most

    def row(self) -> dict[str, Any]:
        n = self.n_items
        slope = float(self.theta[n])
        _, low, high = self.interval(np.eye(len(self.theta))[n], slope)
        return {
            "slope": slope,
            "slope_low": low,
            "slope_high": high,
            "rating_noise": float(np.exp(self.theta[n + 1])),
            "log_nu": float(self.theta[n + 2]) if len(self.theta) > n + 2 else None,
            "loglik": self.loglik,
        }


def _observations(table: RatingTable, votes: VotesTable) -> Observations:
    """Number items and participants of both tables alike; leave out items that no rating is linked to by votes."""
    names: dict[tuple[str, str], int] = {}
    rated = numbered_names((table.items[index] for index in table.item), names)
    first, second = (
        numbered_names([(votes.datasets[d], votes.items[i]) for d, i in zip(votes.dataset, item, strict=True)], names)
        for item in (votes.item_a, votes.item_b)
    )
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(names), len(names)))
    part = connected_components(graph, directed=False)[1]
    is_linked = np.isin(part, part[rated])
    new = np.cumsum(is_linked) - 1
    used = is_linked[first]
    people: dict[str, int] = {}
    rater = numbered_names([table.participants[index] for index in table.person], people)
    voter = numbered_names([votes.participants[index] for index in votes.participant[used]], people)
    n_votes = int(used.sum())
    cells = (np.tile(np.arange(n_votes), 2), np.r_[new[first[used]], new[second[used]]])
    signs = np.repeat([1.0, -1.0], n_votes)
    return Observations(
        items=tuple(name for name, index in names.items() if is_linked[index]),
        rating=table.rating,
        rated=new[rated],
        rater=rater,
        difference=csr_array((signs, cells), shape=(n_votes, int(is_linked.sum()))),
        choice=votes.choice[used],
        count=votes.count[used].astype(float),
        voter=voter,
        n_participants=len(people) if votes.has_participants else 0,
    )


def _placed_observations(table: RatingTable, votes: VotesTable) -> tuple[Observations, list[tuple[str, str]]]:
    """Return what was seen of the items that have a place, and the others.

    Where votes on an item that nobody rated all go one way, the likelihood rises as it moves away without end, towards
    that of the other votes: leaving the item out changes no other estimate.
    """
    seen, left_out = _observations(table, votes), list[tuple[str, str]]()
    while nowhere := _items_without_place(seen):
        left_out += nowhere
        is_gone = np.zeros((len(votes.datasets), len(votes.items)), bool)
        for dataset, item in nowhere:
            is_gone[votes.datasets.index(dataset), votes.items.index(item)] = True
        votes = votes.where(~(is_gone[votes.dataset, votes.item_a] | is_gone[votes.dataset, votes.item_b]))
        seen = _observations(table, votes)
    return seen, left_out


def _fit(seen: Observations) -> _Fit | None:
    """Return the maximum of the joint likelihood; None if there is none."""
    centre, unit = float(seen.rating.mean()), float(seen.rating.std()) or 1.0
    counts = [seen.count * (seen.choice == choice) for choice in (A, B, NONE)]
    likelihood = JointLikelihood(seen, (seen.rating - centre) / unit, *counts)
    start = _start(seen, likelihood)
    n, n_observations = len(seen.items), len(seen.rating) + seen.count.sum()

    def stop_if_too_steep(theta: Array) -> None:
        if abs(theta[n]) > STEEPEST:  # before numbers overflow
            raise StopIteration

    optimise: Any = minimize  # its stubs know no callback without a result
    best = optimise(
        likelihood.loss,
        start,
        jac=likelihood.loss_gradient,
        hess=likelihood.information,
        method="trust-exact",
        options={"gtol": TOLERANCE, "maxiter": MOST_ITERATIONS},
        callback=stop_if_too_steep,
    )
    theta = np.asarray(best.x)
    information = likelihood.information(theta)
    if np.abs(best.jac).max() > TOLERANCE * n_observations or abs(theta[n]) > STEEPEST:
        return None
    if likelihood.of_votes(theta) > CERTAIN:
        return None
    try:
        inverse = cho_solve(cho_factor(information), np.eye(len(theta)))
    except LinAlgError:
        return None
    scale = np.ones(len(theta))
    scale[:n], scale[n] = unit, 1 / unit
    influence = _influence(seen, likelihood, theta, inverse * scale) if seen.n_participants else None
    theta = theta * scale
    theta[:n] += centre
    theta[n + 1] += np.log(unit)
    loglik = likelihood.value(best.x) - len(seen.rating) * float(np.log(unit))
    n_people = len(np.unique(seen.voter)), len(np.unique(seen.rater))
    return _Fit(theta, inverse * np.outer(scale, scale), influence, n_people, n, loglik)


def _items_without_place(seen: Observations) -> list[tuple[str, str]]:
    """Return items that were only compared, and between which and the others votes do not go both ways."""
    n = len(seen.items)
    unrated = np.flatnonzero(~np.isin(np.arange(n), seen.rated))
    if not len(unrated):
        return []
    codes = seen.difference.indices.reshape(-1, 2) @ np.array([n, 1])
    _, first, pair = np.unique(codes, return_index=True, return_inverse=True)
    votes_a, votes_b, tied = (seen.count * (seen.choice == choice) for choice in (A, B, NONE))
    is_turned = seen.difference.data[::2] < 0
    sides = np.where(is_turned, [votes_b, votes_a], [votes_a, votes_b])
    wins, losses, ties = (np.bincount(pair, votes).astype(np.float64) for votes in (*sides, tied))
    low, high = np.divmod(codes[first], n)
    n_pairs, has_ties = len(first), int(tied.any())
    of_pairs = seen.difference[first][:, unrated] * np.where(is_turned, -1.0, 1.0)[first][:, None]
    effects = csr_array(hstack([of_pairs, csr_array((n_pairs, has_ties))]))
    to_ties = csr_array(hstack([csr_array(of_pairs.shape), csr_array(np.ones((n_pairs, has_ties)))]))
    counts = PairCounts(n, low, high, wins, losses, ties)
    direction = recession(counts, effects, to_ties if has_ties else None, n_scores=0)[1]
    if direction is None:
        return []
    return [seen.items[index] for index in unrated[np.abs(direction[: len(unrated)]) > STILL]]


def _start(seen: Observations, likelihood: JointLikelihood) -> Array:
    """Return the mean ratings, 1 log-odds per standard deviation, and the ratings' noise."""
    n = len(seen.items)
    times = np.bincount(seen.rated, minlength=n)
    quality = np.bincount(seen.rated, likelihood.rating, minlength=n) / np.maximum(times, 1)
    noise = max(float(np.std(likelihood.rating - quality[seen.rated])), 0.1)
    return np.concatenate([quality, [1.0, np.log(noise)], [0.0] if likelihood.has_ties else []])


def _influence(seen: Observations, likelihood: JointLikelihood, theta: Array, inverse: Array) -> tuple[Array, Array]:
    """Return what each participant's votes, and ratings, add to the estimates, both float64 (J, M).

    It is the gradient times the inverse information; its square has the factor n / (n - 1) of n people who voted, or
    rated.
    """

    def of(who: NDArray[np.intp], gradients: csr_array) -> Array:
        n = len(np.unique(who))
        shape = (seen.n_participants, len(who))
        belongs = csr_array((np.ones(len(who)), (who, np.arange(len(who)))), shape=shape)
        return np.asarray((belongs @ gradients) @ inverse * np.sqrt(n / max(n - 1, 1)))

    votes, ratings = likelihood.parts(theta)
    return of(seen.voter, votes), of(seen.rater, ratings)


def _item_rows(seen: Observations, fit: _Fit) -> list[dict[str, Any]]:
    n, slope = fit.n_items, float(fit.theta[fit.n_items])
    quality = fit.theta[:n]
    dataset = np.array([name for name, _ in seen.items], object)
    n_ratings = np.bincount(seen.rated, minlength=n)
    n_votes = abs(seen.difference).T @ seen.count
    rows = []
    for index, (name, condition) in enumerate(seen.items):
        direction = np.zeros(len(fit.theta))
        direction[index] = 1
        quality_se, low, high = fit.interval(direction, float(quality[index]))
        there = dataset == name
        gap = float(quality[index] - quality[there].mean())
        by_score = slope * (direction - np.r_[there / there.sum(), np.zeros(len(direction) - n)])
        by_score[n] = gap
        score_se, score_low, score_high = fit.interval(by_score, slope * gap)
        row = {"dataset": name, "condition": condition, "n_ratings": int(n_ratings[index])}
        row |= {"n_votes": int(n_votes[index]), "quality": float(quality[index]), "quality_se": quality_se}
        row |= {"quality_low": low, "quality_high": high, "score": slope * gap, "score_se": score_se}
        rows.append(row | {"score_low": score_low, "score_high": score_high, "jod": slope * gap / LOG_ODDS_PER_JOD})
    return rows
