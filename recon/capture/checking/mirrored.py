"""Whether a camera's pictures are mirrored, as some drivers write them: features are then found in hardly any."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.capture.checking.agreement import FEWEST, Agreement, agreeing
from recon.capture.checking.matches import match_pictures
from recon.capture.format import SensorStream, frame_pictures, read_picture
from recon.capture.recording import evenly_chosen

SUSPECT = 0.75  # share of matches that agree; of good recordings, nine tenths do
MANY = 100  # a frame; of features found mirrored, a third as many agree by chance
MORE = 2.0  # times as many agree with one of the two pictures mirrored
LOOKED_AT = 3  # frames


def mirrored_problems(folder: Path, stream: SensorStream, frames: Sequence[int], agreement: Agreement) -> Iterator[str]:
    """Say that one of a pair's cameras shows everything mirrored, where few matches agree.

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
