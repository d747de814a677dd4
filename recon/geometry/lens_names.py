"""The names that programs give to the models of lenses, and the keys at which calibrations have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

NAME_KEYS = ("distortion_model", "distortionModel", "camera_model", "projection_model", "model")
PERSPECTIVE = (
    "plumb_bob",
    "radtan",
    "radial_tangential",
    "brown_conrady",
    "rational_polynomial",
    "thin_prism",
    "pinhole",
    "perspective",
    "opencv",
    "full_opencv",
    "none",
)
UNLIKE = ("inverse_brown_conrady", "modified_brown_conrady")  # of RealSense: other formulas, mostly without numbers
FISHEYE = ("equidistant", "fisheye", "kannala_brandt", "kannala_brandt4", "kb4", "kannalabrandt8", "opencv_fisheye")
FISHEYE_KEY = "fisheye_model"  # 1 or 0, as OpenCV's program of one camera writes it


def plain_name(model: str | None) -> str | None:
    """Return a model's name in the spelling of PERSPECTIVE and FISHEYE."""
    return None if model is None else model.lower().replace("-", "_").replace(" ", "_")


def model_name(*entries: Mapping[str, Any]) -> str | None:
    """Return the first name of a camera's model in parts of a calibration; None where nothing names it."""
    if any(entry.get(FISHEYE_KEY) in (1, "1") for entry in entries):
        return FISHEYE[0]
    return next((str(entry[key]) for entry in entries for key in NAME_KEYS if isinstance(entry.get(key), str)), None)
