"""The demo's study: made of its videos, voted on by simulated participants, analysed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import httpx

from app.analysis import write_analysis
from app.operate import add_own_token, create_study, list_studies
from app.settings import Settings
from app.simulate import simulate_study

Progress = Callable[[int, int, str], None]

# What the simulated participants prefer, in natural log-odds: the paper's order (figures 7 and 8).
DEPTH_ABILITIES = {"id": -0.8, "dr": 0.1, "pm": 0.7}
FUSION_ABILITIES = {"fa": -0.4, "fb": 0.4}
ABILITIES = {f"{d}_{f}": round(x + y, 3) for d, x in DEPTH_ABILITIES.items() for f, y in FUSION_ABILITIES.items()}
TIE_RATE = 0.2
SEED = 1
ANALYSIS_TIMEOUT_S = 60


def demo_study(settings: Settings, manifest: Path, exposure_s: float, progress: Progress) -> dict[str, Any]:
    """The demo's study, created unless it is there."""
    if not list_studies(settings):
        create_study(settings, manifest, "Demo", exposure_s=exposure_s, seed=SEED, progress=progress)
    return list_studies(settings)[0]


def demo_votes(settings: Settings, url: str, study: Mapping[str, Any], participants: int, progress: Progress) -> int:
    """How many votes the study has, after simulated participants have voted unless somebody did before."""
    if study["n_votes"] or not participants:
        return int(study["n_votes"])
    result = simulate_study(settings, url, study["slug"], participants, ABILITIES, TIE_RATE, SEED, progress=progress)
    return int(result["votes"])


def demo_analysis(settings: Settings, url: str, slug: str, out: Path) -> dict[str, Any]:
    """The study's analysis as an analyst fetches it, also written into a folder."""
    headers = {"Authorization": f"Bearer {add_own_token(settings, 'demo')}"}
    answer = httpx.get(f"{url}/api/v1/studies/{slug}/analysis", headers=headers, timeout=ANALYSIS_TIMEOUT_S)
    analysis: dict[str, Any] = answer.raise_for_status().json()
    write_analysis(analysis, out, source="the demo's study")
    return analysis


def ability_sentence() -> str:
    """What the simulated participants prefer, to compare the scores with."""
    return ", ".join(f"{item} {ability:+.1f}" for item, ability in ABILITIES.items())
