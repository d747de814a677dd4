"""A small error of a calibration is warned about, corrected on request, and does no harm to a reconstruction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.capture.checking.check import check_capture
from recon.capture.format import Capture, CaptureError, read_capture, read_frame, write_capture
from recon.capture.mending.calibration import corrected
from recon.capture.mending.files import copied
from recon.capture.rectify import rectify
from recon.depth.disparity_io import read_disparity
from recon.geometry.rig import rigid
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.run import View
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MASK, read_depth


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    capture = synthesise(
        tmp_path_factory.mktemp("rows") / "ball", SynthParameters("ball", n_sensors=1, n_frames=1, size=(640, 480))
    )
    sensors = tuple(
        replace(each, mask=tuple(MASK.replace("{view}", f"{each.id}/{side}") for side in each.sides))
        for each in capture.sensors
    )
    write_capture(replace(capture, sensors=sensors))
    return read_capture(capture.folder)


def off_by(capture: Capture, rows: float) -> Capture:
    """The capture with its right camera turned since its calibration, so that rows are so far apart."""
    (stream,) = capture.sensors
    assert stream.right is not None
    camera = stream.right.camera
    turn = cv2.Rodrigues(np.array([rows / camera.K[0, 0], 0.0, 0.0]))[0]
    turned = replace(camera, cam_from_world=rigid(turn, np.zeros(3)) @ camera.cam_from_world)
    changed = replace(capture, sensors=(replace(stream, right=replace(stream.right, camera=turned)),))
    write_capture(changed)
    return changed


@pytest.mark.slow
def test_half_a_row_is_a_warning_that_offers_a_correction_after_which_nothing_is_wrong(
    recorded: Capture, tmp_path: Path
) -> None:
    capture = off_by(recorded, 0.7)
    report = check_capture(capture.folder)
    assert report.problems == ()
    assert any("rows are 0." in warning and "px apart" in warning for warning in report.warnings)
    change = report.corrections["S1"]
    assert change.before_px > 3 * change.after_px
    made = copied(corrected(capture, report.corrections), tmp_path / "made")
    assert check_capture(made.folder).warnings == ()
    for before, after in zip(read_frame(capture, "S1", 0), read_frame(read_capture(made.folder), "S1", 0), strict=True):
        assert np.array_equal(before, after)
    with pytest.raises(CaptureError, match="no sensor's rows"):
        corrected(capture, {})


@pytest.mark.slow
def test_a_reconstruction_with_a_row_of_error_is_as_near_to_the_truth_as_without(
    recorded: Capture, tmp_path: Path
) -> None:
    def share_wrong(rows: float) -> float:
        capture = off_by(recorded, rows)
        run = tmp_path / str(rows)
        told = reconstruct(capture.folder, run, ReconstructOptions(("id",), ("fb",), temporal=None))
        assert any("rows of the right pictures" in warning for warning in told["warnings"]) == (rows > 0.5)
        rectification = rectify(recorded.sensors[0].sensor, recorded.bounds)
        disparity = read_disparity(run / View("id", "S1", 0).depth)
        truth = cv2.remap(read_depth(recorded, "S1", "left", 0), *rectification.left_maps, cv2.INTER_NEAREST)
        height, width = (min(a, b) for a, b in zip(disparity.shape, truth.shape, strict=True))
        apart = np.abs(rectification.depth(disparity)[:height, :width] - truth[:height, :width])
        return float((apart[np.isfinite(apart)] > 40.0).mean())

    assert share_wrong(1.0) < share_wrong(0.0) + 0.02
