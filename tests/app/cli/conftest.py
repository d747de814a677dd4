"""A stimulus set for commands on studies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recon.render.encoding.video import write_video


@pytest.fixture
def stimuli(tmp_path: Path) -> Path:
    """A stimulus set of two tiny videos."""
    from recon.pipeline.manifest import Stimulus, write_manifest

    folder = tmp_path / "stimuli"
    made = []
    for grey, approach in ((60, "id_fa"), (180, "id_fb")):
        frames = [np.full((48, 64, 3), grey + 5 * frame, np.uint8) for frame in range(5)]
        facts = write_video(folder / f"ball/{approach}.mp4", frames, size=(64, 48), fps=25)
        levels = {"depth": "id", "fusion": approach[3:]}
        made.append(
            Stimulus(
                "ball",
                approach,
                levels,
                f"ball/{approach}.mp4",
                None,
                64,
                48,
                25.0,
                facts.n_frames,
                facts.codec,
                "software",
                1,
                "static",
                {},
            )
        )
    write_manifest(folder, "tiny", made, {})
    return folder
