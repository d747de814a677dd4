"""From the sensors' clouds to one mesh: ours, in two orders, and two baselines by Open3D."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from inspect import signature
from typing import Any

from recon.fusion.orders import LeftOutWarning, fuse_after, fuse_before
from recon.fusion.poisson import PoissonParameters, fuse_poisson
from recon.fusion.tsdf import TsdfParameters, fuse_tsdf
from recon.fusion.views import DepthView, view_of_cloud
from recon.geometry.mesh import Cloud, Mesh

__all__ = [
    "FUSIONS",
    "DepthView",
    "Fusion",
    "LeftOutWarning",
    "PoissonParameters",
    "TsdfParameters",
    "fuse_after",
    "fuse_before",
    "fuse_poisson",
    "fuse_tsdf",
    "fused",
    "view_of_cloud",
]

# of the sensors' clouds, and of the fusion's parameters; with a parameter `views`, of the sensors' depth views, too
Fusion = Callable[..., Mesh]

FUSIONS: dict[str, Fusion] = {"fa": fuse_after, "fb": fuse_before, "poisson": fuse_poisson, "tsdf": fuse_tsdf}


def asks_for_views(fusion: Fusion) -> bool:
    """Tell whether a fusion works on depth maps: it then has a parameter `views`."""
    return "views" in signature(fusion).parameters


def fused(
    fusion: Fusion, clouds: Sequence[Cloud], parameters: Any = None, views: Sequence[DepthView] | None = None
) -> tuple[Mesh, list[str]]:
    """Fuse clouds; returns the mesh, and a sentence for each cloud that was left out.

    Parameters
    ----------
    fusion : one of `FUSIONS`, or another of the same form
    clouds : one per sensor
    parameters : of the fusion; None for its defaults
    views : the clouds' points as depth maps, for fusions that ask for them; None where the cameras are not known

    Raises
    ------
    ValueError
        If the fusion asks for views and there are none, or raises it.
    """
    given = () if parameters is None else (parameters,)
    more: dict[str, Any] = {}
    if asks_for_views(fusion):
        if views is None:
            raise ValueError("this fusion needs depth maps with their cameras, not clouds alone: use `reconstruct`")
        more = {"views": views}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", LeftOutWarning)
        mesh = fusion(clouds, *given, **more)
    return mesh, [str(warning.message) for warning in caught]
