"""Objective evaluation, beside the way from capture to video: it may use any stage, none uses it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from recon.geometry.mesh import Shape
    from recon.validation.clouds import CloudFile, named_clouds, read_shape
    from recon.validation.cuboid.evaluation import CuboidSettings, measure_cuboids
    from recon.validation.known_object.evaluation import ObjectSettings, measure_object
    from recon.validation.measures import Subject
    from recon.validation.sphere.evaluation import measure_spheres
    from recon.validation.sphere.fit.model import SphereSettings
    from recon.validation.truth.evaluation import (
        MeshSettings,
        compare_points,
        measure_mesh,
        signed_distances_to,
    )
    from recon.validation.views.evaluation import ViewSettings, measure_views

_MODULES = {
    "clouds": ("CloudFile", "Shape", "named_clouds", "read_shape"),
    "cuboid.evaluation": ("CuboidSettings", "measure_cuboids"),
    "known_object.evaluation": ("ObjectSettings", "measure_object"),
    "measures": ("Subject",),
    "sphere.evaluation": ("measure_spheres",),
    "sphere.fit.model": ("SphereSettings",),
    "truth.evaluation": (
        "MeshSettings",
        "compare_points",
        "measure_mesh",
        "signed_distances_to",
    ),
    "views.evaluation": ("ViewSettings", "measure_views"),
}


def __getattr__(name: str) -> object:
    """Import an evaluation when it is asked for: all of them take seconds."""
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "CloudFile",
    "CuboidSettings",
    "MeshSettings",
    "ObjectSettings",
    "Shape",
    "SphereSettings",
    "Subject",
    "ViewSettings",
    "compare_points",
    "measure_cuboids",
    "measure_mesh",
    "measure_object",
    "measure_spheres",
    "measure_views",
    "named_clouds",
    "read_shape",
    "signed_distances_to",
]
