"""Objective evaluation, beside the way from capture to video: it may use any stage, none uses it."""

from recon.validation.clouds import CloudFile, named_clouds
from recon.validation.cuboid.evaluation import CuboidSettings, measure_cuboids
from recon.validation.known_object.evaluation import ObjectSettings, measure_object
from recon.validation.measures import Subject
from recon.validation.sphere.evaluation import measure_spheres
from recon.validation.sphere.model import SphereSettings
from recon.validation.truth.evaluation import (
    MeshSettings,
    Shape,
    compare_points,
    measure_mesh,
    read_shape,
    signed_distances_to,
)
from recon.validation.views.evaluation import ViewSettings, measure_views

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
