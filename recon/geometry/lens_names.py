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
    "brown",
    "rational_polynomial",
    "rational",
    "thin_prism",
    "tilted",
    "pinhole",
    "perspective",
    "opencv",
    "full_opencv",
    "none",
)
MOST_NUMBERS = {  # the others: 14
    "none": 0,
    "plumb_bob": 5,
    "radtan": 5,
    "radial_tangential": 5,
    "brown_conrady": 5,
    "brown": 5,
    "rational": 8,
}
UNLIKE = ("inverse_brown_conrady", "modified_brown_conrady")  # of RealSense: other formulas, mostly without numbers
FISHEYE = (
    "equidistant",
    "fisheye",
    "kannala_brandt",
    "kannala_brandt4",
    "kb4",
    "kannala_brandt8",
    "kannalabrandt8",
    "opencv_fisheye",
)
FLAG = re.compile("(is_?)?fisheye(_?model)?", re.IGNORECASE)  # 1 or true, 0 or false, as OpenCV's program writes it
SPHERE = re.compile("xi[12]?", re.IGNORECASE)  # a number that OpenCV's omnidirectional cameras alone have
TITLES = (
    "id",
    "name",
    "camera_name",
    "image",
    "title",
    "comment",
)  # keys at which such a word may stand and mean no lens
UNREAD = (
    "omnidirectional",
    "omni",
    "mei",
    "unified",
    "fov",
    "double_sphere",
    "eucm",
    "scaramuzza",
    "ocam",
    "ftheta",
    "thin_prism_fisheye",
    "rad_tan_thin_prism_fisheye",
    "equirectangular",
)
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
        if any(FLAG.fullmatch(key) and str(value).lower() in ("1", "1.0", "true") for key, value in entry.items()):
            return FISHEYE[0]
        if any(SPHERE.fullmatch(key) for key in entry):
            return UNREAD[0]
        words = {key: value for key, value in entry.items() if isinstance(value, str) and value.strip()}
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
