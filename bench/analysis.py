"""How fast votes become scores, beside other libraries where they are installed.

    python bench/analysis.py [--json]

Processor time of one thread, the best of several runs, ours and theirs in turn in one process. Peers (choix, evalica,
R) are optional; where a peer would take minutes it is timed on a part of the work and scaled, which the output says.
"""
# ruff: noqa: E402  (one thread has to be asked for before numpy is loaded)

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before numpy is loaded

import numpy as np

from app.analysis.model.bootstrap import bootstrap_scores, participant_weights
from app.analysis.model.bradley_terry import fit_counts, fit_scores
from app.analysis.model.likelihood.counts import count_pairs
from app.analysis.reading.votes_table import VotesTable, votes_from_indices

try:
    import evalica
except ModuleNotFoundError:
    evalica = None
try:
    import choix
except ModuleNotFoundError:
    choix = None

SEED = 5
TIE_SHARE = 0.2


def best(work: Callable[[], Any], runs: int) -> float:
    """Return the least processor time of several runs in seconds."""
    times = []
    for _ in range(runs):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def simulated(n_items: int, n_participants: int, *, n_votes: int | None = None, ties: bool = True) -> VotesTable:
    """Votes by Davidson's model; every pair once per participant, or a number of random pairs."""
    rng = np.random.default_rng(SEED + n_items)
    ability = rng.normal(0, 0.8, n_items)
    if n_votes is None:
        first, second = (np.tile(part, n_participants) for part in np.triu_indices(n_items, 1))
        who = np.repeat(np.arange(n_participants), n_items * (n_items - 1) // 2)
    else:
        first = rng.integers(0, n_items, n_votes)
        second = (first + rng.integers(1, n_items, n_votes)) % n_items
        who = rng.integers(0, n_participants, n_votes)
    d = ability[first] - ability[second]
    weights = np.stack([np.exp(d / 2), np.exp(-d / 2), np.full(len(d), 2 * TIE_SHARE / (1 - TIE_SHARE) * ties)])
    drawn = rng.random(len(d)) * weights.sum(axis=0)
    choice = (drawn > weights[0]).astype(np.int8) + (drawn > weights[0] + weights[1])
    names = tuple(map(str, range(n_participants))), ("",), tuple(f"item {k}" for k in range(n_items))
    return votes_from_indices(who, np.zeros(len(d), np.int32), first, second, choice, names=names)


def small_study() -> dict[str, Any]:
    """22 participants, 5 datasets, 15 pairs: 1 000 bootstrap replicates of each dataset."""
    studies = [simulated(6, 22) for _ in range(5)]
    fits = [fit_scores(study) for study in studies]
    weights = participant_weights(22, 1000, np.random.default_rng(SEED))
    ours = best(lambda: [bootstrap_scores(f, s, weights) for f, s in zip(fits, studies, strict=True)], 7)
    result: dict[str, Any] = {"ours_ms": ours * 1e3}
    tables = [_replicate(studies[0], row) for row in weights[:100]]
    if evalica:
        labels, kernel = zip(*(_for_evalica(table) for table in tables), strict=True)
        by_label = best(lambda: [evalica.newman(**part, tolerance=1e-9, limit=1000) for part in labels], 3)
        in_kernel = best(lambda: [evalica._brzo.newman(**part) for part in kernel], 3)
        result["evalica.newman (100 of 5 000 fits, scaled)"] = by_label * 50 / ours
        result["evalica.newman, its kernel alone (scaled)"] = in_kernel * 50 / ours
    if choix:
        matrices = [_win_matrix(table) for table in tables]
        dense = best(lambda: [choix.ilsr_pairwise_dense(matrix, tol=1e-9) for matrix in matrices], 3)
        result["choix dense, ties as half wins (scaled)"] = dense * 50 / ours
    if shutil.which("Rscript"):
        result["R, glm.fit (scaled)"] = r_seconds(tables) * 50 / ours
    return result


R_FITS = """
table <- as.matrix(read.csv(file("stdin"))); pairs <- 15; n <- 6
first <- table[1, 1:pairs]; second <- table[2, 1:pairs]; counts <- table[-(1:2), ]
half <- sapply(1:n, function(i) ((first == i) - (second == i)) / 2)
X <- cbind(rbind(diag(pairs), diag(pairs), diag(pairs)), rep(c(0, 0, 1), each = pairs))
X <- cbind(X, rbind(half, -half, 0 * half)[, -1])
fit <- function(y) glm.fit(X, y, family = poisson(), control = glm.control(epsilon = 1e-9))
warm <- fit(counts[1, ])
cat(min(replicate(3, sum(system.time(apply(counts, 1, fit))[1:2]))))
"""  # Davidson's model as a log-linear model, by R's own glm.fit


def r_seconds(tables: list[VotesTable]) -> float:
    """Return the processor time in which R fits Davidson's model to all tables."""
    counted = [count_pairs(table) for table in tables]
    rows = [np.tile(part + 1, 3) for part in (counted[0].first, counted[0].second)]
    rows += [np.concatenate([one.wins, one.losses, one.ties]) for one in counted]
    text = "\n".join(",".join(map(str, row)) for row in [np.arange(45), *rows])
    run = subprocess.run(["Rscript", "-e", R_FITS], input=text, capture_output=True, text=True, check=True)
    return float(run.stdout)


def _replicate(votes: VotesTable, weights: np.ndarray[Any, Any]) -> VotesTable:
    return VotesTable(**{**vars(votes), "count": weights[votes.participant].astype(np.int64)})


def _for_evalica(votes: VotesTable) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what evalica's public function and its kernel take: aggregated outcomes with weights."""
    counts = count_pairs(votes)
    parts = ((counts.wins, evalica.Winner.X), (counts.losses, evalica.Winner.Y), (counts.ties, evalica.Winner.Draw))
    rows = [(i, j, w, n) for ns, w in parts for i, j, n in zip(counts.first, counts.second, ns, strict=True) if n]
    xs, ys, winners, weights = (list(column) for column in zip(*rows, strict=True))
    names = votes.items
    labels = {"xs": [names[i] for i in xs], "ys": [names[i] for i in ys], "winners": winners, "weights": weights}
    indices = {"xs": [int(i) for i in xs], "ys": [int(i) for i in ys], "winners": winners, "weights": weights}
    fixed = {"total": len(names), "v_init": 0.5, "win_weight": 1.0, "tie_weight": 1.0, "tolerance": 1e-9, "limit": 1000}
    return labels, indices | fixed


def _win_matrix(votes: VotesTable) -> np.ndarray[Any, Any]:
    counts = count_pairs(votes)
    matrix = np.zeros((counts.n_items, counts.n_items))
    matrix[counts.first, counts.second] = counts.wins + counts.ties / 2
    matrix[counts.second, counts.first] = counts.losses + counts.ties / 2
    return matrix


def raw_votes() -> dict[str, Any]:
    """100 items, 1 million raw votes as integers, to scores."""
    votes = simulated(100, 1, n_votes=1_000_000, ties=False)
    ours = best(lambda: fit_counts(count_pairs(votes), votes.items, ties="davidson"), 15)
    result: dict[str, Any] = {"ours_ms": ours * 1e3}
    if evalica:
        names = np.array(votes.items, object)
        xs, ys = names[votes.item_a].tolist(), names[votes.item_b].tolist()
        kinds = np.array([evalica.Winner.X, evalica.Winner.Y, evalica.Winner.Draw], object)
        winners = kinds[votes.choice].tolist()
        result["evalica.newman on labels"] = best(lambda: evalica.newman(xs, ys, winners), 2) / ours
    return result


def many_items() -> dict[str, Any]:
    """1 000 items, 10 million votes, aggregated, to scores."""
    votes = simulated(1000, 1, n_votes=10_000_000, ties=False)
    counts = count_pairs(votes)
    ours = best(lambda: fit_counts(counts, votes.items, ties="davidson"), 5)
    fit = fit_counts(counts, votes.items, ties="davidson")
    result: dict[str, Any] = {"ours_ms": ours * 1e3, "largest_gradient": _largest_gradient(fit)}
    if evalica:
        labels, kernel = _for_evalica(votes)
        result["evalica.newman"] = best(lambda: evalica.newman(**labels, tolerance=1e-8), 2) / ours
        result["evalica.newman, its kernel alone"] = best(lambda: evalica._brzo.newman(**kernel), 2) / ours
    return result


def _largest_gradient(fit: Any) -> float:
    """Return the largest |gradient| over the information: how far, in log-odds, a score is from the maximum."""
    counts, n = fit.counts, fit.counts.n_items
    table = counts.wins[None], counts.losses[None], counts.ties[None]
    slopes = fit.design.model.derivatives(*fit.design.predictors(fit.theta[None]), *table)
    gradient = np.bincount(counts.first, slopes.d[0], n) - np.bincount(counts.second, slopes.d[0], n)
    information = np.bincount(counts.first, slopes.dd[0], n) + np.bincount(counts.second, slopes.dd[0], n)
    return float(np.abs(gradient / information).max())


def large_panel() -> dict[str, Any]:
    """100 items, 500 participants, 1 000 bootstrap replicates over participants."""
    votes = simulated(100, 500)
    fit = fit_scores(votes)
    weights = participant_weights(500, 1000, np.random.default_rng(SEED))
    return {"ours_ms": best(lambda: bootstrap_scores(fit, votes, weights), 3) * 1e3}


CASES = {part.__name__: part for part in (small_study, raw_votes, many_items, large_panel)}


def main() -> None:
    """Run the cases and print ours in milliseconds, the peers as multiples of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.add_argument("--only", choices=CASES, help="one case")
    arguments = parser.parse_args()
    results = {name: case() for name, case in CASES.items() if arguments.only in (None, name)}
    if arguments.json:
        sys.stdout.write(json.dumps(results, indent=2) + "\n")
        return
    for name, result in results.items():
        sys.stdout.write(f"{CASES[name].__doc__}\n  ours {result.pop('ours_ms'):.1f} ms\n")
        for what, value in result.items():
            sys.stdout.write(f"  {what}: {value:.2g}{'' if what.startswith('largest') else ' times ours'}\n")


if __name__ == "__main__":
    main()
