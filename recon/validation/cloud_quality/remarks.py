"""What makes a comparison of two clouds doubtful, or senseless: another unit or place, merged points, blank normals."""

from __future__ import annotations

import numpy as np

from recon.validation.cloud_quality.compared import Pair
from recon.validation.cloud_quality.points import PointSet, diagonal

ODD_SCALE, OTHER_UNIT = 8.0, 75.0  # ratios of size: to be remarked; to be refused, with room for noise below 100
NEAR_UNIT = 0.25  # relative difference from the ratio of two units
TELLING = 50  # points; fewer say nothing about scale
UNITS_APART = {1000: "metres against millimetres", 100: "metres against centimetres"}


def remarks_on(pair: Pair) -> list[str]:
    """Return sentences on what makes a comparison doubtful; raise a ValueError if it makes no sense."""
    distorted, reference = pair.distorted.cloud, pair.reference.cloud
    return [*_size_remarks(distorted, reference), *_normal_remarks(reference)] + [
        f"{each.cloud.name}: {n_merged} of {len(each.cloud)} points lie where another does; "
        "all measures but Chamfer and F-score take them as one"
        for each in (pair.distorted, pair.reference)
        if (n_merged := len(each.cloud) - len(each.places.points))
    ]


def _size_remarks(distorted: PointSet, reference: PointSet) -> list[str]:
    size, real_size = diagonal(distorted), diagonal(reference)
    if min(len(distorted), len(reference)) < TELLING or not min(size, real_size) > 0:
        return []
    ratio = max(size, real_size) / min(size, real_size)
    if ratio >= ODD_SCALE:
        unit = next((unit for unit in UNITS_APART if abs(ratio / unit - 1) < NEAR_UNIT), None)
        doubt = "." if unit is None else f": {UNITS_APART[unit]}?"
        relation = "larger" if size > real_size else "smaller"
        sentence = (
            f"{distorted.name}: is about {_round_figure(unit or ratio)} times {relation} than its reference "
            f"{reference.name} (diagonals {size:.3g} and {real_size:.3g}){doubt}"
        )
        if ratio >= OTHER_UNIT:
            raise ValueError(f"{sentence} Bring both to one unit first")
        return [sentence]
    low, high = distorted.points.min(axis=0), distorted.points.max(axis=0)
    if (low > reference.points.max(axis=0)).any() or (high < reference.points.min(axis=0)).any():
        return [
            f"{distorted.name}: lies wholly beside its reference {reference.name}; are both in the same coordinates?"
        ]
    return []


def _normal_remarks(reference: PointSet) -> list[str]:
    if reference.normals is None or not (n_blank := np.count_nonzero(~reference.normals.any(axis=1))):
        return []
    return [f"{reference.name}: {n_blank} of {len(reference)} normals are (0, 0, 0); D2 sees no error there"]


def _round_figure(ratio: float) -> str:
    """Write a ratio with two digits, and spaces between thousands."""
    digits = 1 - int(np.floor(np.log10(ratio)))
    return f"{round(ratio, digits):,.0f}".replace(",", " ")
