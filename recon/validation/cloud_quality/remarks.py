"""What makes a comparison of two clouds doubtful, or senseless: another unit or place, merged points, blank normals."""

from __future__ import annotations

import numpy as np

from recon.geometry.mesh import Shape
from recon.validation.cloud_quality.compared import Pair
from recon.validation.cloud_quality.points import PointSet
from recon.validation.cloud_quality.reading import Sampling, area_of, sampled
from recon.validation.clouds import size_remarks

FEW_POINTS = 1000  # on a mesh, which tell its size


def check_unit(shape: Shape, name: str, reference: PointSet) -> None:
    """Raise a ValueError if a mesh must be in another unit than the reference.

    Points as dense as the reference's, of which there would be far too many or next to none, could not tell.

    Parameters
    ----------
    shape, name : a mesh, and its file for messages; of a cloud, `remarks_on` tells
    reference : what it is compared with
    """
    if (area := area_of(shape)) > 0:
        few = sampled(shape, name, Sampling(FEW_POINTS / area))
        size_remarks((name, reference.name), few.points, reference.points)


def remarks_on(pair: Pair) -> list[str]:
    """Return sentences on what makes a comparison doubtful; raise a ValueError if it makes no sense."""
    distorted, reference = pair.distorted.cloud, pair.reference.cloud
    sizes = size_remarks((distorted.name, reference.name), distorted.points, reference.points)
    return [*sizes, *_normal_remarks(reference)] + [
        f"{each.cloud.name}: {n_merged} of {len(each.cloud)} points lie where another does; "
        "all measures but Chamfer and F-score take them as one"
        for each in (pair.distorted, pair.reference)
        if (n_merged := len(each.cloud) - len(each.places.points))
    ]


def _normal_remarks(reference: PointSet) -> list[str]:
    if reference.normals is None or not (n_blank := np.count_nonzero(~reference.normals.any(axis=1))):
        return []
    return [f"{reference.name}: {n_blank} of {len(reference)} normals are (0, 0, 0); D2 sees no error there"]
