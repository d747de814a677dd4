"""What is wrong with models, found before anything is filmed: each file is read once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median_low

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Discs, Model
from recon.geometry.rig import Camera
from recon.geometry.splats import Splats
from recon.models.read import MM, Placement, read_model

OTHER_UNIT = 30.0  # times as large as expected: no scene is so, but for its unit
LIKE_A_UNIT = 4.0  # a ratio so far from that of two units points to them
ODD_SIZE = 5.0  # times as large as expected: worth a warning
GRID = 5  # points to a side of a model's box that a camera may see
SEEN_OPACITY = 0.1
STRAYS = (2, 98)  # percentiles of the coordinates of splats; strays lie beyond
WATCHED = 20  # cameras of a path that are asked
LOWEST_SHARE = 0.002  # of a model's points that may hang below the place where it stands, as specks do


@dataclass(frozen=True)
class Facts:
    """What is known of a model once it was read.

    Parameters
    ----------
    digest : SHA-256 over its files; empty where it cannot be read
    bounds : lowest and highest corner, mm; None where it cannot be read
    is_cloud : whether it is points without faces
    warnings : a clause each that follows the model's name
    n_bytes : of its files; 0 where that is not known
    problem : why it cannot be filmed, a sentence; None if it can
    """

    digest: str = ""
    bounds: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    is_cloud: bool = False
    warnings: tuple[str, ...] = ()
    problem: str | None = None
    n_bytes: int = 0

    @property
    def size(self) -> float:
        """Length of the diagonal of the bounds, mm."""
        return 0.0 if self.bounds is None else float(np.linalg.norm(np.subtract(*self.bounds)))


def inspect_model(path: Path, placement: Placement) -> Facts:
    """Read a model, and return what is known of it.

    Parameters
    ----------
    path : of its file
    placement : where it stands
    """
    try:
        model = read_model(path, placement)
    except ValueError as error:
        return Facts(problem=str(error))
    low, high = _box(model.model)
    if not (high > low).any():
        return Facts(problem=f"{path}: all its points are in one place")
    bounds = (tuple(low.tolist()), tuple(high.tolist()))
    return Facts(model.digest, bounds, isinstance(model.model, Discs), model.warnings, n_bytes=model.n_bytes)


def standing_height(model: Model, bounds: NDArray[np.float64]) -> float | None:
    """Return the height at which a model stands, mm: that of its lowest points but a few; None outside the bounds.

    Parameters
    ----------
    model : in the world
    bounds : float64 (2, 3), mm, of the scene
    """
    points = _points(model)
    heights = points[((points >= bounds[0]) & (points <= bounds[1])).all(axis=1), 1]
    return float(np.quantile(heights, LOWEST_SHARE)) if len(heights) else None


def union(facts: Sequence[Facts]) -> NDArray[np.float64]:
    """Return the bounds of all models together, float64 (2, 3), mm; no side is shorter than a hundredth of the longest.

    A side needs some length for a camera to frame it.
    """
    boxes = np.array([fact.bounds for fact in facts if fact.bounds is not None])
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    least = float((high - low).max()) / 100
    extra = np.maximum(least - (high - low), 0) / 2
    return np.array([low - extra, high + extra])


def check_sizes(
    facts: Mapping[Path, Facts], unit: Mapping[Path, str], bounds: NDArray[np.float64] | None
) -> tuple[list[str], list[str]]:
    """Compare the models' sizes and places with the bounds, or with each other; returns problems and warnings.

    Parameters
    ----------
    facts : of the models of a scene
    unit : of each model, as it is said to be
    bounds : float64 (2, 3), mm, of what is filmed; None where they follow from the models
    """
    if not facts:
        return [], []
    if bounds is None:
        # of two approaches of different units the smaller is expected: "1 000 times too large" is the usual mistake
        expected, than = median_low(fact.size for fact in facts.values()), "the other models"
    else:
        expected, than = float(np.linalg.norm(bounds[1] - bounds[0])), "the bounds of the scene"
    problems, warnings = [], []
    for path, fact in facts.items():
        ratio = fact.size / expected
        what = f"{path}: is {_length(fact.size)} across, {_times(ratio)} {than} ({_length(expected)})"
        if max(ratio, 1 / ratio) >= OTHER_UNIT:
            problems.append(f"{what}; {_likely_unit(ratio, unit[path])}")
        elif max(ratio, 1 / ratio) >= ODD_SIZE:
            warnings.append(f"{what}; look whether its unit is right")
        elif bounds is not None and fact.bounds is not None and _is_apart(np.array(fact.bounds), bounds):
            problems.append(
                f"{path}: lies outside the bounds of the scene, from {_corner(fact.bounds[0])} to "
                f"{_corner(fact.bounds[1])} mm where they are from {_corner(bounds[0])} to {_corner(bounds[1])}; look "
                "at up and world_from_model in scene.json"
            )
    return problems, warnings


def is_seen(facts: Facts, cameras: Sequence[Camera]) -> bool:
    """Tell whether some camera of a path has some part of the model's bounds in its picture.

    Parameters
    ----------
    facts : of the model
    cameras : of the path
    """
    if facts.bounds is None:
        return True
    axes = [np.linspace(low, high, GRID) for low, high in zip(*facts.bounds, strict=True)]
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    for camera in cameras[:: max(len(cameras) // WATCHED, 1)]:
        in_front = points[camera.points_in_camera(points)[:, 2] > 0]
        pixels = camera.project(in_front)
        if ((pixels >= 0) & (pixels <= np.array(camera.size))).all(axis=1).any():
            return True
    return False


def _box(model: Model) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and the highest corner; of splats, those of most that are seen, as some always fly far off."""
    points = _points(model)
    if isinstance(model, Splats):
        low, high = np.percentile(points, STRAYS, axis=0)
        return low, high
    return points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)


def _points(model: Model) -> NDArray[np.float32]:
    """Return the places of a model's vertices, points, or splats that are seen, float32 (N, 3)."""
    if isinstance(model, Splats):
        return model.centres[model.opacities >= min(SEEN_OPACITY, float(model.opacities.max()))]
    return model.cloud.points if isinstance(model, Discs) else model.vertices


def _is_apart(box: NDArray[np.float64], bounds: NDArray[np.float64]) -> bool:
    return bool((box[0] > bounds[1]).any() or (box[1] < bounds[0]).any())


def _likely_unit(ratio: float, unit: str) -> str:
    """Say which unit a model is in that is too large by a ratio in the unit that it is said to be in."""
    likely = min(MM, key=lambda name: abs(np.log(MM[unit] / MM[name] / ratio)))
    off = MM[unit] / MM[likely] / ratio
    if likely == unit or max(off, 1 / off) > LIKE_A_UNIT:
        return f"scene.json says that it is in {unit}; look at units, and at the scale in world_from_model"
    return f"it is probably in {likely}, but scene.json says {unit}"


def _times(ratio: float) -> str:
    return f"{ratio:,.0f} times".replace(",", " ") if ratio > 1 else f"1/{1 / ratio:,.0f} of".replace(",", " ")


def _length(mm: float) -> str:
    return f"{mm:,.0f} mm".replace(",", " ") if mm >= 10 else f"{mm:.3g} mm"


def _corner(corner: Sequence[float] | NDArray[np.float64]) -> str:
    return f"({', '.join(f'{value:.0f}' for value in corner)})"
