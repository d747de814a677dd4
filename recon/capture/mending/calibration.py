"""A recording whose calibration is corrected by what its own pictures say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from recon.capture.checking.diagnosis import Correction
from recon.capture.format import Capture, SensorStream
from recon.capture.images import CaptureError


def corrected(capture: Capture, corrections: Mapping[str, Correction]) -> Capture:
    """Return a recording with the right cameras of its sensors corrected.

    Parameters
    ----------
    capture : the recording
    corrections : by the sensor's id

    Raises
    ------
    CaptureError
        If there are none.
    """
    if not corrections:
        raise CaptureError(f"{capture.folder}: no sensor's rows are apart such that a correction helps")
    return replace(capture, sensors=tuple(_corrected(each, corrections.get(each.id)) for each in capture.sensors))


def _corrected(stream: SensorStream, change: Correction | None) -> SensorStream:
    if change is None or stream.right is None:
        return stream
    return replace(stream, right=replace(stream.right, camera=change.applied(stream.sensor).right))
