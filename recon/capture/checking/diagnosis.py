"""Diagnosis: the single fault that explains why a sensor's calibration does not fit its pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from recon.capture.checking.consistency import MIN_FOCAL_CHANGE, with_focal
from recon.capture.checking.matches import Matches, epipolar_errors
from recon.capture.checking.rows import OFF_PX
from recon.geometry.rig import Sensor, rigid

MIN_MATCHES = 20  # fewer say nothing about a calibration
MIN_ERROR_PX = 0.15  # median; features are found to about 0.1 px, and a smaller error does no harm
LARGE_ERROR_PX, LARGE_TURN_DEG = 1.0, 0.2  # what a mount that has settled may come to
MIN_GAIN = 0.65  # of the error is left by an explanation that is believed
MOST_LEFT_PX = 3.0  # by one; an error that remains as large has another reason
SAME_GAIN = 1.5  # times the best explanation's error: the one with fewer unknowns is taken
MIN_TURN_DEG = 0.1
MIN_COMMON_CHANGE = 0.05  # both focal lengths alike hardly move epipolar lines
MIN_SURE_GAIN, SURE = 0.75, 15.0  # share of the error left, and natural logarithm of the likelihood ratio
OUTLIER = 4.5  # times the median: three standard deviations of a normal distribution
TINY = 1e-12  # square pixels
FEWER_UNKNOWNS = 1.1  # times the error of an explanation with three
MIN_K1_CHANGE, LARGEST_K1_CHANGE = 0.1, 1.0  # less does little harm, more folds the picture back
WRONG_K1 = 0.25  # what numbers of another model come to
MAX_ASPECT = 0.02  # fx and fy of a camera with square pixels are equal
INLIER_PX = 0.3  # scale of the robust cost in fits


@dataclass(frozen=True, eq=False)
class _Explanation:
    """A fault, the distances (N,) of matches from their epipolar lines with it undone, and how many unknowns it has."""

    errors: NDArray[np.float64]
    n_unknowns: int
    sentence: str

    @property
    def error_px(self) -> float:
        return _median(self.errors)


def diagnose(sensor: Sensor, matches: Matches) -> tuple[str, ...]:
    """Say what is wrong with a sensor's calibration; nothing if it fits or too little is known.

    Each fault is assumed in turn: left and right are swapped, a camera's focal length is wrong, that of both is, the
    distortion of both lenses is, the right camera was turned against the left. The one that removes most of the
    matches' distances from their epipolar lines is named, unless a small correction will do.

    With each, the right camera may be turned so little that matching along rows bears it, as good calibrations are off
    by as much: rows hardly tell some large faults, and such a fault would be taken for what a little turn explains.
    """
    problems = tuple(_unequal_focal(sensor, side) for side in ("left", "right") if _aspect(sensor, side) > MAX_ASPECT)
    if problems or len(matches) < MIN_MATCHES:
        return problems
    error, n_matches = _median(epipolar_errors(sensor, matches)), len(matches)
    turned = _turned_little(sensor, matches)
    least = _median(turned)
    lenses = _lenses(sensor, matches)
    if least < MIN_ERROR_PX and lenses is None:
        return ()
    assumed = [explain(sensor, matches) for explain in (_swapped, _one_focal, _both_focals, _turned)]
    others = [explanation for explanation in assumed if explanation is not None]
    small = small_correction(sensor, matches)
    best_other = min([*(explanation.error_px for explanation in others), *(() if small is None else (small.after_px,))])
    if lenses is not None and lenses.error_px < FEWER_UNKNOWNS * best_other and _is_sure(lenses.errors, turned):
        return (_told(sensor, lenses, error, n_matches),)
    if small is not None and small.is_small:
        return ()
    explanations = [
        explanation
        for explanation in others
        if explanation.error_px < min(MIN_GAIN * least, MOST_LEFT_PX) and _is_sure(explanation.errors, turned)
    ]
    if least < MIN_ERROR_PX or not explanations:
        return ()
    best = min(explanation.error_px for explanation in explanations)
    likely = min(
        (explanation for explanation in explanations if explanation.error_px <= SAME_GAIN * best),
        key=lambda explanation: explanation.n_unknowns,
    )
    return (_told(sensor, likely, error, n_matches),)


def would_lenses_show(sensor: Sensor, matches: Matches) -> bool:
    """Tell whether lenses of another distortion would be noticed by matches.

    Rows depend little on the distortion of both lenses where they are near each other, or long; depths do.
    """
    as_told, *wrong = (_turned_little(_with_both_k1(sensor, change), matches) for change in (0.0, WRONG_K1, -WRONG_K1))
    return all(_is_sure(as_told, errors) for errors in wrong)


def _is_sure(after: NDArray[np.float64], before: NDArray[np.float64]) -> bool:
    """Tell whether an explanation of small errors (N,) is no chance: by the likelihood of errors of two widths.

    Their medians alone change by a third by chance where matches are few; their squares, without outliers, do not.
    """
    largest = (OUTLIER * _median(before)) ** 2
    squares = [max(float(np.minimum(errors**2, largest).sum()), TINY) for errors in (before, after)]
    is_gain = _median(after) < MIN_SURE_GAIN * _median(before)
    return is_gain and len(before) / 2 * float(np.log(squares[0] / squares[1])) > SURE


def _told(sensor: Sensor, explanation: _Explanation, error: float, n_matches: int) -> str:
    return (
        f"sensor {sensor.id}: {explanation.sentence} ({n_matches} matched points are {error:.2f} px off their epipolar "
        f"lines, {explanation.error_px:.2f} px with that undone)"
    )


@dataclass(frozen=True)
class Correction:
    """What the right camera of a sensor would have to be like for rows to agree.

    Parameters
    ----------
    turn_deg : about the axis across its view and rows, which shifts rows
    roll_deg : about its view, which turns them
    scale : of its focal lengths, which stretches them
    before_px, after_px : median distance of matched points from their epipolar lines, without and with it
    n_matches : how many points
    """

    turn_deg: float
    roll_deg: float
    scale: float
    before_px: float
    after_px: float
    n_matches: int

    def __str__(self) -> str:
        """Say what it changes, and what it gains."""
        return (
            f"the right camera turned by {self.turn_deg:+.3f} degrees, rolled by {self.roll_deg:+.3f}, with "
            f"{self.scale:.4f} times its focal lengths brings {self.n_matches} matched points from "
            f"{self.before_px:.2f} to {self.after_px:.2f} px off their epipolar lines"
        )

    @property
    def is_small(self) -> bool:
        """True if it is what mounts do over a day, or does no harm, and leaves nothing that asks for another reason."""
        turns = max(abs(self.turn_deg), abs(self.roll_deg))  # of small pictures, a turn by more moves rows by little
        is_little = self.before_px < (LARGE_ERROR_PX if turns < LARGE_TURN_DEG else OFF_PX)
        return is_little and abs(self.scale - 1) < MIN_FOCAL_CHANGE and self.after_px < MIN_ERROR_PX

    def applied(self, sensor: Sensor) -> Sensor:
        """Return a sensor with it."""
        return _small_change(sensor, np.array([*np.deg2rad([self.turn_deg, self.roll_deg]), np.log(self.scale)]))


def small_correction(sensor: Sensor, matches: Matches) -> Correction | None:
    """Fit a small correction of a sensor; None if its rows are well without one, or remain apart with it.

    Parameters
    ----------
    sensor : as its calibration says
    matches : that agree on some geometry of two cameras
    """
    if len(matches) < MIN_MATCHES or (before := _median(epipolar_errors(sensor, matches))) < MIN_ERROR_PX:
        return None
    unknown, errors = _fit(lambda change: _small_change(sensor, change), 3, matches, largest_px=0)
    after = _median(errors)
    if after > min(MIN_GAIN * before, OFF_PX):  # more is another fault, such as pictures that are swapped
        return None
    turn, roll = np.rad2deg(unknown[:2])
    return Correction(float(turn), float(roll), float(np.exp(unknown[2])), before, after, len(matches))


def _small_change(sensor: Sensor, change: NDArray[np.float64]) -> Sensor:
    """Turn a sensor's right camera about the baseline's axis across its view, roll it, and scale its focal lengths."""
    turn, roll, scale = change
    camera = sensor.right
    along = camera.rotation @ (sensor.right.centre - sensor.left.centre)
    along -= along[2] * np.array([0.0, 0.0, 1.0])
    axis = along / np.linalg.norm(along)
    rotation = cv2.Rodrigues(turn * axis)[0] @ cv2.Rodrigues(np.array([0.0, 0.0, roll]))[0]
    turned = replace(camera, cam_from_world=rigid(rotation, np.zeros(3)) @ camera.cam_from_world)
    return replace(sensor, right=with_focal(turned, _factor(scale)))


def _aspect(sensor: Sensor, side: str) -> float:
    K = getattr(sensor, side).K
    return abs(float(K[0, 0] / K[1, 1]) - 1.0)


def _unequal_focal(sensor: Sensor, side: str) -> str:
    K = getattr(sensor, side).K
    return (
        f"sensor {sensor.id}: the {side} camera's focal length is wrong: fx is {K[0, 0]:.1f} px, fy {K[1, 1]:.1f} px, "
        "expected nearly equal ones"
    )


def _swapped(sensor: Sensor, matches: Matches) -> _Explanation:
    errors = epipolar_errors(sensor, Matches(matches.right, matches.left))
    return _Explanation(errors, 0, "left and right are swapped: the left pictures are the right camera's")


def _one_focal(sensor: Sensor, matches: Matches) -> _Explanation | None:
    def changed(unknown: NDArray[np.float64]) -> Sensor:
        return replace(sensor, right=with_focal(sensor.right, _factor(unknown[0])))

    unknown, errors = _fit(changed, 1, matches)
    change = float(np.exp(unknown[0]))
    if abs(change - 1.0) < MIN_FOCAL_CHANGE:
        return None
    return _Explanation(
        errors,
        1,
        f"a focal length is wrong: either the right camera's should be {change:.3f} times as long, or the left "
        f"camera's {1 / change:.3f} times",
    )


def _both_focals(sensor: Sensor, matches: Matches) -> _Explanation | None:
    def changed(unknown: NDArray[np.float64]) -> Sensor:
        left, right = (with_focal(camera, _factor(unknown[0])) for camera in (sensor.left, sensor.right))
        return replace(sensor, left=left, right=right)

    unknown, errors = _fit(changed, 1, matches)
    change = float(np.exp(unknown[0]))
    if not MIN_COMMON_CHANGE < abs(change - 1.0) < 1.0:
        return None
    return _Explanation(errors, 1, f"the focal length of both cameras is wrong, about {change:.2f} times is right")


def _lenses(sensor: Sensor, matches: Matches) -> _Explanation | None:
    def changed(unknown: NDArray[np.float64]) -> Sensor:
        return _with_both_k1(sensor, float(np.clip(unknown[0], -2 * LARGEST_K1_CHANGE, 2 * LARGEST_K1_CHANGE)))

    unknown, errors = _fit(changed, 1, matches)
    if not MIN_K1_CHANGE < abs(unknown[0]) < LARGEST_K1_CHANGE:
        return None
    return _Explanation(
        errors,
        1,
        f"the distortion of both lenses is wrong, about {unknown[0]:+.2f} in k1 would be right: were its numbers taken "
        "for those of another model, or left out?",
    )


def _with_both_k1(sensor: Sensor, change: float) -> Sensor:
    left, right = (
        replace(camera, dist=dist + np.eye(1, len(dist))[0] * change)
        for camera in (sensor.left, sensor.right)
        for dist in (np.pad(camera.dist, (0, max(0, 4 - len(camera.dist)))),)
    )
    return replace(sensor, left=left, right=right)


def _turned(sensor: Sensor, matches: Matches) -> _Explanation | None:
    unknown, errors = _fit(lambda turn: _with_turn(sensor, turn), 3, matches, largest_px=0)
    angle = float(np.rad2deg(np.linalg.norm(unknown)))
    if angle < MIN_TURN_DEG:
        return None
    return _Explanation(
        errors, 3, f"the right camera is rotated by {angle:.2f} degrees against the left since the calibration"
    )


def _with_turn(sensor: Sensor, turn: NDArray[np.float64]) -> Sensor:
    rotation = rigid(cv2.Rodrigues(turn)[0], np.zeros(3))
    return replace(sensor, right=replace(sensor.right, cam_from_world=rotation @ sensor.right.cam_from_world))


def _factor(logarithm: float) -> float:
    """Return a factor that a fit tries, within what a camera can have."""
    return float(np.exp(np.clip(logarithm, -1.0, 1.0)))


def _fit(
    changed: Callable[[NDArray[np.float64]], Sensor], n_unknowns: int, matches: Matches, *, largest_px: float = OFF_PX
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit the unknowns that bring the matches nearest to their epipolar lines; return also the distances left (N,).

    The right camera is turned as well, about each axis by what moves the middle of its picture by at most `largest_px`.
    """

    def turned(unknown: NDArray[np.float64]) -> Sensor:
        told = changed(unknown[:n_unknowns])
        return _with_turn(told, unknown[n_unknowns:]) if largest_px else told

    def errors(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        return epipolar_errors(turned(unknown), matches)

    n_angles = 3 if largest_px else 0
    largest = np.repeat([np.inf, largest_px / changed(np.zeros(n_unknowns)).right.K[0, 0]], [n_unknowns, n_angles])
    start, step = np.zeros(n_unknowns + n_angles), np.full(n_unknowns + n_angles, 1e-4)
    fit = least_squares(
        errors, start, bounds=(-largest, largest), loss="soft_l1", f_scale=INLIER_PX, diff_step=step, x_scale=0.01
    )
    return fit.x[:n_unknowns], epipolar_errors(turned(fit.x), matches)


def _turned_little(sensor: Sensor, matches: Matches) -> NDArray[np.float64]:
    """Return the distances (N,) from epipolar lines that a turn which matching along rows bears leaves, pixels."""
    return _fit(lambda _: sensor, 0, matches)[1]


def _median(errors: NDArray[np.float64]) -> float:
    return float(np.median(np.abs(errors)))
