"""Test colour vision with pseudoisochromatic plates of dots, before the trials (screening, not a diagnosis).

A ring with a gap differs from its ground only along the confusion line of one cone type: a person without these cones
sees only dots of random lightness. Plates are drawn anew each time, and only the server knows where a gap is.

Noise hides all other cues to the ring. Lightness varies from dot to dot. Colour varies too, across the confusion line;
otherwise rounding to 8 bits, and observers who differ from the standard one, would leave a cue in the ratio of the
other cones. Levels are rounded up or down at random, dot by dot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from app.study.screening.pictures import decode_srgb, direction_vector, encode_srgb

Axis = Literal["protan", "deutan", "tritan"]
PlateKind = Literal["protan", "deutan", "tritan", "control", "catch"]
Verdict = Literal["passed", "failed", "inconclusive"]
AXES: tuple[Axis, ...] = ("protan", "deutan", "tritan")
CONE_OF = {"protan": 0, "deutan": 1, "tritan": 2}  # the missing cone: long, middle, short
DIRECTIONS = (0, 2, 4, 6)  # of a plate's gap: right, up, left, down
NOTHING = -1  # the answer "I see no ring"

# Cone signals of linear sRGB (ITU-R BT.709 primaries), Smith and Pokorny fundamentals.
# Source: Vienot, Brettel and Mollon 1999, "Digital video colourmaps for checking the legibility of displays by
# dichromats", eq. 4. Plates and simulated observers use the same fundamentals.
CONES_FROM_RGB = np.array(
    [[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]], dtype=np.float64
)
RGB_FROM_CONES = np.linalg.inv(CONES_FROM_RGB)
XYZ_FROM_RGB = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)  # IEC 61966-2-1
LUMINANCE = XYZ_FROM_RGB[1]

# Distance of ring and ground in u'v': three times what people with normal vision need in the Cambridge Colour Test
# (Mollon and Regan 2000: limits of 0.010 and 0.015), for uncalibrated displays.
DISTANCE_UV = {"protan": 0.03, "deutan": 0.03, "tritan": 0.05}
MID_LUMINANCE = 0.31  # relative to the display's white
LUMINANCE_NOISE = 0.5  # half the range of a dot's log luminance
COLOUR_NOISE = {"protan": 0.2, "deutan": 0.2, "tritan": 0.03}  # of the short cone; tritan: of long against middle
MISSING_CONE_SHARE = 0.3  # 0: equal luminance for normal vision, 1: for vision without the cone
CONTROL_CONTRAST = 2.2  # luminance ratio of the control plate's ring, which everybody sees

SIDE = 640  # of a plate, pixels
RADIUS_RANGE = (6.0, 14.0)  # of a dot, pixels
SPACE = 1.5  # between dots, pixels
SHRINK = 0.93  # factor of the radius once no more dots of that size fit
GRID = 3  # pixels between possible centres of dots
RING_RADII = (0.42, 0.82)  # inner and outer, relative to the plate's radius
GAP_DEG = 70.0  # of the ring


@dataclass(frozen=True)
class ColourTest:
    """Settings of a colour vision test.

    Parameters
    ----------
    axes : confusion lines that are tested
    n_plates : of each axis
    n_misses : plates of an axis that a participant may miss and still pass: everybody slips
    n_catches : plates without a ring
    """

    axes: tuple[Axis, ...] = AXES
    n_plates: int = 5
    n_misses: int = 1
    n_catches: int = 2


@dataclass(frozen=True)
class PlannedPlate:
    """A plate before it is drawn; the same seed draws the same plate."""

    kind: PlateKind
    gap: int
    seed: int


@dataclass(frozen=True)
class Answer:
    """A plate's kind, the right answer, and the answer given; NOTHING means "no ring"."""

    kind: PlateKind
    right: int
    given: int

    @property
    def is_right(self) -> bool:
        return self.right == self.given


@dataclass(frozen=True)
class Dots:
    """The dots of a plate.

    Parameters
    ----------
    centre : float64 (N, 2), x and y in pixels from the plate's top left corner
    radius : float64 (N,), pixels
    is_figure : bool (N,), does a dot belong to the ring?
    rgb : uint8 (N, 3), sRGB
    """

    centre: NDArray[np.float64]
    radius: NDArray[np.float64]
    is_figure: NDArray[np.bool_]
    rgb: NDArray[np.uint8]


def plan_plates(test: ColourTest, rng: np.random.Generator) -> list[PlannedPlate]:
    """Plan all plates of a test: the control plate first, the others in random order."""
    kinds: list[PlateKind] = [axis for axis in test.axes for _ in range(test.n_plates)]
    kinds += ["catch"] * test.n_catches
    shuffled: list[PlateKind] = ["control", *(kinds[index] for index in rng.permutation(len(kinds)))]
    return [
        PlannedPlate(kind, NOTHING if kind == "catch" else int(rng.choice(DIRECTIONS)), int(rng.integers(2**31)))
        for kind in shuffled
    ]


def unsettled_kinds(answers: Sequence[Answer], test: ColourTest) -> set[PlateKind]:
    """Return the kinds of plate whose part of the verdict may still change: the others need not be shown any more."""
    needed = _needed(test)
    marks = [(answer.kind, answer.is_right) for answer in answers]
    allowed: dict[PlateKind, int] = {"control": 0, "catch": test.n_catches // 2}
    allowed |= dict.fromkeys(test.axes, test.n_misses)
    return {
        kind
        for kind, n in needed.items()
        if marks.count((kind, True)) < n and marks.count((kind, False)) <= allowed[kind]
    }


def _needed(test: ColourTest) -> dict[PlateKind, int]:
    """Return how many plates of each kind are to be answered right."""
    needed: dict[PlateKind, int] = {"control": 1, "catch": math.ceil(test.n_catches / 2)}
    return needed | dict.fromkeys(test.axes, test.n_plates - test.n_misses)


def judge_colours(answers: Sequence[Answer], test: ColourTest) -> tuple[Verdict, dict[str, Any]]:
    """Return the verdict of a test, and the right answers by kind of plate.

    A participant who misses the control plate, or sees rings on most plates without one, did not do the test as
    intended: the verdict is "inconclusive".

    Raises
    ------
    ValueError
        If the test is not over.
    """
    if missing := unsettled_kinds(answers, test):
        raise ValueError(f"the plates {sorted(missing)} are not all answered; the test is not over")
    needed = _needed(test)
    marks_by_kind = {kind: [answer.is_right for answer in answers if answer.kind == kind] for kind in needed}
    details = {kind: {"right": sum(marks), "of": len(marks)} for kind, marks in marks_by_kind.items()}
    failed = [axis for axis in test.axes if sum(marks_by_kind[axis]) < needed[axis]]
    is_valid = all(sum(marks_by_kind[kind]) >= needed[kind] for kind in ("control", "catch"))
    verdict: Verdict = "inconclusive" if not is_valid else "failed" if failed else "passed"
    return verdict, {"plates": details, "failed_axes": failed}


def make_dots(plate: PlannedPlate) -> Dots:
    """Place and colour the dots of a plate."""
    rng = np.random.default_rng(plate.seed)
    centre, radius = _pack(rng)
    is_figure = is_on_ring(centre, SIDE, plate.gap) if plate.gap != NOTHING else np.zeros(len(radius), bool)
    return Dots(centre, radius, is_figure, dot_colours(plate.kind, is_figure, rng))


def dot_colours(kind: PlateKind, is_figure: NDArray[np.bool_], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the colours of a plate's dots.

    Parameters
    ----------
    kind : of plate; a catch plate gets the ground of a random axis
    is_figure : bool (N,), does a dot belong to the ring?
    rng : Generator

    Returns
    -------
    uint8 (N, 3), sRGB
    """
    if kind == "control":
        contrast = np.where(is_figure, CONTROL_CONTRAST**0.5, CONTROL_CONTRAST**-0.5)
        return _rounded(_coloured("protan", np.zeros(len(is_figure)), rng) * contrast[:, None], rng)
    axis: Axis = AXES[int(rng.integers(len(AXES)))] if kind == "catch" else kind
    return _rounded(_coloured(axis, np.where(is_figure, 0.5, -0.5), rng), rng)


def draw_plate(plate: PlannedPlate) -> NDArray[np.uint8]:
    """Draw a plate.

    Returns
    -------
    uint8 (SIDE, SIDE, 3), sRGB, dots on mid-grey
    """
    dots = make_dots(plate)
    picture = np.full((SIDE, SIDE, 3), 128, np.uint8)
    for centre, radius, rgb in zip(dots.centre, dots.radius, dots.rgb, strict=True):
        low = np.maximum(np.floor(centre - radius - 1).astype(int), 0)
        high = np.minimum(np.ceil(centre + radius + 1).astype(int), SIDE)
        columns, rows = (np.arange(low[axis], high[axis]) + 0.5 - centre[axis] for axis in (0, 1))
        cover = np.clip(radius + 0.5 - np.hypot(columns[None, :], rows[:, None]), 0, 1)[..., None]
        place = picture[low[1] : high[1], low[0] : high[0]]
        place[...] = np.round(cover * rgb + (1 - cover) * place)
    return picture


def _coloured(axis: Axis, side: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Return linear RGB (N, 3) of dots on either side of grey along a confusion line, with all noise but rounding.

    Parameters
    ----------
    side : float64 (N,), 0.5 for the ring, -0.5 for the ground
    """
    n = len(side)
    cones = np.tile(CONES_FROM_RGB.sum(axis=1), (n, 1))
    cones[:, CONE_OF[axis]] *= 1 + side * _contrast(axis)
    noise = COLOUR_NOISE[axis] * rng.uniform(-1, 1, n)
    if axis == "tritan":
        cones[:, 0] *= 1 + noise
        cones[:, 1] *= 1 - noise
    else:
        cones[:, 2] *= 1 + noise
    luminance = MID_LUMINANCE * np.exp(LUMINANCE_NOISE * rng.uniform(-1, 1, n))
    return np.asarray((_levelled(cones, axis) @ RGB_FROM_CONES.T) * luminance[:, None])


def _levelled(cones: NDArray[np.float64], axis: Axis) -> NDArray[np.float64]:
    """Scale cone signals (N, 3) to a luminance near white's, both for normal vision and without the cone."""
    luminance = cones @ RGB_FROM_CONES.T @ LUMINANCE
    kept = 1 if axis == "protan" else 0  # the cone that carries luminance; the short cone carries none
    without = cones[:, kept] / CONES_FROM_RGB[kept].sum()
    share = MISSING_CONE_SHARE if axis != "tritan" else 0.0
    return np.asarray(cones / (luminance ** (1 - share) * without**share)[:, None])


def _contrast(axis: Axis) -> float:
    """Return the difference of the tested cone's signal that separates ring and ground by `DISTANCE_UV`."""
    white = CONES_FROM_RGB.sum(axis=1)
    low, high = 0.0, 1.9
    while high - low > 1e-6:
        middle = (low + high) / 2
        cones = np.tile(white, (2, 1))
        cones[:, CONE_OF[axis]] *= 1 + np.array([0.5, -0.5]) * middle
        first, second = chromaticity(cones @ RGB_FROM_CONES.T)
        is_far = math.dist(first, second) >= DISTANCE_UV[axis]
        low, high = (low, middle) if is_far else (middle, high)
    return high


def chromaticity(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return CIE 1976 u'v', float64 (N, 2), of linear sRGB, float64 (N, 3)."""
    x, y, z = (rgb @ XYZ_FROM_RGB.T).T
    return np.asarray(np.stack([4 * x, 9 * y], axis=1) / (x + 15 * y + 3 * z)[:, None])


def _rounded(rgb: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return 8-bit sRGB levels, rounded up or down at random, so without bias on average."""
    levels = 255 * encode_srgb(rgb)
    return np.clip(np.floor(levels + rng.random(levels.shape)), 0, 255).astype(np.uint8)


def _pack(rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centres (N, 2) and radii (N,), pixels, of dots that fill a disc without touching, large ones first."""
    x, y = np.meshgrid(*[np.arange(GRID / 2, SIDE, GRID)] * 2)
    free = SIDE / 2 - SPACE - np.hypot(x - SIDE / 2, y - SIDE / 2)  # the largest radius that fits at each place
    reach = math.ceil((2 * RADIUS_RANGE[1] + SPACE) / GRID) + 1
    centres: list[tuple[float, float]] = []
    radii: list[float] = []
    radius = RADIUS_RANGE[1]
    while True:
        candidates = np.flatnonzero(free >= radius)
        if len(candidates) == 0:
            if radius <= RADIUS_RANGE[0]:
                return np.array(centres), np.array(radii)
            radius = max(RADIUS_RANGE[0], radius * SHRINK)
            continue
        row, column = divmod(int(rng.choice(candidates)), free.shape[1])
        window = slice(max(row - reach, 0), row + reach + 1), slice(max(column - reach, 0), column + reach + 1)
        centre = x[row, column], y[row, column]
        free[window] = np.minimum(free[window], np.hypot(x[window] - centre[0], y[window] - centre[1]) - radius - SPACE)
        centres.append(centre)
        radii.append(radius * rng.uniform(SHRINK, 1))


def is_on_ring(place: NDArray[np.float64], side: float, gap: int) -> NDArray[np.bool_]:
    """Return which points of a plate belong to a ring with a gap, bool (N,).

    Parameters
    ----------
    place : float64 (N, 2), x and y from the plate's top left corner
    side : of the plate, in the same unit
    gap : direction of the gap
    """
    x, y = 2 * place[:, 0] / side - 1, 1 - 2 * place[:, 1] / side
    distance = np.hypot(x, y)
    u, v = direction_vector(gap)
    towards = np.arccos(np.clip((x * u + y * v) / np.maximum(distance, 1e-9), -1, 1))
    is_gap = towards < math.radians(GAP_DEG / 2)
    return np.asarray((distance >= RING_RADII[0]) & (distance <= RING_RADII[1]) & ~is_gap)


def cone_signals(rgb: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return cone signals, float64 (…, 3), of 8-bit sRGB, uint8 (…, 3), on a display."""
    return np.asarray(decode_srgb(rgb / 255.0) @ CONES_FROM_RGB.T)
