"""Everything that is wrong with a capture, in one go, and what accuracy its geometry promises."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from recon.capture.continuity import Glance, Glances, continuity_problems, count_problems, glance_at
from recon.capture.format import CaptureError, expected_pictures, frame_pictures, read_draft, read_picture
from recon.capture.schema import Draft
from recon.capture.sensor_check import SensorReport, check_sensor

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class CheckReport:
    """What `check_capture` found: the sound sensors' figures and one sentence for every problem.

    Parameters
    ----------
    glances : thumbnails of all frames of every camera that could be read
    """

    folder: str
    n_frames: int | None
    sensors: tuple[SensorReport, ...]
    problems: tuple[str, ...]
    glances: Glances = field(default_factory=dict, repr=False, compare=False)

    @property
    def verdicts(self) -> tuple[str, ...]:
        """One sentence for every sensor."""
        return tuple(sensor.verdict() for sensor in self.sensors)

    def as_json(self) -> dict[str, Any]:
        """The report as a JSON object."""
        return {
            "schema_version": SCHEMA_VERSION,
            "folder": self.folder,
            "n_frames": self.n_frames,
            "sensors": [{**asdict(sensor), "texture": sensor.texture} for sensor in self.sensors],
            "verdicts": list(self.verdicts),
            "problems": list(self.problems),
        }

    def as_text(self) -> str:
        """Two lines for each sensor; the problems are left to the caller."""
        return "\n".join(f"{sensor.as_line()}\n{sensor.verdict()}" for sensor in self.sensors)


def check_capture(capture_folder: Path) -> CheckReport:
    """Read all of a capture and list everything that is wrong with it."""
    draft = read_draft(capture_folder)
    n_frames = draft.n_frames or 0
    glances, unreadable = _look_through(capture_folder, draft)
    problems = [*draft.problems, *unreadable, *continuity_problems(glances)]
    problems += count_problems(capture_folder, draft.cameras, n_frames)
    reports = []
    for stream in draft.sensors:
        report, found = check_sensor(capture_folder, stream, n_frames, draft.bounds)
        reports.append(report)
        problems += found
    return CheckReport(str(capture_folder), draft.n_frames, tuple(reports), tuple(problems), glances)


def _look_through(folder: Path, draft: Draft) -> tuple[Glances, list[str]]:
    """Read every picture once: glances at the sound sensors' frames, and what is wrong with the files."""
    patterns = {
        picture.path: side.image
        for frame in range(draft.n_frames or 0)
        for stream in draft.sensors
        for side, picture in zip((stream.left, stream.right), frame_pictures(folder, stream, frame), strict=True)
    }
    broken: set[Path] = set()
    problems: list[str] = []
    glances: dict[str, dict[int, Glance]] = {}
    for picture in expected_pictures(folder, draft):
        if picture.path in broken:
            continue  # a later frame of a video fails for the same reason
        try:
            pixels = read_picture(picture)
        except CaptureError as error:
            broken.add(picture.path)
            problems.append(str(error))
            continue
        if picture.path in patterns:
            glances.setdefault(patterns[picture.path], {})[picture.frame] = glance_at(pixels)
    return glances, problems
