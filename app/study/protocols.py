"""Define the protocols of a study: comparing two films, or rating films one by one, and on which scale.

Source
------
ITU-T P.910 (10/2023), "Subjective video quality assessment methods for multimedia applications": ACR, ACR-HR, DCR, CCR
and PC, the names of their grades, and the scales of 9 and 11 grades. ITU-R BT.500-15 calls DCR the double-stimulus
impairment scale (DSIS).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

from app.study.option_fields import SettingError

Text = TypeVar("Text")
Protocol = Literal["PC", "ACR", "ACR-HR", "DCR", "CCR"]
PC: Protocol = "PC"  # pair comparison: which of two is better, or neither
ACR: Protocol = "ACR"  # absolute category rating: how good is this film?
ACR_HR: Protocol = "ACR-HR"  # the same with the reference hidden among the films
DCR: Protocol = "DCR"  # degradation category rating: how much worse than the reference is this film?
CCR: Protocol = "CCR"  # comparison category rating: how much better is B than A?
PROTOCOLS: tuple[Protocol, ...] = (PC, ACR, ACR_HR, DCR, CCR)
RATED = (ACR, ACR_HR, DCR)  # each rating is of one item
SHOWN_ALONE = (ACR, ACR_HR)  # a trial shows one film
WITH_REFERENCE = (ACR_HR, DCR)  # need the option `reference`

Scale = Literal[5, 9, 11, "slider"]
SLIDER: Scale = "slider"
SCALES: tuple[Scale, ...] = (5, 9, 11, SLIDER)
ENDS: Mapping[Scale, tuple[int, int]] = {5: (1, 5), 9: (1, 9), 11: (0, 10), SLIDER: (0, 100)}  # worst, best
KEY_OF_TEN = "X"  # as the Romans wrote it; the digits are taken
COMPARISON_END = 3  # of the 7 grades of CCR, around "the same"
EXPOSURE_BOUNDS_S = (0.1, 3600.0)  # of a trial's film

IN_PROTOCOLS = "protocols."  # begins the keys of texts that differ between protocols

GradeNames = Literal["quality", "impairment", "comparison"]  # under this key in the participants' texts


@dataclass(frozen=True)
class Grade:
    """An answer on a scale.

    Parameters
    ----------
    value : the rating
    name : its place among the names of the grades, from the worst; None: it has no name
    key : the digit that chooses it, or X for ten
    """

    value: int
    name: int | None
    key: str


@dataclass(frozen=True)
class Grades:
    """The scale of a study.

    Parameters
    ----------
    low, high : worst and best rating, whole numbers
    names : which names the grades have
    is_slider : is any whole number between them set by a slider?
    """

    low: int
    high: int
    names: GradeNames
    is_slider: bool = False

    @property
    def steps(self) -> tuple[Grade, ...]:
        """The grades from the worst; none of a slider."""
        values = () if self.is_slider else range(self.low, self.high + 1)
        return tuple(Grade(value, self._name(value), self._key(value)) for value in values)

    def _name(self, value: int) -> int | None:
        """Return the place of a grade's name; of 9 and 11 grades only the odd ones have the five names."""
        if self.high in (COMPARISON_END, 5):
            return value - self.low
        return value // 2 if value % 2 else None

    def _key(self, value: int) -> str:
        number = value if self.low >= 0 else value - self.low + 1
        return KEY_OF_TEN if number == 10 else str(number)

    def holds(self, rating: int) -> bool:
        """Is the rating on the scale?"""
        return self.low <= rating <= self.high


def grades_of(protocol: Protocol, scale: Scale) -> Grades | None:
    """Return the scale that a study's participants rate on; None where they choose the better of two.

    Parameters
    ----------
    protocol, scale : options of the study
    """
    if protocol == PC:
        return None
    if protocol == CCR:
        return Grades(-COMPARISON_END, COMPARISON_END, "comparison")
    return Grades(*ENDS[scale], "impairment" if protocol == DCR else "quality", is_slider=scale == SLIDER)


def typed_scale(text: str) -> int | str:
    """Return a scale as it was typed, for `parse_options` to check: numbers of grades are numbers."""
    return int(text) if text.isdecimal() else text


def stored_scale(text: str | None) -> Scale:
    """Return the scale that a database tells as text; None: the study was made before there were scales."""
    return next((scale for scale in SCALES if str(scale) == text), SCALES[0])


def check_with_protocol(protocol: Protocol, scale: Scale, reference: str, only_of_pairs: Mapping[str, object]) -> None:
    """Check a study's other options against its protocol.

    Parameters
    ----------
    protocol, scale : the study's
    reference : the option, empty for none
    only_of_pairs : options that only a study of pairs has, with their values

    Raises
    ------
    ValueError
        If the reference is missing or of no use, or an option is on that the protocol does not have.
    """
    if scale != SCALES[0] and protocol in (PC, CCR):
        answers = "three answers" if protocol == PC else "seven grades"
        raise SettingError(
            "scale", f"is {scale!r}, but protocol {protocol} always has {answers}: expected {SCALES[0]}, or nothing"
        )
    if protocol in WITH_REFERENCE and not reference:
        raise SettingError("protocol", f"{protocol} needs a reference: name one of the conditions as `reference`")
    if protocol == ACR and reference:
        raise SettingError(
            "reference",
            f"is {reference!r}, but protocol ACR shows none: choose ACR-HR to hide it among the films, or "
            "DCR to rate each film against it",
        )
    for name, value in only_of_pairs.items():
        if value and protocol in RATED:
            raise SettingError(name, f"is {value!r}, but protocol {protocol} compares no pairs: leave {name} out")


def texts_of(texts: Mapping[str, Text], protocol: Protocol) -> dict[str, Text]:
    """Return participants' texts with those that fit the protocol in place; the others are those of pair comparison.

    Parameters
    ----------
    texts : in one language by key; "protocols.DCR.trial.label" is what DCR says in place of "trial.label"
    protocol : the study's
    """
    start = f"{IN_PROTOCOLS}{ACR if protocol in SHOWN_ALONE else protocol}."
    fitting = {key.removeprefix(start): text for key, text in texts.items() if key.startswith(start)}
    return {key: text for key, text in {**texts, **fitting}.items() if not key.startswith(IN_PROTOCOLS)}
