"""Tables of ratings for the tests: simulated ones of known truth, and one that SUREAL has analysed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.analysis.ratings.table import RatingTable

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Truth:
    """What ratings were simulated from."""

    quality: Array
    bias: Array
    inconsistency: Array


def rating_table(
    person: Array | list[int],
    item: Array | list[int],
    rating: Array | list[float],
    *,
    n_datasets: int = 1,
    protocol: str = "acr",
    scale: tuple[float, float] = (1.0, 5.0),
    references: tuple[int, ...] = (),
) -> RatingTable:
    """Make a table of participants p0, p1, … and of items c0, c1, … of each dataset d0, d1, …"""
    persons, items = np.asarray(person, np.intp), np.asarray(item, np.intp)
    n_items = int(items.max()) + 1
    names = [(f"d{index * n_datasets // n_items}", f"c{index % (n_items // n_datasets)}") for index in range(n_items)]
    return RatingTable(
        tuple(f"p{index}" for index in range(int(persons.max()) + 1)),
        tuple(names),
        persons,
        items,
        np.asarray(rating, float),
        np.isin(np.arange(n_items), references),
        protocol,
        *scale,
    )


def simulated(
    rng: np.random.Generator, n_people: int = 24, n_items: int = 30, *, missing: float = 0.0, n_datasets: int = 1
) -> tuple[RatingTable, Truth]:
    """Simulate ratings on a scale without steps by participants with biases, of whom three in ten are noisy."""
    quality = rng.uniform(1.5, 4.5, n_items)
    bias = rng.normal(0, 0.4, n_people)
    spread = np.where(rng.random(n_people) < 0.3, 3.0, rng.uniform(0.6, 0.9, n_people))
    truth = Truth(quality, bias - bias.mean(), spread)
    person, item = np.divmod(np.arange(n_people * n_items), n_items)
    there = rng.random(len(person)) >= missing
    person, item = person[there], item[there]
    rating = quality[item] + truth.bias[person] + truth.inconsistency[person] * rng.normal(size=len(person))
    return rating_table(person, item, rating, scale=(-20.0, 30.0), n_datasets=n_datasets), truth


# Ratings of 12 items by 8 participants, a row each; p2 and p5 left one out, p0 and p4 rated one again.
RATINGS = (
    (2, 2, 2, 1, 1, 1, 3, 1, 4, 3, 1, 4),
    (3, 4, 3, 2, 3, 3, 3, 1, 4, 5, 1, 4),
    (3, 4, 3, 0, 3, 3, 4, 3, 4, 4, 2, 2),
    (1, 4, 3, 3, 2, 1, 4, 2, 5, 5, 3, 4),
    (3, 4, 2, 2, 3, 3, 4, 2, 5, 4, 1, 4),
    (0, 3, 3, 2, 3, 3, 5, 1, 5, 5, 1, 3),
    (1, 4, 2, 1, 2, 2, 4, 3, 4, 4, 2, 5),
    (2, 5, 1, 5, 4, 5, 4, 1, 5, 5, 1, 1),
)
AGAIN = ((0, 1, 3), (4, 6, 3))

# What SUREAL 0.9.0 (SubjectMLEModelProjectionSolver2, its model of P.910 Annex E) makes of them.
SUREAL_QUALITY = (
    *(2.65901615, 3.70616277, 2.42032742, 1.94371649, 2.68255, 2.65589464),
    *(3.54042359, 1.70824768, 4.56637967, 4.25405785, 1.24122394, 3.79576015),
)
SUREAL_BIAS = (-0.83691716, 0.0688533, 0.1609051, 0.15218664, 0.09890893, 0.13502325, -0.09781336, 0.3188533)
SUREAL_INCONSISTENCY = (
    *(0.56606775, 0.45413682, 0.77098992, 0.97451508, 0.32995571, 0.66908013, 0.86498142, 1.54942884),
)


def known_table() -> RatingTable:
    """Return the ratings that SUREAL has analysed."""
    rows = [(p, j, r) for p, ratings in enumerate(RATINGS) for j, r in enumerate(ratings) if r] + list(AGAIN)
    person, item, rating = zip(*rows, strict=True)
    return rating_table(list(person), list(item), list(rating))
