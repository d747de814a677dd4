"""Agreement of sensors on where points are: faults that no sensor shows by itself.

Two sensors triangulate the points that both see. Where these points are apart, one single fault is sought that brings
most of them together: both focal lengths of a sensor wrong alike, its cameras turned towards each other, or a sensor
that was moved as a whole. Which of two was moved, only a third can tell: the one with which it agrees was not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.capture.checking.matches import NO_MATCHES, Matches, epipolar_errors, joined
from recon.capture.rectify import viewing_directions
from recon.geometry.rig import Camera, Sensor, rigid, transformed

SAME_FEATURE_PX = 1.0  # a feature of one matching found again in another
MAX_EPIPOLAR_PX = 2.0  # matches within a sensor that are farther from their line are wrong ones
MIN_AGREEING = 8  # points; fewer say nothing
MIN_TELLING = 20  # points, of which hardly any agree; of 14 of a ball in small pictures, 12 were matched wrongly
MIN_KEPT = 0.5  # of the points that the best explanation brings together; below, the calibration is wrong
FACTORS = np.geomspace(0.8, 1.25, 91)  # of focal lengths: half a per cent apart
MIN_FOCAL_CHANGE = 0.01
TOE_INS_DEG = np.concatenate([-np.arange(2.0, 0.0, -0.05), np.arange(0.05, 2.01, 0.05)])
N_CHOSEN = 3  # random points, which determine a move: as many follow any
ROUNDS = 300  # of these: finds a move that a fifth of the points follow with 90 % probability
POLISHING = 3
MAX_BRIGHTNESS = 1.25  # of a sensor's points as a multiple of another's; half the light gives 1.4 in sRGB
SEED = 0


@dataclass(frozen=True, eq=False)
class Shared:
    """Features that two sensors have both matched, and where each of them sees them."""

    first: Matches
    second: Matches

    def __len__(self) -> int:
        return len(self.first)


@dataclass(frozen=True)
class Explanation:
    """A single fault that brings points together.

    Parameters
    ----------
    n_agreeing : points, if it is undone
    sentence : what it is; `{}` stands for the sensor where either of the two may have it
    """

    n_agreeing: int
    sentence: str


@dataclass(frozen=True)
class Comparison:
    """What two sensors say about the points that both see.

    Parameters
    ----------
    sensors : their names
    n_points, n_agreeing : how many both see, and how many of them at the same place
    tolerance_mm : how far apart that may be
    explanation : why points are apart, None if they are not, or nothing explains it
    brightness : of the points in the first sensor's pictures, as a multiple of that in the second's; None if it is
        alike, or too few tell
    are_colours_reversed : whether what is red in one's pictures is blue in the other's
    """

    sensors: tuple[str, str]
    n_points: int
    n_agreeing: int
    tolerance_mm: float
    explanation: Explanation | None = None
    brightness: float | None = None
    are_colours_reversed: bool = False

    @property
    def is_known(self) -> bool:
        """True if the sensors are known to agree, or why they do not."""
        return self.explanation is not None or self.n_agreeing >= MIN_AGREEING


def shared_points(first: Matches, second: Matches, between: Matches) -> Shared:
    """Select the points that both sensors have matched.

    Parameters
    ----------
    first, second : matches of each sensor's pair, (N, 2) pixels each
    between : matches of the first's right picture with the second's left
    """
    if min(len(first), len(second), len(between)) == 0:
        return Shared(NO_MATCHES, NO_MATCHES)
    in_first, in_second = _places(first.right, between.left), _places(second.left, between.right)
    kept = (in_first >= 0) & (in_second >= 0)
    return Shared(first[in_first[kept]], second[in_second[kept]])


def fitting(first: Sensor, second: Sensor, shared: Shared) -> Shared:
    """Select the points whose matches within each sensor are near their epipolar lines; others are wrong.

    Parameters
    ----------
    first, second : the sensors
    shared : points that both see
    """
    is_right = np.ones(len(shared), np.bool_)
    for sensor, matches in ((first, shared.first), (second, shared.second)):
        is_right &= np.abs(epipolar_errors(sensor, matches)) < MAX_EPIPOLAR_PX
    return Shared(shared.first[is_right], shared.second[is_right])


def compared(first: Sensor, second: Sensor, shared: Sequence[Shared], tolerance_mm: float) -> Comparison:
    """Compare where two sensors see the same points; of too few points, nothing is known.

    Parameters
    ----------
    first, second : the sensors
    shared : points that both see, of several frames, as `fitting` selects them
    tolerance_mm : how far apart two sensors may see the same point
    """
    in_first, in_second = joined([each.first for each in shared]), joined([each.second for each in shared])
    if len(in_first) < MIN_AGREEING:
        return Comparison((first.id, second.id), len(in_first), 0, tolerance_mm)
    points = triangulated(first, in_first), triangulated(second, in_second)

    def n_with_first(changed: Sensor) -> int:
        return _n_together(triangulated(changed, in_first), points[1], tolerance_mm)

    def n_with_second(changed: Sensor) -> int:
        return _n_together(points[0], triangulated(changed, in_second), tolerance_mm)

    n_agreeing = _n_together(*points, tolerance_mm)
    best = max(
        (
            _focal(second, n_with_second),
            _focal(first, n_with_first),
            _toed_in(second, n_with_second),
            _toed_in(first, n_with_first),
            _moved(*points, tolerance_mm),
        ),
        key=lambda explanation: explanation.n_agreeing,
    )
    is_apart = best.n_agreeing - n_agreeing >= MIN_AGREEING and n_agreeing < MIN_KEPT * best.n_agreeing
    return Comparison((first.id, second.id), len(in_first), n_agreeing, tolerance_mm, best if is_apart else None)


def disagreements(comparisons: Sequence[Comparison]) -> Iterator[str]:
    """Say one sentence for every two sensors that do not agree, naming the one that was moved if that can be told."""
    for comparison in comparisons:
        if comparison.explanation is not None:
            reason = comparison.explanation.sentence.format(_named(comparison, comparisons))
            yield (
                f"sensors {' and '.join(comparison.sensors)} disagree: {comparison.n_agreeing} of "
                f"{comparison.n_points} points that both see are within {comparison.tolerance_mm:.0f} mm, "
                f"{comparison.explanation.n_agreeing} if {reason}"
            )


def unexplained(comparisons: Sequence[Comparison]) -> Iterator[str]:
    """Say one sentence for every two sensors whose points are apart for no single reason."""
    for comparison in comparisons:
        if comparison.n_points >= MIN_TELLING and not comparison.is_known:
            yield (
                f"whether sensors {' and '.join(comparison.sensors)} agree could not be checked: only "
                f"{comparison.n_agreeing} of {comparison.n_points} points that both seem to see are within "
                f"{comparison.tolerance_mm:.0f} mm, expected at least {MIN_AGREEING}, and no single reason explains "
                "the others; look at their poses, and whether the pictures are these sensors'"
            )


def unlike_exposures(comparisons: Sequence[Comparison]) -> Iterator[str]:
    """Say in what light and colours two sensors show the points which both see unlike."""
    for comparison in comparisons:
        ratio = comparison.brightness
        if ratio is not None:
            first, second = comparison.sensors if ratio > 1 else comparison.sensors[::-1]
            yield (
                f"the pictures of sensor {first} are {max(ratio, 1 / ratio):.2f} times as bright as those of sensor "
                f"{second} at points that both see; use the same exposure and gain"
            )
        if comparison.are_colours_reversed:
            first, second = comparison.sensors
            yield (
                f"what is red in the pictures of sensor {first} is blue in those of sensor {second}, at points that "
                "both see: one's order of red, green and blue is reversed; write both alike"
            )


def _named(comparison: Comparison, comparisons: Sequence[Comparison]) -> str:
    """Name the sensor of two that was moved as a whole, with what speaks for it; both where nothing does.

    The one that others disagree with as well is the odd one out; one that agrees with a third is not.
    """
    first, second = comparison.sensors
    for sensor, other in ((first, second), (second, first)):
        against = _third_sensors(sensor, other, comparisons, agreeing=False)
        if against and not _third_sensors(other, sensor, comparisons, agreeing=False):
            return f"{sensor}, with which {' and '.join(against)} does not agree either,"
    for sensor, other in ((first, second), (second, first)):
        in_favour = _third_sensors(other, sensor, comparisons, agreeing=True)
        if in_favour and not _third_sensors(sensor, other, comparisons, agreeing=True):
            return f"{sensor}, and not {other}, which agrees with {' and '.join(in_favour)},"
    return f"{first} or {second}"


def _third_sensors(name: str, beside: str, comparisons: Sequence[Comparison], *, agreeing: bool) -> list[str]:
    """List the sensors beside a pair that agree with one of it, or do not."""
    return [
        other
        for comparison in comparisons
        if name in comparison.sensors and comparison.is_known and (comparison.explanation is None) is agreeing
        for other in comparison.sensors
        if other not in (name, beside)
    ]


def triangulated(sensor: Sensor, matches: Matches) -> NDArray[np.float64]:
    """Triangulate matches: world points, float64 (N, 3), mm."""
    slopes = [
        viewing_directions(camera, pixels)[:, :2].T
        for camera, pixels in ((sensor.left, matches.left), (sensor.right, matches.right))
    ]
    poses = [camera.cam_from_world[:3] for camera in (sensor.left, sensor.right)]
    points = cv2.triangulatePoints(*poses, *slopes)
    return np.asarray((points[:3] / points[3]).T, dtype=np.float64)


def with_focal(camera: Camera, factor: float) -> Camera:
    """Return a camera whose focal lengths are `factor` times as long."""
    return replace(camera, K=camera.K * np.array([[factor, factor, 1.0], [1.0, factor, 1.0], [1.0, 1.0, 1.0]]))


def _places(known: NDArray[np.float64], asked: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the index of the known feature at each place asked for, -1 where there is none."""
    distance, index = cKDTree(known).query(asked)
    return np.where(np.asarray(distance) < SAME_FEATURE_PX, np.asarray(index, dtype=np.int64), -1)


def _n_together(first: NDArray[np.float64], second: NDArray[np.float64], tolerance_mm: float) -> int:
    """Count the points (N, 3) that two sensors see at the same place."""
    return int(np.count_nonzero(np.linalg.norm(first - second, axis=1) < tolerance_mm))


def _focal(sensor: Sensor, count: Callable[[Sensor], int]) -> Explanation:
    counts: Mapping[float, int] = {
        float(factor): count(
            replace(sensor, left=with_focal(sensor.left, factor), right=with_focal(sensor.right, factor))
        )
        for factor in FACTORS
        if abs(factor - 1.0) > MIN_FOCAL_CHANGE
    }
    factor, n_agreeing = _middle_of_best(counts)
    return Explanation(n_agreeing, f"the focal lengths of both cameras of {sensor.id} are {factor:.2f} times as long")


def _toed_in(sensor: Sensor, count: Callable[[Sensor], int]) -> Explanation:
    """Explain by a turn of the right camera about the axis across baseline and view, which leaves rows as they are."""
    across = np.cross(sensor.right.rotation[2], sensor.right.centre - sensor.left.centre)
    axis = sensor.right.rotation @ across / np.linalg.norm(across)
    counts: Mapping[float, int] = {
        float(angle): count(replace(sensor, right=_turned(sensor.right, axis * np.deg2rad(angle))))
        for angle in TOE_INS_DEG
    }
    angle, n_agreeing = _middle_of_best(counts)
    return Explanation(
        n_agreeing,
        f"the cameras of {sensor.id} were turned towards or away from each other by {abs(angle):.2f} degrees",
    )


def _middle_of_best(counts: Mapping[float, int]) -> tuple[float, int]:
    """Return the median of the values with the highest count, and that count."""
    best = max(counts.values())
    return float(np.median([value for value, n in counts.items() if n == best])), best


def _turned(camera: Camera, turn: NDArray[np.float64]) -> Camera:
    return replace(camera, cam_from_world=rigid(cv2.Rodrigues(turn)[0], np.zeros(3)) @ camera.cam_from_world)


def _moved(
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    tolerance_mm: float,
) -> Explanation:
    """Explain by the rigid move of the second sensor's points onto the first's that most follow, by random triples.

    It is then made the best one for all that follow it.

    Source: Fischler, Bolles, "Random sample consensus", 1981; the move of a triple: Arun, Huang, Blostein, 1987.
    """
    rng = np.random.default_rng(SEED)
    best, move = 0, np.eye(4)
    for _ in range(ROUNDS):
        chosen = rng.choice(len(first), N_CHOSEN, replace=False)
        tried = _rigid_move(second[chosen], first[chosen])
        n = _n_together(first, transformed(second, tried), tolerance_mm)
        if n > best:
            best, move = n, tried
    for _ in range(POLISHING):
        follows = np.linalg.norm(first - transformed(second, move), axis=1) < tolerance_mm
        move = _rigid_move(second[follows], first[follows]) if np.count_nonzero(follows) >= MIN_AGREEING else move
    best = max(best, _n_together(first, transformed(second, move), tolerance_mm))
    angle = float(np.rad2deg(np.linalg.norm(cv2.Rodrigues(move[:3, :3])[0])))
    off = float(np.median(np.linalg.norm(transformed(second, move) - second, axis=1)))
    what = f"turned by about {angle:.1f} degrees, and what it sees is {off:.0f} mm off"
    return Explanation(best - N_CHOSEN, f"{{}} was moved as a whole: {what}")


def _rigid_move(source: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    centres = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((target - centres[1]).T @ (source - centres[0]))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return rigid(turn, centres[1] - turn @ centres[0])
