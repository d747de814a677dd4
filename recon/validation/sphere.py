"""A sphere of known radius in a cloud: where it is, how far off the points are, and when there is none.

Source: the paper, section 3.1 (signed error to the known radius, outlier ratio against a threshold). The fit is a
consensus of spheres through three points, then Gauss-Newton steps with Tukey's weights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.validation.measured import MIN_POINTS, UNITS_MM, FitError, checked_points
from recon.validation.sampling import fibonacci_sphere, first_in_cells, subsample, thinned
from recon.validation.sphere_kernels import local_consensus, signed_errors, tukey_sums

BAND_SHARE = 1 / 12  # of the radius: 12.5 mm, the threshold of the paper's table 4, for its 150 mm
CELL_SHARE = 1 / 12  # of the radius: one point a cell is searched, so that dense walls count by their area
SEED_SHARE = 0.6  # of the radius: spacing of the points that spheres are tried through
FINAL_STEPS = 1  # over all points
MAX_STEPS = 60
STEP_MM = 1e-3
SMALLEST_SCALE = 1e-6  # of the radius: a perfect cloud still gets a cutoff
N_CANDIDATES = 8
RIVAL = 0.5  # share of the best sphere's score from which another one counts as a second ball
NEAR = 1.5  # times the radius: what lies around a sphere
MIN_SHARE = 0.3  # of the points around a sphere that lie on it; of evenly filled space 0.15 would
MIN_COVERAGE = 0.04  # of the whole sphere's directions: a cap of 46 degrees
MIN_DEPTH = 6.0  # depth of the cap in standard deviations of its points; walls and clutter reach 3.5, balls 10
MAX_RADIUS_ERROR = 0.12  # share by which the radius that suits the points best may differ
APART = 1.5  # times the radius: two balls cannot be nearer than twice it
MAX_STRETCH = 0.12  # of the radius, by which the surface may bend more along one direction; a cylinder's is 0.25 to 0.5
ONE_SIDED = (
    0.4  # length of the mean direction; a hemisphere's is 0.5. Below, bending is looked for along all three axes
)
MAX_SCALE = 0.07  # of the radius, scatter of the points; of points that know nothing of the surface it is 0.12
WIDE = 2.2  # radii; a ball alone extends over two
N_DIRECTIONS = 400


@dataclass(frozen=True)
class SphereParameters:
    """How a sphere is looked for.

    Parameters
    ----------
    band : mm, distance from the surface within which a point speaks for a sphere; None for a twelfth of the radius
    cutoff : Tukey's constant in standard deviations of the inliers; a million points need no efficiency, so it is
        tighter than the usual 4.685 and clusters near the surface pull less
    n_trials : spheres tried through every seed point
    seed : of the sample and the trials
    """

    band: float | None = None
    cutoff: float = 2.5
    n_trials: int = 16
    seed: int = 1


@dataclass(frozen=True, eq=False)
class SphereFit:
    """A sphere that was found.

    Parameters
    ----------
    centre : float64 (3,), mm
    radius : mm, the known one
    free_radius : mm, the radius that suits the points best, a check of scale and curvature
    scale : mm, standard deviation of the points on the surface, robust
    coverage : share of the sphere's directions in which it has points
    surface_share : share of the points around the sphere that lie on it
    n_points : of the cloud
    steps : Gauss-Newton steps
    """

    centre: NDArray[np.float64]
    radius: float
    free_radius: float
    scale: float
    coverage: float
    surface_share: float
    n_points: int
    steps: int

    def errors(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Signed errors (N,) of points (N, 3) to the known radius, mm; positive outside."""
        errors: NDArray[np.float32] = signed_errors(
            np.ascontiguousarray(points, dtype=np.float32), self.centre, self.radius
        )
        return errors


def fit_sphere(points: NDArray[np.floating], radius: float, parameters: SphereParameters | None = None) -> SphereFit:
    """Find the one sphere of a known radius in a cloud.

    Parameters
    ----------
    points : floating (N, 3), mm; anything else may be in the cloud besides the sphere
    radius : mm

    Raises
    ------
    ValueError
        If the radius is not positive, there are too few points, or a coordinate is not a number.
    FitError
        If no sphere of this radius is there, or two are. The message says what was found instead.
    """
    points, parameters = checked_points(points, radius, "radius"), parameters or SphereParameters()
    sample = subsample(points, parameters.seed)
    try:
        return _fit(points, sample, radius, parameters)
    except FitError as error:
        unit = _fitting_unit(sample, radius, parameters)
        if unit is None or "two spheres" in str(error):
            raise
        raise FitError(f"{error}; it would fit if the cloud were in {unit}: say so with --unit {unit}") from error


def refine_sphere(
    points: NDArray[np.float32], centre: NDArray[np.float64], radius: float, parameters: SphereParameters
) -> SphereFit:
    """The sphere near `centre` that suits the points best, checked.

    Raises
    ------
    FitError
        If the steps do not converge or what they reach is not a sphere of this radius.
    """
    return _fit_from(points, subsample(points, parameters.seed), centre, radius, parameters)


def surface_share(points: NDArray[np.floating], fit: SphereFit, parameters: SphereParameters | None = None) -> float:
    """Share of points (N, 3) that lie on a sphere that was found, where all of them ought to."""
    parameters = parameters or SphereParameters()
    on_surface = np.abs(fit.errors(points)) < max(_band(fit.radius, parameters), parameters.cutoff * fit.scale)
    return float(np.mean(on_surface)) if len(points) else 0.0


def moved_centre(points: NDArray[np.float32], fit: SphereFit, parameters: SphereParameters) -> NDArray[np.float64]:
    """The centre to which other points (N, 3) move a fit that keeps its cutoff.

    Raises
    ------
    FitError
        If the points do not determine it.
    """
    centre = fit.centre
    for _ in range(MAX_STEPS):
        moved = _step(points, centre, fit.radius, parameters.cutoff * fit.scale)
        change, centre = float(np.linalg.norm(moved - centre)), moved
        if change < STEP_MM:
            break
    return centre


def _fit(
    points: NDArray[np.float32], sample: NDArray[np.float32], radius: float, parameters: SphereParameters
) -> SphereFit:
    even = thinned(sample, CELL_SHARE * radius)
    found: list[SphereFit] = []
    reasons: list[str] = []
    least = 0.0
    for centre, score in _candidates(even, radius, parameters):
        if score < least or any(np.linalg.norm(centre - fit.centre) < APART * radius for fit in found):
            continue
        try:
            fit = _fit_from(even, even, centre, radius, parameters)
        except FitError as error:
            reasons.append(str(error))
            continue
        if all(np.linalg.norm(fit.centre - other.centre) > APART * radius for other in found):
            least = least or RIVAL * score
            found.append(fit)
    if not found:
        extent = " x ".join(f"{length:.3g}" for length in np.ptp(sample, axis=0))
        best = f"; the best candidate: {reasons[0]}" if reasons else ""
        raise FitError(f"no sphere of radius {radius:g} mm in a cloud of {extent} mm{best}")
    if len(found) > 1:
        places = " and ".join(str(np.round(fit.centre, 1).tolist()) for fit in found[:2])
        raise FitError(f"two spheres of radius {radius:g} mm, at {places} mm: cut the cloud so that it holds one")
    return _fit_from(points, sample, found[0].centre, radius, parameters)


def _candidates(
    even: NDArray[np.float32], radius: float, parameters: SphereParameters
) -> list[tuple[NDArray[np.float64], float]]:
    """Centres and scores of the most promising spheres, best first, from points that are evenly spread."""
    even = even.astype(np.float64)
    seeds = first_in_cells(even, SEED_SHARE * radius)
    band = _band(radius, parameters)
    centres, scores = local_consensus(even, seeds, radius, band, parameters.n_trials, parameters.seed)
    chosen: list[tuple[NDArray[np.float64], float]] = []
    for index in np.argsort(-scores, kind="stable"):
        if not scores[index] > 0 or len(chosen) == N_CANDIDATES:
            break
        if all(np.linalg.norm(centres[index] - other) > radius / 2 for other, _ in chosen):
            chosen.append((centres[index], float(scores[index])))
    return chosen


def _fit_from(
    points: NDArray[np.float32],
    sample: NDArray[np.float32],
    centre: NDArray[np.float64],
    radius: float,
    parameters: SphereParameters,
) -> SphereFit:
    band = _band(radius, parameters)
    centre, scale, steps = _converged(sample, centre, radius, parameters)
    if len(points) > len(sample):
        for _ in range(FINAL_STEPS):
            centre = _step(points, centre, radius, parameters.cutoff * scale)
    errors = signed_errors(sample, centre, radius)
    on_surface = np.abs(errors) < max(band, parameters.cutoff * scale)
    near = errors < (NEAR - 1) * radius
    if np.count_nonzero(on_surface) < MIN_POINTS:
        raise FitError(f"only {np.count_nonzero(on_surface)} points lie on it, expected at least {MIN_POINTS}")
    fit = SphereFit(
        centre=centre,
        radius=radius,
        free_radius=_free_radius(sample, centre, radius, scale, parameters),
        scale=scale,
        coverage=coverage(sample[on_surface] - centre),
        surface_share=float(np.count_nonzero(on_surface) / np.count_nonzero(near)),
        n_points=len(points),
        steps=steps,
    )
    _check(fit)
    stretch = _stretch(sample[np.abs(errors) < 2 * band] - centre, radius)
    if stretch > MAX_STRETCH * radius:
        raise FitError(
            f"at {np.round(centre, 1).tolist()} mm the surface bends by {stretch:.3g} mm more along one direction "
            "than along another: a cylinder or an edge, no sphere"
        )
    return fit


def _stretch(offsets: NDArray[np.floating], radius: float) -> float:
    """How much more the surface at offsets (N, 3) from the centre is bent along one direction than another, mm.

    The largest coefficient of the quadratic forms of the direction that explain the errors beside a moved centre and
    another radius. On a cap only the two forms across it can be told from these.
    """
    offsets = offsets[:: max(1, len(offsets) // 4000)].astype(np.float64)
    distances = np.linalg.norm(offsets, axis=1)
    directions, errors = offsets / distances[:, None], distances - radius
    x, y, z = (directions @ np.linalg.eigh(_moments(directions))[1]).T
    forms = [x * x - y * y, 2 * x * y] + (
        [2 * x * z, 2 * y * z, z * z] if np.linalg.norm(directions.mean(axis=0)) < ONE_SIDED else []
    )
    terms = np.column_stack([np.ones_like(x), x, y, z, *forms])
    weights = np.ones(len(errors))
    for _ in range(5):
        weighted = terms * weights[:, None]
        solution = np.linalg.lstsq(weighted.T @ weighted, weighted.T @ (errors * weights), rcond=None)[0]
        left = np.abs(errors - terms @ solution)
        weights = np.sqrt(np.clip(1 - (left / max(4.0 * float(np.median(left)), 1e-6)) ** 2, 0, None))
    return float(np.abs(solution[4:]).max())


def _moments(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scatter (3, 3) about the mean direction, which comes out as its least axis for a cap."""
    mean = directions.mean(axis=0)
    across = directions - np.outer(directions @ mean, mean) / max(float(mean @ mean), 1e-12)
    return np.asarray(-across.T @ across)


def _check(fit: SphereFit) -> None:
    at = f"at {np.round(fit.centre, 1).tolist()} mm"
    if fit.surface_share < MIN_SHARE:
        raise FitError(f"{at} only {fit.surface_share:.0%} of the points around it lie on it, not {MIN_SHARE:.0%}")
    if fit.coverage < MIN_COVERAGE:
        raise FitError(f"{at} the points cover {fit.coverage:.1%} of the sphere, expected at least {MIN_COVERAGE:.0%}")
    if fit.scale > MAX_SCALE * fit.radius:
        raise FitError(f"{at} the points scatter by {fit.scale:.3g} mm, as if there were no surface")
    depth = 2 * fit.coverage * fit.radius  # of a cap that covers this share of a sphere
    if depth < MIN_DEPTH * fit.scale:
        raise FitError(f"{at} the points scatter by {fit.scale:.3g} mm, too much for a cap {depth:.3g} mm deep")
    if not abs(fit.free_radius / fit.radius - 1) <= MAX_RADIUS_ERROR:
        raise FitError(f"{at} the surface has a radius of about {fit.free_radius:.4g} mm, not {fit.radius:g} mm")


def _converged(
    sample: NDArray[np.float32], centre: NDArray[np.float64], radius: float, parameters: SphereParameters
) -> tuple[NDArray[np.float64], float, int]:
    """Centre, scale of the inliers and number of steps, with the scale estimated anew at every step."""
    band = _band(radius, parameters)
    for step in range(1, MAX_STEPS + 1):
        errors = np.abs(signed_errors(sample, centre, radius))
        inliers = errors[errors < 2 * band]
        if len(inliers) < MIN_POINTS:
            raise FitError(f"only {len(inliers)} points lie near it, expected at least {MIN_POINTS}")
        scale = max(1.4826 * float(np.median(inliers)), SMALLEST_SCALE * radius)
        cutoff = max(parameters.cutoff * scale, band if step <= 3 else 0.0)
        moved = _step(sample, centre, radius, cutoff)
        change = float(np.linalg.norm(moved - centre))
        centre = moved
        if change < STEP_MM and step > 3:
            return centre, scale, step
    raise FitError(f"the fit did not converge in {MAX_STEPS} steps; the last moved it by {change:.3g} mm")


def _step(
    points: NDArray[np.float32], centre: NDArray[np.float64], radius: float, cutoff: float
) -> NDArray[np.float64]:
    """One Gauss-Newton step of the centre."""
    matrix, right, n = _system(points, centre, radius, cutoff)
    return centre + _solved(matrix[:3, :3], right[:3], n)


def _free_radius(
    points: NDArray[np.float32],
    centre: NDArray[np.float64],
    radius: float,
    scale: float,
    parameters: SphereParameters,
) -> float:
    """The radius at which centre and radius together suit the points best; NaN where there is none."""
    free, cutoff = radius, max(parameters.cutoff * scale, 0.25 * _band(radius, parameters))
    for _ in range(MAX_STEPS):
        matrix, right, n = _system(points, centre, free, cutoff)
        try:
            change = _solved(matrix, right, n)
        except FitError:
            return float("nan")
        centre, free = centre + change[:3], free + float(change[3])
        if not 0.2 * radius < free < 5 * radius:
            return free
        if np.abs(change).max() < 1e-3:
            break
    return free


def _system(
    points: NDArray[np.float32], centre: NDArray[np.float64], radius: float, cutoff: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    sums = tukey_sums(points, centre, radius, cutoff)
    matrix = np.zeros((4, 4))
    matrix[np.triu_indices(4)] = sums[:10]
    return matrix + np.triu(matrix, 1).T, sums[10:14], int(sums[14])


def _solved(matrix: NDArray[np.float64], right: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    if n < MIN_POINTS // 2 or np.linalg.cond(matrix) > 1e9:
        raise FitError(f"the {n} points near its surface do not determine where it is")
    return np.asarray(np.linalg.solve(matrix, right))


def coverage(offsets: NDArray[np.floating]) -> float:
    """Share of the directions from a sphere's centre in which offsets (N, 3) lie."""
    from scipy.spatial import cKDTree

    offsets = offsets[:: max(1, len(offsets) // 8000)]
    unit = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    _, cells = cKDTree(fibonacci_sphere(N_DIRECTIONS)).query(unit)
    counts = np.bincount(cells, minlength=N_DIRECTIONS)
    return float(np.mean(counts > 0.1 * counts[counts > 0].mean()))


def _fitting_unit(sample: NDArray[np.float32], radius: float, parameters: SphereParameters) -> str | None:
    """The unit in which the cloud would hold a sphere of the radius, or None."""
    if np.ptp(sample, axis=0).min() > WIDE * radius:  # larger than a ball already
        return None
    for unit, length in UNITS_MM.items():
        if length == 1.0:
            continue
        scaled = sample * np.float32(length)
        try:
            _fit(scaled, scaled, radius, replace(parameters, n_trials=32))
        except FitError:
            continue
        return unit
    return None


def _band(radius: float, parameters: SphereParameters) -> float:
    return parameters.band or BAND_SHARE * radius
