"""The measures between two clouds, by name, and those that a study compares with its opinion scores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from recon.validation.cloud_quality.colour import colours
from recon.validation.cloud_quality.compared import Pair, Value
from recon.validation.cloud_quality.geometry import chamfer, d1, d2, f_score
from recon.validation.cloud_quality.pointssim import QUANTITIES, pointssim

# The main ones of a table that has several of a kind; the others follow from them, or are for diagnosis.
WITH_SCORES = (
    "d1_mse", "d1_psnr_db", "d1_hausdorff_squared", "d2_mse", "d2_psnr_db", "chamfer", "f_score",
    "y_mse", "y_psnr_db", "cb_mse", "cr_mse",
    "pointssim_geometry", "pointssim_normals", "pointssim_curvature", "pointssim_colour",
)  # fmt: skip


@dataclass(frozen=True)
class Scale:
    """Lengths that measures of a frame need.

    Parameters
    ----------
    unit : of the clouds, such as "mm"
    peak : of the PSNR of D1 and D2; None where there is none
    threshold : of the F-score; None where there is none
    """

    unit: str
    peak: float | None
    threshold: float | None


Measure = Callable[[Pair, Scale], Sequence[Value]]


def _f_score(pair: Pair, scale: Scale) -> list[Value]:
    if scale.threshold is None:
        raise ValueError(f"{pair.reference.cloud.name}: has no extent to take a threshold from; give --threshold")
    return f_score(pair, scale.threshold)


def _of_quantity(name: str, pair: Pair, _scale: Scale) -> list[Value]:
    return pointssim(name, pair)


MEASURES: dict[str, Measure] = {
    "d1": lambda pair, scale: d1(pair, scale.peak, scale.unit),
    "d2": lambda pair, scale: d2(pair, scale.peak, scale.unit),
    "chamfer": lambda pair, scale: chamfer(pair, scale.unit),
    "f_score": _f_score,
    "colour": lambda pair, _scale: colours(pair),
    **{name: partial(_of_quantity, name) for name in QUANTITIES},
}


def chosen(names: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return the measures that are asked for; "pointssim" stands for all whose names begin with it.

    Parameters
    ----------
    names : asked for; none for all
    known : measures by name

    Raises
    ------
    ValueError
        If a name is no measure's.
    """
    for name in names:
        if not any(_is_asked(measure, name) for measure in known):
            raise ValueError(f"unknown measure {name!r}, expected some of {', '.join(known)}")
    return tuple(measure for measure in known if not names or any(_is_asked(measure, name) for name in names))


def _is_asked(measure: str, name: str) -> bool:
    return measure == name or measure.startswith(f"{name}_")
