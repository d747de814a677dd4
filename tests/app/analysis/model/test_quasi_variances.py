"""Quasi-variances are those of the R package qvcalc, on the data of its own test."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from app.analysis import analyse, votes_from_rows
from app.analysis.model.quasi_variances import quasi_variances
from tests.app.analysis.test_findings import votes_by

Array = NDArray[np.float64]

# Months of service and damage incidents of ships by type, year of construction (4) and period (2); McCullagh and Nelder
# (1989), table 6.2.
SHIPS = """
127 0 63 0 1095 3 1095 4 1512 6 3353 18 0 0 2244 11
44882 39 17176 29 28609 58 20370 53 7064 12 13099 44 0 0 7117 18
1179 1 552 1 781 0 676 1 783 6 1948 2 0 0 274 1
251 0 105 0 288 0 192 0 349 2 1208 11 0 0 2051 4
45 0 0 0 789 7 437 7 1157 5 2161 12 0 0 542 1
"""
# Quasi standard errors of the types, tests/testthat/test-qvcalc_glm.R of qvcalc 1.0.4.
QUASI_ERRORS = (0.200965853501369, 0.112705161723464, 0.375250492322657, 0.323893536427565, 0.232171862907782)


def covariance_of_types() -> Array:
    """Fit the overdispersed Poisson model incidents ~ type + year + period, type A as the reference."""
    service, incidents = np.moveaxis(np.array(SHIPS.split(), float).reshape(40, 2), 1, 0)
    kind, year, period = np.indices((5, 4, 2)).reshape(3, -1)
    columns = [kind == level for level in range(1, 5)] + [year == level for level in range(1, 4)] + [period == 1]
    design = np.c_[np.ones(40), np.stack(columns, axis=1)][service > 0]
    y, offset = incidents[service > 0], np.log(service[service > 0])
    theta = np.r_[-6.0, np.zeros(8)]
    for _ in range(30):
        mean = np.exp(design @ theta + offset)
        information = design.T @ (mean[:, None] * design)
        theta = theta + np.linalg.solve(information, design.T @ (y - mean))
    dispersion = np.sum((y - mean) ** 2 / mean) / (len(y) - 9)
    covariance = np.zeros((5, 5))
    covariance[1:, 1:] = dispersion * np.linalg.inv(information)[1:5, 1:5]
    return covariance


def test_quasi_variances_are_those_that_qvcalc_publishes() -> None:
    known = quasi_variances(covariance_of_types())
    assert known is not None
    assert np.sqrt(known[0]) == pytest.approx(QUASI_ERRORS, rel=2e-5)  # they stop at 1e-8 of the deviance
    assert known[1] == pytest.approx(0.009, abs=0.0005)


def test_quasi_variances_do_not_depend_on_the_reference_and_are_exact_where_they_can_be() -> None:
    covariance = covariance_of_types()
    centre = np.eye(5) - 0.2
    known, centred = quasi_variances(covariance), quasi_variances(centre @ covariance @ centre.T)
    assert known is not None
    assert centred is not None
    assert centred[0] == pytest.approx(known[0], rel=1e-9)
    diagonal = quasi_variances(np.diag([1.0, 2.0, 3.0, 4.0]) + 5.0)
    assert diagonal is not None
    assert diagonal[0] == pytest.approx([1, 2, 3, 4])
    assert diagonal[1] == pytest.approx(0, abs=1e-9)


def test_of_two_conditions_and_of_differences_without_variance_there_are_none() -> None:
    assert quasi_variances(np.eye(2)) is None
    assert quasi_variances(np.zeros((3, 3))) is None


def test_the_error_of_every_difference_follows_from_a_table_of_scores() -> None:
    analysis = analyse(votes_from_rows(votes_by({"a": 0.0, "b": 0.5, "c": 1.0, "d": 0.2}, 20)))
    quasi = {row["item"]: row["quasi_se"] for row in analysis["scores"] if row["dataset"] == "all"}
    (model,) = (row for row in analysis["models"] if row["dataset"] == "all")
    for row in analysis["contrasts"]:
        if row["dataset"] == "all":
            error = np.hypot(quasi[row["item_a"]], quasi[row["item_b"]])
            assert error == pytest.approx(row["se"], rel=model["quasi_error"] + 1e-9)
