"""Every fault of a recording is found, or said not to be checked; a good one is left alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from recon.capture.checking.check import check_capture
from recon.capture.format import Capture
from recon.capture.masks.segment import segment_capture
from recon.studio import SynthParameters, synthesise
from tests.recon.capture.checking.faults import FAULTS, MISSED, Fault, excerpt, false_alarms


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    folder = tmp_path_factory.mktemp("shots") / "people"
    synthesise(folder, SynthParameters("people", n_sensors=2, n_frames=4, size=(480, 360)))
    return segment_capture(folder)


@pytest.mark.slow
def test_a_good_recording_raises_no_alarm(shots: Capture) -> None:
    assert false_alarms(check_capture(shots.folder)) == []


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_a_fault_is_found_or_said_not_to_be_checked(shots: Capture, fault: Fault, tmp_path: Path) -> None:
    capture = excerpt(shots, tmp_path / "made", list(range(4)))
    fault.put(capture)
    assert fault.verdict(check_capture(capture.folder)) != MISSED
