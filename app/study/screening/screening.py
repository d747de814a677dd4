"""Run a study's vision screening: its tests, their limits, the next ring or plate, and the verdict.

The server stores a test's setup and its items so far, and nothing else. Any process can therefore continue a test, and
the right answers never leave the server.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from app.study.option_fields import Different, ListOf, Options, Setting, SettingError
from app.study.screening.acuity import (
    FEWEST_GAP_PIXELS,
    AcuityTest,
    Ring,
    gap_arcmin,
    gap_mm,
    judge,
    next_size,
    smallest_size,
)
from app.study.screening.colour_vision import (
    AXES,
    DIRECTIONS,
    NOTHING,
    Answer,
    Axis,
    ColourTest,
    PlannedPlate,
    draw_plate,
    judge_colours,
    plan_plates,
    unsettled_kinds,
)
from app.study.screening.pictures import RING, landolt_ring

TestName = Literal["acuity", "colour"]
Distance = Literal["typed", "fixed", "blind spot"]
Rule = Literal["record", "stop"]
Verdict = Literal["passed", "failed", "cannot be certified", "inconclusive", "not taken"]

TESTS: tuple[TestName, ...] = ("acuity", "colour")
NOT_TAKEN: Verdict = "not taken"
ENTERED_VERDICTS: tuple[Verdict, ...] = ("passed", "failed")
NEAREST_CM, FARTHEST_CM = 20.0, 600.0  # of a fixed distance
RING_SHARE = 0.5  # of the window's height, for the largest ring
LARGEST_GAP_PX = 200.0  # larger rings add no information and take long to send


Word = TypeVar("Word")
SomeOf = Annotated[ListOf[Word], Field(min_length=1), Different]


class ScreeningOptions(Options):
    """The tests of a study's screening, and the consequences of failing."""

    tests: Annotated[
        SomeOf[TestName],
        Setting("Tests", "that are taken", choices={"acuity": "acuity", "colour": "colour vision"}),
    ] = TESTS
    acuity_limit: Annotated[
        float, Setting("Required acuity, logMAR", "0.18 is 20/30; larger is worse", step="0.01")
    ] = Field(default=0.18, ge=-0.3, le=1)  # log10(30/20): the 20/30 line that ITU-T P.910 asks for
    distance: Annotated[
        Distance,
        Setting(
            "Viewing distance",
            "how it is known",
            choices={
                "typed": "the participant types it",
                "fixed": "fixed by the laboratory",
                "blind spot": "measured with the blind spot",
            },
        ),
    ] = "typed"
    distance_cm: Annotated[float | None, Setting("Fixed distance, cm", "only for a fixed distance", step="0.5")] = (
        Field(default=None, ge=NEAREST_CM, le=FARTHEST_CM)
    )
    colour_axes: Annotated[
        SomeOf[Axis],
        Setting(
            "Colour plates",
            "confusion lines that are tested",
            choices={"protan": "protan", "deutan": "deutan", "tritan": "tritan"},
        ),
    ] = AXES
    colour_misses: Annotated[int, Setting("Plates that may be missed", "of each confusion line")] = Field(
        default=1, ge=0, le=ColourTest.n_plates - 1
    )
    on_failure: Annotated[
        Rule,
        Setting(
            "A participant who does not pass",
            "or who skips a test",
            choices={"record": "takes part; the experimenter decides", "stop": "goes no further"},
        ),
    ] = "record"

    @model_validator(mode="after")
    def _has_distance_where_fixed(self) -> Self:
        place, words = "screening.distance_cm", f"the viewing distance is {self.distance!r}"
        if self.distance == "fixed" and self.distance_cm is None:
            raise SettingError(place, f"is empty, but {words}: expected a number")
        if self.distance != "fixed" and self.distance_cm is not None:
            raise SettingError(place, f"is {self.distance_cm:g}, but {words}: expected it with 'fixed' only")
        return self

    def stops(self, verdicts: Sequence[str]) -> bool:
        """Does the study end for a participant with these verdicts? A test that could not be judged stops nobody."""
        return self.on_failure == "stop" and any(verdict in ("failed", NOT_TAKEN) for verdict in verdicts)


@dataclass(frozen=True)
class EnteredResult:
    """The result of a test beside the screen, such as a printed chart, as an experimenter enters it.

    Parameters
    ----------
    test : what was tested
    instrument : chart, plates or device, with its distance where it matters
    result : as it was read
    verdict : passed or failed
    logmar : of acuity; None: the result is no logMAR
    """

    test: TestName
    instrument: str
    result: str
    verdict: Verdict
    logmar: float | None = None


@dataclass(frozen=True)
class Item:
    """A ring or plate: its content, and the answer, None until it is given."""

    content: Mapping[str, Any]
    answer: int | None


def check_entered(entered: EnteredResult, options: ScreeningOptions) -> None:
    """Check that an entered result does not contradict itself or the study's limit.

    Raises
    ------
    ValueError
        Naming what is wrong.
    """
    if not entered.instrument or not entered.result:
        raise ValueError("instrument and result are needed: what was tested with, and what was read")
    if entered.verdict not in ENTERED_VERDICTS:
        raise ValueError(f"the verdict is {entered.verdict!r}, expected {' or '.join(ENTERED_VERDICTS)}")
    if entered.logmar is None:
        return
    if entered.test != "acuity":
        raise ValueError(f"logMAR is {entered.logmar:g} for the test {entered.test!r}, expected it only for acuity")
    right = "passed" if entered.logmar <= options.acuity_limit else "failed"
    if entered.verdict != right:
        raise ValueError(
            f"the verdict is {entered.verdict!r}, but {entered.logmar:g} logMAR against the study's limit of "
            f"{options.acuity_limit:g} is {right!r}; larger is worse"
        )


def acuity_setup(
    options: ScreeningOptions, pixel_mm: float, distance_mm: float, height_px: int, seed: int
) -> dict[str, Any]:
    """Set up an acuity test for this display at this distance.

    Parameters
    ----------
    options : with the limit
    pixel_mm : pitch of the display's own pixels
    distance_mm : from the eye to the display
    height_px : of the window, in the display's own pixels; the largest ring must fit into it
    seed : of the directions
    """
    largest_gap_mm = min(max(RING_SHARE * height_px / RING, FEWEST_GAP_PIXELS), LARGEST_GAP_PX) * pixel_mm
    return {
        "limit": options.acuity_limit,
        "n_trials": AcuityTest.n_trials,
        "smallest": round(smallest_size(pixel_mm, distance_mm), 4),
        "largest": round(math.log10(gap_arcmin(largest_gap_mm, distance_mm)), 4),
        "pixel_mm": pixel_mm,
        "distance_mm": distance_mm,
        "seed": seed,
    }


def colour_setup(options: ScreeningOptions, seed: int) -> dict[str, Any]:
    """Set up a test of colour vision."""
    return {"axes": list(options.colour_axes), "n_misses": options.colour_misses, "seed": seed}


def n_items(test: TestName, setup: Mapping[str, Any]) -> int:
    """Count the rings or plates that a test has at most: it ends when its verdict is certain."""
    return int(setup["n_trials"]) if test == "acuity" else len(_plan(setup))


def next_content(test: TestName, setup: Mapping[str, Any], items: Sequence[Item]) -> dict[str, Any] | None:
    """Return the next ring or plate once all before it are answered; None when the test is over.

    Parameters
    ----------
    test : its name
    setup : as from `acuity_setup` or `colour_setup`
    items : so far, all answered
    """
    if test == "acuity":
        size = next_size(_rings(items), acuity_test(setup))
        gap = int(np.random.default_rng([setup["seed"], len(items)]).integers(8))
        return None if size is None else {"size": size, "gap": gap}
    shown = {item.content["seed"] for item in items}
    kinds = unsettled_kinds(_answers(items), _colour_test(setup))
    left = (plate for plate in _plan(setup) if plate.seed not in shown and plate.kind in kinds)
    return next(({"kind": plate.kind, "gap": plate.gap, "seed": plate.seed} for plate in left), None)


def is_possible(test: TestName, answer: int) -> bool:
    """Is the answer one that the test offers?"""
    return answer in range(8) if test == "acuity" else answer in (*DIRECTIONS, NOTHING)


def draw(test: TestName, setup: Mapping[str, Any], content: Mapping[str, Any]) -> NDArray[np.uint8]:
    """Draw a ring in the display's own pixels, or a plate.

    Parameters
    ----------
    test : its name
    setup : as from `acuity_setup` or `colour_setup`
    content : of the ring or plate, as from `next_content`

    Returns
    -------
    uint8 (H, H) sRGB grey levels of a ring, or (H, H, 3) sRGB of a plate
    """
    if test == "acuity":
        return landolt_ring(gap_mm(content["size"], setup["distance_mm"]) / setup["pixel_mm"], content["gap"])
    return draw_plate(PlannedPlate(content["kind"], content["gap"], content["seed"]))


def verdict_of(test: TestName, setup: Mapping[str, Any], items: Sequence[Item]) -> tuple[Verdict, dict[str, Any]]:
    """Return the verdict of a completed test, with its numbers.

    Parameters
    ----------
    test : its name
    setup : as from `acuity_setup` or `colour_setup`
    items : all, answered
    """
    if test == "colour":
        return judge_colours(_answers(items), _colour_test(setup))
    acuity = judge(_rings(items), acuity_test(setup))
    names = ("logmar", "low", "high", "is_bound")
    return acuity.verdict, {name: getattr(acuity, name) for name in names}


def acuity_test(setup: Mapping[str, Any]) -> AcuityTest:
    return AcuityTest(setup["limit"], setup["n_trials"], setup["smallest"], setup["largest"])


def _rings(items: Sequence[Item]) -> list[Ring]:
    return [Ring(item.content["size"], item.content["gap"], _given(item)) for item in items]


def _answers(items: Sequence[Item]) -> list[Answer]:
    return [Answer(item.content["kind"], item.content["gap"], _given(item)) for item in items]


def _given(item: Item) -> int:
    if item.answer is None:
        raise ValueError("an item is not answered; expected all but the last to be")
    return item.answer


def _colour_test(setup: Mapping[str, Any]) -> ColourTest:
    return ColourTest(axes=tuple(setup["axes"]), n_misses=setup["n_misses"])


def _plan(setup: Mapping[str, Any]) -> list[PlannedPlate]:
    return plan_plates(_colour_test(setup), np.random.default_rng(setup["seed"]))
