"""Registration of a known mesh to a cloud: Super4PCS finds places where it may be, point-to-plane ICP refines them.

Source: Chen, Medioni, "Object modelling by registration of multiple range images" (1992), for the distance to the
tangent plane; Chetverikov et al., "The Trimmed Iterative Closest Point algorithm" (2002), for leaving out the worst.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Shape
from recon.geometry.rig import UNITS_MM, bounds_corners, rigid, transformed
from recon.validation.clouds import FitError, checked_points
from recon.validation.registration.super4pcs import Super4PCSParameters, super4pcs
from recon.validation.sampling import subsample
from recon.validation.triangles import TriangleTree
from recon.validation.truth.evaluation import sample_evenly

DELTA_SHARE = 0.02  # of the model's diagonal, how far a point may lie from it in the search
COARSE_POINTS = 1_500
FINE_POINTS = 30_000
MODEL_POINTS = 60_000
COARSE_STEPS, MAX_STEPS = 12, 60
STEP_SHARE = 1e-6  # of the model's diagonal; a smaller step ends the refinement
RIVAL = 0.97  # of the best place's overlap; places from there on are as good
SAME_START = 0.1  # between rotation matrices, and between places as a share of the diagonal; nearer starts are the same
SAME_SHARE = 0.03  # of the model's diagonal; places whose corners are nearer to each other are the same
SAME_SURFACE = 0.002  # of the model's diagonal; between places whose surfaces are nearer, the model looks the same
SURFACE_POINTS = 6_000  # by which surfaces are compared
SMALLEST_EXTENT = 0.05  # of the model's diagonal; a smaller cloud is in another unit, or shows nothing
N_SEEDS = 2  # searches, with different samples and bases


@dataclass(frozen=True)
class RegistrationParameters:
    """How a model is looked for.

    Parameters
    ----------
    delta : mm, how far from the model its points may lie; None for a fiftieth of the model's diagonal
    trim : share of the points, the nearest, that each step of the refinement uses
    min_overlap : share of the cloud that must lie on the model
    seed : of the samples and the search
    """

    delta: float | None = None
    trim: float = 0.8
    min_overlap: float = 0.5
    seed: int = 1

    def __post_init__(self) -> None:
        if self.delta is not None and not 0 < self.delta < math.inf:
            raise ValueError(f"delta is {self.delta} mm, expected a positive length")
        if not 0 < self.trim <= 1 or not 0 < self.min_overlap <= 1:
            raise ValueError(f"trim {self.trim} and min_overlap {self.min_overlap} must lie above 0 and up to 1")


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a model is in a cloud.

    Parameters
    ----------
    cloud_from_model : float64 (4, 4)
    delta : mm
    overlap : share of the cloud within delta of the model
    rms : mm, of the distances of the points used in the last step
    steps : of the refinement
    rivals : float64 (4, 4) each, other places that suit the cloud as well, because the model is symmetric or the cloud
        shows too little of it
    """

    cloud_from_model: NDArray[np.float64]
    delta: float
    overlap: float
    rms: float
    steps: int
    rivals: tuple[NDArray[np.float64], ...] = ()


def place_model(
    vertices: NDArray[np.floating],
    faces: NDArray[np.integer],
    points: NDArray[np.floating],
    parameters: RegistrationParameters | None = None,
) -> Placement:
    """Register a mesh to a cloud of all or a part of its surface.

    Parameters
    ----------
    vertices, faces : floating (N, 3), mm, and integer (M, 3)
    points : floating (P, 3), mm
    parameters : how the model is looked for

    Raises
    ------
    ValueError
        If either is not usable.
    FitError
        If the model is not there; the message says how much of the cloud it would explain.
    """
    parameters = parameters or RegistrationParameters()
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    checked = checked_points(points, diagonal, "model's diagonal")
    extent = float(np.linalg.norm(np.ptp(checked, axis=0)))
    sizes = f"the cloud is {extent:.3g} mm across, the model {diagonal:.4g} mm"
    if (unit := _fitting_unit(diagonal, extent)) is not None:
        raise FitError(
            f"{sizes}; it would suit the model in {unit}: say so with --unit {unit}, or mend the model's size if that "
            "is wrong"
        )
    try:
        return _placed(vertices, faces, checked, diagonal, parameters)
    except FitError as error:
        model_unit = _models_unit(diagonal, extent)
        if model_unit is None:
            raise
        raise FitError(
            f"{error}; {sizes}, which would suit the cloud in {model_unit}: say so with --model-unit {model_unit}"
        ) from error


def _placed(
    vertices: NDArray[np.floating],
    faces: NDArray[np.integer],
    points: NDArray[np.float32],
    diagonal: float,
    parameters: RegistrationParameters,
) -> Placement:
    delta = parameters.delta or DELTA_SHARE * diagonal
    tree = TriangleTree(vertices, faces)
    shape = Shape(np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int32))
    model = sample_evenly(shape, MODEL_POINTS, np.random.default_rng(parameters.seed))
    coarse, fine = (
        subsample(points, parameters.seed, most).astype(np.float64) for most in (COARSE_POINTS, FINE_POINTS)
    )
    candidates = _candidates(model, coarse, delta, diagonal, parameters.seed)
    roughly = [refine(tree, coarse, start, delta, parameters.trim, COARSE_STEPS) for start in candidates]
    roughly.sort(key=lambda placement: -placement.overlap)
    good = _distinct([p for p in roughly if p.overlap >= RIVAL * roughly[0].overlap], vertices, diagonal)
    surface = subsample(model, parameters.seed, SURFACE_POINTS)
    refined: list[Placement] = []
    reached: list[tuple[NDArray[np.float64], Placement]] = []
    for start in (p.cloud_from_model for p in good):
        place = _turned(start, reached, tree, surface, SAME_SURFACE * diagonal)
        if place is None:
            place = refine(tree, fine, start, delta, parameters.trim, MAX_STEPS)
            reached.append((start, place))
        refined.append(place)
    refined.sort(key=lambda p: (-round(p.overlap / (1 - RIVAL)), p.rms))
    chosen = refined[0]
    if chosen.overlap < parameters.min_overlap:
        raise FitError(
            f"only {chosen.overlap:.0%} of the cloud lies within {delta:.3g} mm of the model at its best place, "
            f"expected {parameters.min_overlap:.0%}: the model is not in the cloud, or too little of it"
        )
    largest_rms = chosen.rms / RIVAL + 1e-3 * delta
    alike = [p for p in refined[1:] if p.overlap >= RIVAL * chosen.overlap and p.rms <= largest_rms]
    rivals = _distinct([chosen, *alike], vertices, diagonal)[1:]
    return Placement(
        chosen.cloud_from_model, delta, chosen.overlap, chosen.rms, chosen.steps,
        tuple(rival.cloud_from_model for rival in rivals),
    )  # fmt: skip


def refine(
    tree: TriangleTree, points: NDArray[np.float64], start: NDArray[np.float64], delta: float, trim: float, most: int
) -> Placement:
    """Refine a placement by trimmed point-to-plane ICP; overlap and rms are those at the place that it reaches.

    Parameters
    ----------
    tree : of the model
    points : float64 (P, 3), mm, of the cloud
    start : float64 (4, 4), cloud_from_model
    delta : mm, how far from the model its points may lie
    trim : share of the points, the nearest, that each step uses
    most : steps
    """
    model_from_cloud = np.linalg.inv(start)
    n_used = max(6, int(trim * len(points)))
    rms, n_steps = float("inf"), 0
    while n_steps < most:
        n_steps += 1
        moved = transformed(points, model_from_cloud)
        nearest = tree.nearest(moved)
        used = np.argpartition(nearest.distances, n_used - 1)[:n_used]
        middle = moved[used].mean(axis=0)
        normals = nearest.normals[used]
        system = np.concatenate([np.cross(moved[used] - middle, normals), normals], axis=1)
        gaps = np.einsum("ij,ij->i", nearest.points[used] - moved[used], normals)
        solution = np.linalg.lstsq(system.T @ system, system.T @ gaps, rcond=1e-9)[0]
        model_from_cloud = _motion(solution, middle) @ model_from_cloud
        rms = float(np.sqrt(np.mean(nearest.distances[used] ** 2)))
        if np.abs(solution[3:]).max() + np.abs(solution[:3]).max() * delta < STEP_SHARE * delta / DELTA_SHARE:
            break
    distances = tree.nearest(transformed(points, model_from_cloud)).distances
    return Placement(np.linalg.inv(model_from_cloud), delta, float(np.mean(distances < delta)), rms, n_steps)


def _candidates(
    model: NDArray[np.float64], cloud: NDArray[np.float64], delta: float, diagonal: float, seed: int
) -> list[NDArray[np.float64]]:
    """Return starting places cloud_from_model (4, 4) of several searches."""
    places: list[NDArray[np.float64]] = []
    for trial in range(N_SEEDS):
        parameters = Super4PCSParameters(delta=delta, overlap=0.8, n_samples=600, seed=seed + trial)
        try:
            places += list(super4pcs(model, cloud, parameters))
        except ValueError as error:
            reason = error
    places = [place for k, place in enumerate(places) if not _is_near(place, places[:k], diagonal)]
    if not places:
        raise FitError(str(reason)) from reason
    return places


def _turned(
    start: NDArray[np.float64],
    reached: list[tuple[NDArray[np.float64], Placement]],
    tree: TriangleTree,
    surface: NDArray[np.float64],
    tolerance: float,
) -> Placement | None:
    """Return the refined place of a start where a symmetric model looks as at another one; None where it does not.

    Parameters
    ----------
    start : float64 (4, 4), cloud_from_model
    reached : other starts, each with the place that its refinement reached
    tree, surface : of the model, and points float64 (N, 3) on it
    tolerance : mm
    """
    for other, place in reached:
        turn = np.linalg.inv(other) @ start
        if tree.nearest(transformed(surface, turn)).distances.max() < tolerance:
            return replace(place, cloud_from_model=place.cloud_from_model @ turn)
    return None


def _is_near(place: NDArray[np.float64], others: list[NDArray[np.float64]], diagonal: float) -> bool:
    """Tell whether a start (4, 4) is nearly one of the others, so that the refinement ends where theirs does."""
    return any(
        np.abs(place[:3, :3] - other[:3, :3]).max() < SAME_START
        and np.linalg.norm(place[:3, 3] - other[:3, 3]) < SAME_START * diagonal
        for other in others
    )


def _distinct(placements: list[Placement], vertices: NDArray[np.floating], diagonal: float) -> list[Placement]:
    """Return the placements that put the model's corners elsewhere than those before them."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = np.column_stack([bounds_corners(np.stack([low, high])), np.ones(8)])
    kept: list[Placement] = []
    for placement in placements:
        places = corners @ placement.cloud_from_model[:3].T
        apart = (np.abs(places - corners @ other.cloud_from_model[:3].T).max() for other in kept)
        if all(gap > SAME_SHARE * diagonal for gap in apart):
            kept.append(placement)
    return kept


def _motion(solution: NDArray[np.float64], middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rigid motion (4, 4) of a small turn about `middle` and a shift."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(solution[:3]).as_matrix()
    return rigid(turn, middle + solution[3:] - turn @ middle)


def _fitting_unit(diagonal: float, extent: float) -> str | None:
    """Return the unit in which the cloud would be about as large as the model; None where none is needed or helps."""
    if SMALLEST_EXTENT * diagonal < extent:
        return None
    return next((unit for unit, length in UNITS_MM.items() if 0.3 * diagonal < extent * length < 1.5 * diagonal), None)


def _models_unit(diagonal: float, extent: float) -> str | None:
    """Return the unit in which the model would be about as large as the cloud; None for mm, or where none helps.

    The cloud may show more than the model, so that this is no reason to refuse it.
    """
    larger = [(unit, diagonal * length) for unit, length in UNITS_MM.items() if length > 1]
    return next((unit for unit, size in larger if 0.3 * size < extent < 1.5 * size), None)
