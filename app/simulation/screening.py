"""Let artificial participants take the screening over HTTP: they look at its pictures like anybody else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import httpx
import numpy as np

from app.simulation.observer import Observer
from app.study.screening.pictures import read_png
from app.study.screening.screening import FARTHEST_CM
from app.study.screening.viewing_distance import BLIND_SPOT_DEG, CARD_MM, N_BLIND_SPOTS, N_CARDS

Ask = Callable[[str, str, Mapping[str, Any] | None], httpx.Response]  # method, path, body

PIXEL_MM = 0.2  # of their display, whose pixel ratio is 1
WINDOW_HEIGHT = 1080
USUAL_DISTANCE_CM = 70.0
SCREENING = "/api/v1/session/screening"
TYPICAL_RESPONSE_MS = 1800.0


def take_screening(ask: Ask, observer: Observer, rng: np.random.Generator) -> None:
    """Measure the display, step back as far as is needed, and take every test.

    Parameters
    ----------
    ask : sends a request with the participant's token and returns the answer
    """
    screening = ask("GET", SCREENING, None).json()
    tests = [test["test"] for test in screening["tests"] if not test["is_over"]]
    if "acuity" in tests and not screening["tests"][0]["has_begun"]:
        _measure(ask, screening["distance"])
    for test in tests:
        _take(ask, test, observer, rng)


def _measure(ask: Ask, distance: str) -> None:
    widths = [CARD_MM[0] / PIXEL_MM] * N_CARDS
    card = {"card_widths": widths, "device_pixel_ratio": 1.0, "window_height": WINDOW_HEIGHT}
    screening = ask("PUT", f"{SCREENING}/display", card).json()
    if distance == "fixed":
        return
    if distance == "blind spot":
        offset = 10 * USUAL_DISTANCE_CM * float(np.tan(np.radians(BLIND_SPOT_DEG))) / PIXEL_MM
        screening = ask("PUT", f"{SCREENING}/distance", {"blind_spots": [offset] * N_BLIND_SPOTS}).json()
    else:
        screening = ask("PUT", f"{SCREENING}/distance", {"typed_cm": USUAL_DISTANCE_CM}).json()
    needed = screening["certificate"]["needed_distance_cm"]
    if not screening["certificate"]["can_certify"] and needed < FARTHEST_CM:
        ask("PUT", f"{SCREENING}/distance", {"typed_cm": float(needed)})


def _take(ask: Ask, test: str, observer: Observer, rng: np.random.Generator) -> None:
    answer = ask("GET", f"{SCREENING}/{test}", None)
    while answer.status_code != httpx.codes.NO_CONTENT:
        item = answer.json()
        picture = read_png(ask("GET", item["picture"], None).content)
        if test == "acuity":
            seen: int | None = observer.answer_ring(picture, item["size"], rng)
        else:
            direction = observer.answer_plate(picture, rng)
            seen = None if direction < 0 else direction
        body = {"answer": seen, "response_ms": round(TYPICAL_RESPONSE_MS * float(rng.lognormal(0, 0.4)), 1)}
        answer = ask("PUT", f"{SCREENING}/{test}/{item['number']}", body)
