"""Measure a display's pixel size with a bank card, and the viewing distance by the blind spot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import mean, median

CARD_MM = (85.60, 53.98)  # ISO/IEC 7810, ID-1: every bank card
N_CARDS = 2  # measurements of the card
CARD_AGREEMENT = 0.02  # range of the widths, relative to their mean
PIXEL_RANGE_MM = (0.03, 2.0)  # from a telephone to a projector

BLIND_SPOT_DEG = 13.5  # from fixation to where a dot that moves outwards vanishes; Li et al. 2020, "Virtual chinrest"
N_BLIND_SPOTS = 5  # measurements of the blind spot
BLIND_SPOT_AGREEMENT = 0.25  # range of the repeats, relative to their median; beyond it the eye has moved
DISTANCE_RANGE_MM = (200.0, 6000.0)
BLIND_SPOT_RANGE_MM = (200.0, 2000.0)  # farther away no display is wide enough


class ImplausibleError(ValueError):
    """A measurement contradicts itself, or fits no display or person."""


def pixel_mm(card_widths: Sequence[float], device_pixel_ratio: float) -> float:
    """Return the pitch of a display's own pixels, mm, from the width of a bank card fitted to it.

    Parameters
    ----------
    card_widths : of the card in CSS pixels, from each measurement
    device_pixel_ratio : display pixels per CSS pixel

    Raises
    ------
    ImplausibleError
        If the widths differ by more than CARD_AGREEMENT, or no display has such pixels.
    """
    if len(card_widths) != N_CARDS or min(card_widths) <= 0:
        raise ImplausibleError(f"{len(card_widths)} widths of the card, expected {N_CARDS} that are positive")
    average = mean(card_widths)
    if max(card_widths) - min(card_widths) > CARD_AGREEMENT * average:
        widths = " and ".join(f"{width:.1f}" for width in card_widths)
        raise ImplausibleError(f"the card was {widths} pixels wide, expected widths within {CARD_AGREEMENT:.0%}")
    pitch = CARD_MM[0] / (average * device_pixel_ratio)
    if not PIXEL_RANGE_MM[0] <= pitch <= PIXEL_RANGE_MM[1]:
        raise ImplausibleError(f"pixels of {pitch:.3f} mm, expected {PIXEL_RANGE_MM[0]} to {PIXEL_RANGE_MM[1]} mm")
    return pitch


def checked_distance_mm(distance_mm: float) -> float:
    """Return a typed viewing distance, mm, if it is plausible.

    Raises
    ------
    ImplausibleError
        If nobody sits at this distance.
    """
    low, high = DISTANCE_RANGE_MM
    if not low <= distance_mm <= high:
        raise ImplausibleError(
            f"a distance of {distance_mm / 10:.0f} cm, expected {low / 10:.0f} to {high / 10:.0f} cm"
        )
    return distance_mm


def blind_spot_distance_mm(offsets_mm: Sequence[float]) -> float:
    """Return the distance of the eye, mm, from where on the display a dot vanished in its blind spot.

    Parameters
    ----------
    offsets_mm : from the fixated point to the dot, of each measurement

    Raises
    ------
    ImplausibleError
        If there are too few, they differ too much, or nobody sits there.

    Source
    ------
    Li, Joo, Yeatman and Reinecke 2020, "Controlling for participants' viewing distance in large-scale, psychophysical
    online experiments using a virtual chinrest", Scientific Reports 10: 904.
    """
    if len(offsets_mm) != N_BLIND_SPOTS or min(offsets_mm) <= 0:
        raise ImplausibleError(f"{len(offsets_mm)} times measured, expected {N_BLIND_SPOTS} lengths that are positive")
    middle = median(offsets_mm)
    if max(offsets_mm) - min(offsets_mm) > BLIND_SPOT_AGREEMENT * middle:
        offsets = f"{min(offsets_mm):.0f} to {max(offsets_mm):.0f} mm"
        raise ImplausibleError(f"the dot vanished at {offsets}, expected a range within {BLIND_SPOT_AGREEMENT:.0%}")
    distance = middle / math.tan(math.radians(BLIND_SPOT_DEG))
    low, high = BLIND_SPOT_RANGE_MM
    if not low <= distance <= high:
        raise ImplausibleError(f"a distance of {distance / 10:.0f} cm, expected {low / 10:.0f} to {high / 10:.0f} cm")
    return distance
