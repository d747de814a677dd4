"""Measures of the quality of a cloud or mesh against a reference: those of MPEG, PointSSIM, and others by name."""

from recon.validation.cloud_quality.compared import SYMMETRIC, TO_DISTORTED, TO_REFERENCE, Value
from recon.validation.cloud_quality.evaluation import CloudSettings, measure_clouds
from recon.validation.cloud_quality.points import PointSet
from recon.validation.cloud_quality.reading import Sampling
from recon.validation.cloud_quality.sequences import find_compared

__all__ = [
    "SYMMETRIC",
    "TO_DISTORTED",
    "TO_REFERENCE",
    "CloudSettings",
    "PointSet",
    "Sampling",
    "Value",
    "find_compared",
    "measure_clouds",
]
