"""The check of a capture: everything that is wrong with it, in one go, and what accuracy its geometry promises."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.checking.consistency import (
    Comparison,
    Shared,
    compared,
    disagreements,
    shared_points,
    unlike_exposures,
)
from recon.capture.checking.continuity import (
    Glance,
    Glances,
    continuity_warnings,
    count_warnings,
    frozen_cameras,
    glance_at,
    is_one_camera_twice,
)
from recon.capture.checking.matches import Matches, match_pictures
from recon.capture.checking.sensor import SensorCheck, brightness_ratios, check_sensor, measured_frames
from recon.capture.checking.sensor_report import SensorReport
from recon.capture.checking.synchrony import SilhouetteFindings, silhouette_findings, synchrony_problems
from recon.capture.format import CaptureError, expected_pictures, frame_pictures, read_draft, read_picture
from recon.capture.recording import SensorStream
from recon.capture.schema import Draft

SCHEMA_VERSION = 1
MAX_APART_PX = 0.4  # of disparity: what two sensors may differ on a point that both see; features reach half of it


@dataclass(frozen=True)
class CheckReport:
    """The result of `check_capture`: figures of the sound sensors, and sentences on what is wrong.

    Parameters
    ----------
    problems : each makes the capture unusable or its depths wrong
    warnings : each costs accuracy or single frames; the capture can be used
    glances : thumbnails of all frames of every camera that could be read
    """

    folder: str
    n_frames: int | None
    sensors: tuple[SensorReport, ...]
    problems: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    glances: Glances = field(default_factory=dict, repr=False, compare=False)

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Say one sentence for every sensor."""
        return tuple(sensor.verdict() for sensor in self.sensors)

    def as_json(self) -> dict[str, Any]:
        """Return the report as a JSON object."""
        return {
            "schema_version": SCHEMA_VERSION,
            "folder": self.folder,
            "n_frames": self.n_frames,
            "sensors": [{**asdict(sensor), "texture": sensor.texture} for sensor in self.sensors],
            "verdicts": list(self.verdicts),
            "problems": list(self.problems),
            "warnings": list(self.warnings),
        }

    def as_text(self) -> str:
        """Say two lines for each sensor; problems and warnings are left to the caller."""
        return "\n".join(f"{sensor.as_line()}\n{sensor.verdict()}" for sensor in self.sensors)


def check_capture(capture_folder: Path) -> CheckReport:
    """Read all of a capture and list everything that is wrong with it."""
    draft = read_draft(capture_folder)
    n_frames = draft.n_frames or 0
    glances, unreadable = _look_through(capture_folder, draft)
    checks = [check_sensor(capture_folder, stream, n_frames, draft.bounds) for stream in draft.sensors]
    silhouettes = silhouette_findings(capture_folder, draft)
    problems = [*draft.problems, *unreadable, *frozen_cameras(glances), *_other_instants(draft, glances, silhouettes)]
    doubled = [stream.id for stream in draft.sensors if is_one_camera_twice(stream, glances)]
    problems += [
        f"sensor {name}: its left and right pictures are the same, one camera's; give each camera its own"
        for name in doubled
    ]
    problems += [problem for check in checks if check.report.id not in doubled for problem in check.problems]
    comparisons = [] if problems else list(_comparisons(capture_folder, draft, checks))
    problems += disagreements(comparisons)
    warnings = [
        *draft.ignored,
        *_without_masks(draft.sensors),
        *(() if problems else _bounds_beside_pictures(draft)),
        *unlike_exposures(comparisons),
        *silhouettes.warnings,
        *count_warnings(capture_folder, draft.cameras, n_frames),
        *continuity_warnings(glances),
    ]
    warnings += [warning for check in checks for warning in check.warnings]
    reports = tuple(check.report for check in checks)
    return CheckReport(str(capture_folder), draft.n_frames, reports, tuple(problems), tuple(warnings), glances)


def _other_instants(draft: Draft, glances: Glances, silhouettes: SilhouetteFindings) -> Iterator[str]:
    yield from synchrony_problems(draft.sensors, glances, silhouettes.decided)
    yield from silhouettes.problems


def _without_masks(sensors: Sequence[SensorStream]) -> Iterator[str]:
    for stream in sensors:
        if not stream.mask and any(other.mask for other in sensors):
            yield (
                f"sensor {stream.id} has no masks, but others have: what it sees of the background within the bounds "
                "becomes surface; make masks of all sensors by `capture segment`"
            )


def _bounds_beside_pictures(draft: Draft) -> Iterator[str]:
    """Say that no camera of stereo pairs, whose bounds lie in front of them, shows the middle of the bounds."""
    if draft.bounds is None or any(stream.right is None for stream in draft.sensors):
        return
    middle = draft.bounds.mean(axis=0, keepdims=True)
    shares = [stream.camera.project(middle)[0] / stream.camera.size for stream in draft.cameras]  # of width and height
    if not any(((share >= 0) & (share < 1)).all() for share in shares):
        yield "no camera shows the middle of the bounds; they are the box around the object, in mm"


def _comparisons(folder: Path, draft: Draft, checks: Sequence[SensorCheck]) -> Iterator[Comparison]:
    pairs = [(stream, check) for stream, check in zip(draft.sensors, checks, strict=True) if stream.right is not None]
    for (first, its), (second, others) in pairwise(pairs):
        looks = [
            _look_between(folder, (first, second), (its.matches[frame], others.matches[frame]), frame)
            for frame in measured_frames(draft.n_frames or 0)
            if frame in its.matches and frame in others.matches
        ]
        per_pixel = [check.report.depth_per_disparity_mm for check in (its, others)]
        if looks and None not in per_pixel:
            tolerance = MAX_APART_PX * max(value for value in per_pixel if value is not None)
            comparison = compared(first.sensor, second.sensor, [shared for shared, _ in looks], tolerance)
            if comparison is not None:
                ratios = np.concatenate([ratios for _, ratios in looks])
                yield replace(comparison, brightness=float(np.median(ratios)) if len(ratios) else None)


def _look_between(
    folder: Path, streams: tuple[SensorStream, SensorStream], matches: tuple[Matches, Matches], frame: int
) -> tuple[Shared, NDArray[np.float64]]:
    """Find the points that two sensors see, and how bright each is in the first's picture by the second's."""
    right, left = (
        read_picture(frame_pictures(folder, stream, frame)[side]) for stream, side in zip(streams, (1, 0), strict=True)
    )
    shared = shared_points(*matches, match_pictures(right, left))
    return shared, brightness_ratios(right, left, Matches(shared.first.right, shared.second.left))


def _look_through(folder: Path, draft: Draft) -> tuple[Glances, list[str]]:
    """Read every picture once: glances at the sound sensors' frames, and what is wrong with the files."""
    patterns = {
        picture.path: side.image
        for frame in range(draft.n_frames or 0)
        for stream in draft.sensors
        for side, picture in zip(stream.cameras, frame_pictures(folder, stream, frame), strict=True)
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
