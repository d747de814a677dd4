"""Sample the posterior of the random-effects model by long Markov chains: the reference of test_random_effects.py.

`python tests/app/analysis/model/random_effects_chain.py` writes random_effects_chain.json: votes, and what 4 chains of
Hamiltonian Monte Carlo (Neal 2011) say about scores and standard deviations. It takes some minutes and shares no code
with the analysis.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PEOPLE, DATASETS, ITEMS = 16, 4, 5
SPREADS = {"participants": 0.7, "ties": 0.8, "datasets": 0.4}
LOG_NU = -0.3
CHAINS, WARM_UP, KEPT, LEAPS = 4, 2000, 10_000, 14


def simulated(rng: np.random.Generator) -> NDArray[np.int64]:
    """Return votes: person, dataset, first item, second item, choice (0 first, 1 second, 2 neither)."""
    scores = np.linspace(-1, 1, ITEMS)
    of_person = SPREADS["participants"] * rng.standard_normal((PEOPLE, ITEMS))
    ties = SPREADS["ties"] * rng.standard_normal(PEOPLE)
    of_dataset = SPREADS["datasets"] * rng.standard_normal((DATASETS, ITEMS))
    rows = []
    for person in range(PEOPLE):
        for dataset in range(DATASETS):
            ability = scores + of_person[person] + of_dataset[dataset]
            for first in range(ITEMS):
                for second in range(first + 1, ITEMS):
                    half = (ability[first] - ability[second]) / 2
                    weights = np.exp([half, -half, LOG_NU + ties[person]])
                    rows.append([person, dataset, first, second, rng.choice(3, p=weights / weights.sum())])
    return np.array(rows)


class Posterior:
    """Log-density of all parameters, in the order: scores, log nu, three logarithms of standard deviations, and the
    random effects in units of their standard deviations.
    """

    def __init__(self, votes: NDArray[np.int64]) -> None:
        self.person, self.dataset, first, second, choice = votes.T
        self.signs = np.eye(ITEMS)[first] - np.eye(ITEMS)[second]  # (N, n)
        self.is_person = np.eye(PEOPLE)[:, self.person]  # (J, N)
        self.is_dataset = np.eye(DATASETS)[:, self.dataset]
        self.target = np.select([choice == 0, choice == 1], [0.5, -0.5], 0.0)
        self.is_tie = (choice == 2).astype(float)
        self.ends = np.cumsum([ITEMS, 1, 3, PEOPLE * ITEMS, PEOPLE])
        self.size = int(self.ends[-1]) + DATASETS * ITEMS

    def __call__(self, at: Array) -> tuple[float, Array]:
        """Return the log-density and its gradient."""
        scores, log_nu, logs, people, ties, datasets = np.split(at, self.ends)
        people, datasets = people.reshape(PEOPLE, ITEMS), datasets.reshape(DATASETS, ITEMS)
        sd_people, sd_ties, sd_datasets = sds = np.exp(logs)
        of_person, of_dataset = self.signs * people[self.person], self.signs * datasets[self.dataset]
        d = self.signs @ scores + sd_people * of_person.sum(1) + sd_datasets * of_dataset.sum(1)
        t = log_nu + sd_ties * ties[self.person]
        win, loss, tie = np.exp(d / 2), np.exp(-d / 2), np.exp(t)
        total = win + loss + tie
        by_d, by_t = self.target - (win - loss) / total / 2, self.is_tie - tie / total
        in_items = self.signs * by_d[:, None]
        grad_people, grad_ties = self.is_person @ in_items, self.is_person @ by_t
        grad_datasets = self.is_dataset @ in_items
        prior = np.sum(logs - np.log1p(sds**2)) - (people**2).sum() / 2 - (ties**2).sum() / 2
        value = (self.target @ d + self.is_tie @ t - np.log(total).sum()) + prior
        value -= (datasets**2).sum() / 2 + scores.sum() ** 2 / 2  # the common shift is told by nothing else
        grad_logs = 1 - 2 * sds**2 / (1 + sds**2)
        grad_logs += sds * [(grad_people * people).sum(), grad_ties @ ties, (grad_datasets * datasets).sum()]
        gradient = [
            in_items.sum(0) - scores.sum(),
            by_t.sum(),
            grad_logs,
            sd_people * grad_people - people,
            sd_ties * grad_ties - ties,
            sd_datasets * grad_datasets - datasets,
        ]
        return float(value), np.concatenate([np.ravel(part) for part in gradient])


def chain(posterior: Posterior, seed: int) -> Array:
    """Return scores and standard deviations along a chain, (KEPT, ITEMS + 3); warm-up tunes step and masses."""
    rng = np.random.default_rng(seed)
    at = 0.1 * rng.standard_normal(posterior.size)
    scale, step = np.ones(posterior.size), 0.05
    value, gradient = posterior(at)
    kept, seen = np.empty((KEPT, ITEMS + 3)), []
    for turn in range(WARM_UP + KEPT):
        momentum = rng.standard_normal(posterior.size)
        energy = value - momentum @ momentum / 2
        new, new_value, new_gradient = at, value, gradient
        for _ in range(rng.integers(LEAPS // 2, LEAPS + 1)):
            momentum = momentum + step / 2 * scale * new_gradient
            new = new + step * scale * momentum
            new_value, new_gradient = posterior(new)
            momentum = momentum + step / 2 * scale * new_gradient
        accepted = np.log(rng.random()) < new_value - momentum @ momentum / 2 - energy
        if accepted:
            at, value, gradient = new, new_value, new_gradient
        if turn < WARM_UP:
            step *= np.exp(0.05 * (accepted - 0.8))
            seen.append(at)
            if turn in (WARM_UP // 3, 2 * WARM_UP // 3):
                scale, seen = np.std(seen[len(seen) // 2 :], axis=0), []
                step = 0.2
        else:
            scores = at[:ITEMS] - at[:ITEMS].mean()
            kept[turn - WARM_UP] = np.r_[scores, np.exp(at[ITEMS + 1 : ITEMS + 4])]
    return kept


def main() -> None:
    """Write the votes and their posterior."""
    votes = simulated(np.random.default_rng(5))
    chains = np.stack([chain(Posterior(votes), seed) for seed in range(CHAINS)])
    within, between = chains.var(axis=1).mean(axis=0), chains.mean(axis=1).var(axis=0, ddof=1)
    halves = chains.reshape(CHAINS * 20, KEPT // 20, -1).mean(axis=1)
    together = chains.reshape(-1, chains.shape[-1])
    names = [*map(str, range(ITEMS)), *SPREADS]
    quantiles = np.quantile(together, [0.025, 0.5, 0.975], axis=0)
    rows = zip(names, together.mean(0), together.std(0), *quantiles, strict=True)
    written = {
        "r_hat": float(np.sqrt(1 + between / within).max()),
        "largest_error_of_a_mean": float((halves.std(axis=0, ddof=1) / np.sqrt(len(halves))).max()),
        "posterior": {
            name: dict(zip(("mean", "sd", "low", "median", "high"), np.round(numbers, 4).tolist(), strict=True))
            for name, *numbers in rows
        },
        "votes": votes.tolist(),
    }
    Path(__file__).with_suffix(".json").write_text(json.dumps(written) + "\n", encoding="utf-8")
    print(written["r_hat"], written["largest_error_of_a_mean"], *written["posterior"].items(), sep="\n")


if __name__ == "__main__":
    main()
