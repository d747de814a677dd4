"""The check of a capture: everything that is wrong with it, in one go, and what accuracy its geometry promises."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.bits import brightness_doubt
from recon.capture.checking.consistency import (
    MAX_BRIGHTNESS,
    Comparison,
    Shared,
    compared,
    disagreements,
    fitting,
    shared_points,
    unexplained,
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
    is_reversed,
    level_ratios,
    matched_levels,
    unlike,
)
from recon.capture.checking.diagnosis import Correction
from recon.capture.checking.lag import Lag
from recon.capture.checking.matches import Matches, match_pictures
from recon.capture.checking.sensor import SensorCheck, check_sensor, measured_frames
from recon.capture.checking.sensor_report import UNCHECKED, SensorReport
from recon.capture.checking.silhouettes import Silhouette, Silhouettes, silhouette_of
from recon.capture.checking.synchrony import SilhouetteFindings, silhouette_findings, synchrony_problems, would_lag_show
from recon.capture.format import (
    CaptureError,
    expected_pictures,
    foreground,
    frame_pictures,
    mask_pictures,
    read_draft,
    read_picture,
)
from recon.capture.recording import CameraStream, SensorStream
from recon.capture.schema import Draft
from recon.runtime.remote import fetched

SCHEMA_VERSION = 1
SAME_POSE = 1e-6  # mm, and of a rotation's elements: what rounding in a file makes of one pose
MAX_APART_PX = 0.4  # of disparity: what two sensors may differ on a point that both see; features reach half of it


@dataclass(frozen=True)
class CheckReport:
    """The result of `check_capture`: figures of the sound sensors, and sentences on what is wrong.

    Parameters
    ----------
    problems : each makes the capture unusable or its depths wrong
    warnings : each costs accuracy or single frames; the capture can be used
    glances : thumbnails of all frames of every camera that could be read
    lags : how late the second of two neighbouring sensors is, by their ids, where silhouettes tell it
    corrections : small ones of sensors whose rows are apart, by their ids
    """

    folder: str
    n_frames: int | None
    sensors: tuple[SensorReport, ...]
    problems: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    glances: Glances = field(default_factory=dict, repr=False, compare=False)
    lags: Mapping[tuple[str, str], Lag] = field(default_factory=dict)
    corrections: Mapping[str, Correction] = field(default_factory=dict)

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Say one sentence for every sensor."""
        return tuple(sensor.verdict() for sensor in self.sensors)

    @property
    def conclusion(self) -> str:
        """Say in a sentence whether the capture can be used."""
        if self.problems:
            return "The capture cannot be used as it is."
        if self.warnings:
            return "The capture can be used; mind the warnings."
        unchecked = any(UNCHECKED in verdict for verdict in self.verdicts)
        return f"Nothing is wrong{', as far as it could be checked' if unchecked else ''}."

    def as_json(self) -> dict[str, Any]:
        """Return the report as a JSON object."""
        return {
            "schema_version": SCHEMA_VERSION,
            "folder": self.folder,
            "n_frames": self.n_frames,
            "sensors": [{**asdict(sensor), "texture": sensor.texture} for sensor in self.sensors],
            "lags": [{"sensors": list(names), **asdict(lag)} for names, lag in self.lags.items()],
            "corrections": [{"sensor": name, **asdict(change)} for name, change in self.corrections.items()],
            "verdicts": list(self.verdicts),
            "problems": list(self.problems),
            "warnings": list(self.warnings),
        }

    def as_text(self) -> str:
        """Say two lines for each sensor, and their lags; problems and warnings are left to the caller."""
        lags = [f"{second} is {lag} behind {first}" for (first, second), lag in self.lags.items()]
        return "\n".join([*(f"{sensor.as_line()}\n{sensor.verdict()}" for sensor in self.sensors), *lags])


def check_capture(capture_folder: Path) -> CheckReport:
    """Read all of a capture and list everything that is wrong with it."""
    draft = read_draft(capture_folder)
    n_frames = draft.n_frames or 0
    glances, silhouettes, unreadable = _look_through(capture_folder, draft)
    checks = [check_sensor(capture_folder, stream, n_frames, draft.bounds, silhouettes) for stream in draft.sensors]
    instants = silhouette_findings(draft, silhouettes)
    problems = [*draft.problems, *unreadable, *frozen_cameras(glances), *_at_one_place(draft, glances)]
    problems += _other_instants(draft, glances, instants)
    doubled = [stream.id for stream in draft.sensors if is_one_camera_twice(stream, glances)]
    problems += [
        f"sensor {name}: its left and right pictures are the same, one camera's; give each camera its own"
        for name in doubled
    ]
    problems += [problem for check in checks if check.report.id not in doubled for problem in check.problems]
    comparisons = None if problems else list(_comparisons(capture_folder, draft, checks))
    problems += disagreements(comparisons or ())
    warnings = [
        *draft.ignored,
        *_without_masks(draft.sensors),
        *(() if problems else _bounds_beside_pictures(draft)),
        *(() if problems else brightness_doubt(_recorded(capture_folder, draft))),
        *unexplained(comparisons or ()),
        *unlike_exposures(comparisons or ()),
        *instants.warnings,
        *count_warnings(capture_folder, draft.cameras, n_frames),
        *continuity_warnings(glances),
    ]
    warnings += [warning for check in checks for warning in check.warnings]
    reports = tuple(
        _beside_others(replace(check.report, are_instants_checked=would_lag_show(stream, glances)), comparisons)
        for stream, check in zip(draft.sensors, checks, strict=True)
    )
    corrections = {check.report.id: check.correction for check in checks if check.correction is not None}
    verdict = tuple(problems), tuple(warnings), glances, instants.decided, corrections
    return CheckReport(str(capture_folder), draft.n_frames, reports, *verdict)


def _beside_others(report: SensorReport, comparisons: Sequence[Comparison] | None) -> SensorReport:
    """Add to the report of a sensor with a pair whether another one sees enough of the same points."""
    if report.is_checked is None or comparisons is None:
        return report
    others = [comparison.is_known for comparison in comparisons if report.id in comparison.sensors]
    return replace(report, is_compared=any(others))


def _at_one_place(draft: Draft, glances: Glances) -> Iterator[str]:
    """Say that two cameras have one pose, but not the same pictures; pairs may share a camera."""
    for first, second in combinations(draft.cameras, 2):
        apart = np.abs(first.camera.cam_from_world - second.camera.cam_from_world)
        if apart.max() <= SAME_POSE and _differ(first, second, glances):
            yield (
                f"{first.image} and {second.image} have the same pose, but not the same pictures; two cameras cannot "
                "be at one place: was the pose of one taken for that of the other?"
            )


def _differ(first: CameraStream, second: CameraStream, glances: Glances) -> bool:
    its, others = (glances.get(stream.image, {}) for stream in (first, second))
    return any(its[frame].checksum != others[frame].checksum for frame in its.keys() & others.keys())


def _other_instants(draft: Draft, glances: Glances, instants: SilhouetteFindings) -> Iterator[str]:
    yield from synchrony_problems(draft.sensors, glances, instants.decided)
    yield from instants.problems


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


def _recorded(folder: Path, draft: Draft) -> Iterator[Path]:
    """Yield the files of all pictures that sensors recorded."""
    for stream in draft.sensors:
        for frame in range(draft.n_frames or 0):
            yield from (fetched(picture.path) for picture in frame_pictures(folder, stream, frame))


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
            if comparison.is_known:
                levels = np.concatenate([levels for _, levels in looks], axis=1)
                brightness = unlike(level_ratios(levels)[:, 0], MAX_BRIGHTNESS)
                comparison = replace(comparison, brightness=brightness, are_colours_reversed=is_reversed(levels))
            yield comparison


def _look_between(
    folder: Path, streams: tuple[SensorStream, SensorStream], matches: tuple[Matches, Matches], frame: int
) -> tuple[Shared, NDArray[np.float64]]:
    """Find the points that two sensors see, and how they look in the first's picture beside the second's."""
    right, left = (
        read_picture(frame_pictures(folder, stream, frame)[side]) for stream, side in zip(streams, (1, 0), strict=True)
    )
    shared = fitting(streams[0].sensor, streams[1].sensor, shared_points(*matches, match_pictures(right, left)))
    return shared, matched_levels(right, left, Matches(shared.first.right, shared.second.left))


def _look_through(folder: Path, draft: Draft) -> tuple[Glances, Silhouettes, list[str]]:
    """Read every picture once: glances at the sound sensors' frames, silhouettes, and what is wrong with the files."""
    patterns: dict[Path, str] = {}
    mask_patterns: dict[Path, str] = {}
    for stream in draft.sensors:
        for frame in range(draft.n_frames or 0):
            for side, picture in zip(stream.cameras, frame_pictures(folder, stream, frame), strict=True):
                patterns[picture.path] = side.image
            for pattern, picture in zip(stream.mask or (), mask_pictures(folder, stream, frame), strict=True):
                mask_patterns[picture.path] = pattern
    broken: set[Path] = set()
    problems: list[str] = []
    glances: dict[str, dict[int, Glance]] = {}
    silhouettes: dict[str, dict[int, Silhouette]] = {}
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
        elif picture.path in mask_patterns:
            silhouette = silhouette_of(foreground(pixels))
            silhouettes.setdefault(mask_patterns[picture.path], {})[picture.frame] = silhouette
    return glances, silhouettes, problems
