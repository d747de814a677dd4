"""The scores beside R's, where R is installed."""

from __future__ import annotations

import csv
import io
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from app.analysis.bradley_terry import fit_scores
from app.analysis.counts import count_pairs
from app.analysis.power import StudyPlan, simulate_votes

SCRIPT = Path(__file__).parent / "davidson.R"


@pytest.mark.skipif(shutil.which("Rscript") is None, reason="R is not installed (package r-base-core)")
def test_davidsons_model_has_the_digits_of_r() -> None:
    votes = simulate_votes(StudyPlan(6, 2, 22), np.linspace(-1, 1, 6), np.random.default_rng(7))
    fit, counts = fit_scores(votes), count_pairs(votes)
    columns = counts.first, counts.second, counts.wins, counts.losses, counts.ties
    lines = [",".join([votes.items[a], votes.items[b], *map(str, row)]) for a, b, *row in zip(*columns, strict=True)]
    table = "\n".join(["item_a,item_b,wins,losses,ties", *lines]) + "\n"
    said = subprocess.run(["Rscript", str(SCRIPT)], input=table, capture_output=True, text=True, check=True).stdout
    by_r = {row["name"]: (float(row["estimate"]), float(row["se"])) for row in csv.DictReader(io.StringIO(said))}
    assert fit.scores is not None
    ours = {item: (float(fit.scores[index]), fit.error(index)) for index, item in enumerate(fit.items)}
    ours["log_nu"] = (fit.tie_parameter or 0.0, fit.error(-1))
    for name, values in ours.items():
        assert values == pytest.approx(by_r[name], abs=1e-8)
