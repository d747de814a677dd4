"""The names that programs give to the models of lenses, and the keys at which calibrations have them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

NAME_KEYS = (
    "distortion_model",
    "distortion_type",
    "camera_model",
    "projection_model",
    "projection_type",
    "lens_model",
    "lens_type",
    "model_type",
    "model",
)  # in any case, with or without lines between the words, and of one camera of a pair: DistortionModel1
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
MOST_NUMBERS = {"none": 0, "plumb_bob": 5, "radtan": 5, "radial_tangential": 5, "brown_conrady": 5}  # the others: 14
UNLIKE = ("inverse_brown_conrady", "modified_brown_conrady")  # of RealSense: other formulas, mostly without numbers
FISHEYE = ("equidistant", "fisheye", "kannala_brandt", "kannala_brandt4", "kb4", "kannalabrandt8", "opencv_fisheye")
FISHEYE_KEY = "fisheye_model"  # 1 or 0, as OpenCV's program of one camera writes it
TITLES = (
    "id",
    "name",
    "camera_name",
    "image",
    "title",
    "comment",
)  # keys at which such a word may stand and mean no lens
UNREAD = ("omnidirectional", "omni", "mei", "unified", "fov", "double_sphere", "eucm", "scaramuzza", "ocam", "ftheta")
OTHERS = (*FISHEYE, *UNREAD)
KEY_FORMS = tuple(
    re.compile(key.replace("_", "[_ -]?") + "[_ -]?(1|2|left|right)?", re.IGNORECASE) for key in NAME_KEYS
)


def plain_name(model: str | None) -> str | None:
    """Return a model's name in the spelling of PERSPECTIVE and FISHEYE."""
    return None if model is None else model.lower().replace("-", "_").replace(" ", "_")


def model_name(*entries: Mapping[str, Any]) -> str | None:
    """Return the first name of a camera's model in parts of a calibration; None where nothing names it.

    A known name that is not OpenCV's perspective model counts at whatever key it stands. A ValueError says that a pair
    has two models.
    """
    for entry in entries:
        if entry.get(FISHEYE_KEY) in (1, "1"):
            return FISHEYE[0]
        words = {key: value for key, value in entry.items() if isinstance(value, str)}
        for form in KEY_FORMS:
            told = sorted({value for key, value in words.items() if form.fullmatch(key)})
            if len(told) > 1:
                raise ValueError(f"the cameras have the models {' and '.join(told)}, expected one")
            if told:
                return told[0]
        if known := [value for key, value in words.items() if plain_name(value) in OTHERS and key not in TITLES]:
            return known[0]
    return None


def is_name_key(key: str) -> bool:
    """Tell whether a calibration names its model at a key."""
    return any(form.fullmatch(key) for form in KEY_FORMS)
