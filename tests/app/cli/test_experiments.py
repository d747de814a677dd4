"""The demo is started again: it goes on where it was stopped, and keeps what its study is made of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import recon.capture.masks.segment
import recon.studio
from app.cli.experiments import _demo_size, _demo_steps
from app.operations.running import alone
from app.settings import DATA_FOLDER, Settings
from recon.capture.format import Capture, read_capture
from recon.cli.console import ProgressLine
from recon.runtime.files import write_json
from recon.studio import SynthParameters, synthesise
from tests.command_line import Command


@pytest.mark.slow
def test_a_recording_that_was_stopped_before_its_masks_gets_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def small(folder: Path, parameters: SynthParameters, **_: Any) -> Capture:
        return synthesise(folder, SynthParameters(scene=parameters.scene, n_sensors=1, n_frames=1, size=(120, 90)))

    def stopped(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(recon.studio, "synthesise", small)

    def record() -> None:
        _demo_steps(tmp_path, Settings(data_dir=tmp_path / "study"), (160, 90), 0, ProgressLine())[0].run()

    with monkeypatch.context() as once:
        once.setattr(recon.capture.masks.segment, "segment_capture", stopped)
        with pytest.raises(KeyboardInterrupt):
            record()
    record()
    for folder in ("capture", "practice/capture"):
        assert read_capture(tmp_path / folder).sensors[0].mask is not None


def test_a_demo_leaves_a_folder_alone_that_another_server_serves(tmp_path: Path, command: Command) -> None:
    with alone(Settings(data_dir=tmp_path / DATA_FOLDER)):
        told = command("demo", "--out", tmp_path, "--no-serve")
    assert told.code == 1
    assert f"serves {tmp_path / DATA_FOLDER} already; stop it" in told.err
    assert not (tmp_path / "capture").exists()


def test_a_demo_keeps_the_size_of_the_films_that_its_study_is_made_of(tmp_path: Path, command: Command) -> None:
    assert _demo_size(tmp_path, None) == (1280, 720)
    assert _demo_size(tmp_path, "640x360") == (640, 360)
    (tmp_path / "stimuli").mkdir()
    write_json(tmp_path / "stimuli" / "manifest.json", {"stimuli": [{"width": 640, "height": 360}]})
    assert _demo_size(tmp_path, None) == (640, 360)
    told = command("demo", "--out", tmp_path, "--size", "1280x720", "--no-serve")
    assert told.code == 2
    assert "has films of 640x360 and a study of them" in told.err
