"""Which matched points agree with one another on some geometry of two cameras, whatever the calibration says.

Every verdict from matches rests on these. Where few agree, nothing can be said: the pictures may show different things.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.checking.matches import Matches, epipolar_errors, match_pictures
from recon.capture.format import SensorStream, frame_pictures, read_picture
from recon.capture.recording import evenly_chosen
from recon.capture.rectify import viewing_directions
from recon.geometry.rig import Sensor

THRESHOLD_PX = 1.0  # from an epipolar line; MAGSAC++ weighs distances up to about thrice that
ESTIMATORS = (cv2.USAC_MAGSAC, cv2.USAC_ACCURATE, cv2.FM_RANSAC)  # the first that answers
CONFIDENCE, MOST_ROUNDS = 0.9999, 5000
DETERMINED = 8  # points, on which nearly any matches agree
FEWEST = 20  # points that agree; fewer say nothing about a calibration
LOWEST_SHARE = 0.15  # of all matches; of random ones in small pictures a line catches up to a tenth
AS_MANY = 0.8  # of those that agree fit the calibration: of two groups, seven free numbers fit chance better than none
SUSPECT = 0.75  # share of matches that agree; of good recordings, nine tenths do
MANY = 100  # a frame; of features found mirrored, a third as many agree by chance
MORE = 2.0  # times as many agree with one of the two pictures mirrored
LOOKED_AT = 3  # frames


@dataclass(frozen=True)
class Agreement:
    """How many matched points agree on one geometry, of how many."""

    n_agreeing: int
    n_matches: int

    @property
    def is_enough(self) -> bool:
        """True if a calibration can be judged by the points that agree."""
        return self.n_agreeing >= max(FEWEST, LOWEST_SHARE * self.n_matches)

    def __str__(self) -> str:
        """Say both numbers."""
        return f"{self.n_agreeing} of {self.n_matches} matched points agree on one geometry of two cameras"


def agreeing_with_each_other(sensor: Sensor, matches: Matches) -> NDArray[np.bool_]:
    """Select the matches (N,) of a sensor's pictures as recorded that agree on one geometry of two cameras.

    The calibration straightens the lenses alone; focal lengths and poses are free. Only where others, about as many,
    fit the calibration, these are taken: repeated patterns agree on something else.
    """
    focal = float(np.mean([np.diag(camera.K)[:2] for camera in (sensor.left, sensor.right)]))
    left, right = (
        focal * viewing_directions(camera, points)[:, :2]
        for camera, points in ((sensor.left, matches.left), (sensor.right, matches.right))
    )
    agree = agreeing(Matches(left, right))
    fit = np.abs(epipolar_errors(sensor, matches)) < THRESHOLD_PX
    are_others = np.count_nonzero(agree & fit) < np.count_nonzero(fit) / 2
    return fit if are_others and np.count_nonzero(fit) >= AS_MANY * np.count_nonzero(agree) else agree


def agreeing(matches: Matches) -> NDArray[np.bool_]:
    """Select the matches (N,) of two pictures of pinhole cameras that agree on one fundamental matrix.

    Source: Barath, Noskova, Ivashechkin, Matas, "MAGSAC++, a fast, reliable and accurate robust estimator", CVPR 2020.
    """
    if len(matches) < DETERMINED:
        return np.zeros(len(matches), np.bool_)
    for estimator in ESTIMATORS:
        with suppress(cv2.error):  # on some sets of points of one plane OpenCV's estimators give up
            _, chosen = cv2.findFundamentalMat(
                matches.left, matches.right, estimator, THRESHOLD_PX, CONFIDENCE, MOST_ROUNDS
            )
            if chosen is not None:
                return np.asarray(chosen.ravel(), np.bool_)
    return np.zeros(len(matches), np.bool_)


def mirrored_problems(folder: Path, stream: SensorStream, frames: Sequence[int], agreement: Agreement) -> Iterator[str]:
    """Say that one of a pair's cameras shows everything mirrored, as some drivers write it: few matches agree then.

    Parameters
    ----------
    folder : the capture's
    stream : with a pair
    frames : whose pictures can be read
    agreement : of the matches of these frames
    """
    if agreement.n_agreeing >= max(SUSPECT * agreement.n_matches, MANY * len(frames)):
        return
    as_they_are = mirrored = 0
    for frame in (frames[place] for place in evenly_chosen(len(frames), LOOKED_AT)):
        left, right = map(read_picture, frame_pictures(folder, stream, frame))
        as_they_are += _n_agreeing(left, right)
        mirrored += _n_agreeing(left, np.ascontiguousarray(right[:, ::-1]))
    if mirrored >= FEWEST and mirrored > MORE * as_they_are:
        yield (
            f"sensor {stream.id}: one of its cameras shows everything mirrored: {mirrored} matched points agree with "
            f"the right pictures mirrored, {as_they_are} without; mirror that camera's pictures back"
        )


def _n_agreeing(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> int:
    return int(np.count_nonzero(agreeing(match_pictures(left, right))))
