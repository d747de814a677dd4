"""Clouds or meshes of several approaches against a reference, frame by frame: the content of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from recon.models.read import GLTF_SUFFIXES
from recon.runtime.workers import Progress, no_progress
from recon.validation.cloud_quality.compared import SYMMETRIC, Pair, Prepared
from recon.validation.cloud_quality.geometry import THRESHOLD_SHARE, intrinsic_peak
from recon.validation.cloud_quality.measures import MEASURES, WITH_SCORES, Measure, Scale, chosen
from recon.validation.cloud_quality.points import longest_side
from recon.validation.cloud_quality.reading import USUAL_POINTS, Sampling, area_of, read_point_set, sampled
from recon.validation.cloud_quality.remarks import check_unit, remarks_on
from recon.validation.cloud_quality.sequences import Compared
from recon.validation.clouds import read_shape
from recon.validation.measures import LESS, MORE, Measured, Subject, measure_rows

SOURCE, REFERENCE = "validate cloud", "reference"
WITH_PEAK = ("d1", "d2")  # measures with a PSNR


@dataclass(frozen=True, eq=False)
class Shown:
    """A distorted cloud with its errors, to be drawn.

    Parameters
    ----------
    name : of the approach
    points : float32 (N, 3)
    errors : float64 (N,), distances to the reference, in the unit of length
    is_signed : whether errors are along the reference's normals, positive outside; else distances
    """

    name: str
    points: NDArray[np.float32]
    errors: NDArray[np.float64]
    is_signed: bool


@dataclass(frozen=True, eq=False)
class Comparison:
    """What a comparison found: the content of report.json, all values, and the clouds of the first frame."""

    report: dict[str, Any]
    values: list[Measured]
    shown: list[Shown]


class Place(NamedTuple):
    """Where a value stands in the table of measures."""

    dataset: str
    approach: str
    frame: int | None


@dataclass(frozen=True, eq=False)
class CloudSettings:
    """Options of the comparison.

    Parameters
    ----------
    unit : of all clouds, for tables; nothing is converted
    peak : of the PSNR of D1 and D2; None for the largest distance between neighbours in each frame's reference
    threshold : of the F-score; None for a hundredth of the longest side of the first frame's reference
    sampling : of meshes
    measures : names; none for all
    others : measures of other programs and of plug-ins by name, each with its source in words
    """

    unit: str = "mm"
    peak: float | None = None
    threshold: float | None = None
    sampling: Sampling = field(default_factory=Sampling)
    measures: tuple[str, ...] = ()
    others: Mapping[str, tuple[Measure, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, length in (("peak", self.peak), ("threshold", self.threshold)):
            if length is not None and not (isfinite(length) and length > 0):
                raise ValueError(f"the {name} is {length:g}, expected a positive length")

    @property
    def known(self) -> dict[str, tuple[Measure, str]]:
        """All measures by name, with their sources."""
        return {name: (measure, SOURCE) for name, measure in MEASURES.items()} | dict(self.others)


@dataclass(frozen=True, eq=False)
class Findings:
    """What a comparison has found so far.

    Parameters
    ----------
    clouds : a row for each cloud
    values : of each frame
    skipped : a row for each measure that could not be taken, with the reason
    remarks : sentences on what to doubt
    shown : clouds of the first frame
    """

    clouds: list[dict[str, Any]] = field(default_factory=list)
    values: list[Measured] = field(default_factory=list)
    skipped: list[dict[str, Any]] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    shown: list[Shown] = field(default_factory=list)


def measure_clouds(compared: Compared, settings: CloudSettings, progress: Progress = no_progress) -> Comparison:
    """Compare every approach with the reference in every frame.

    The value of a sequence is the mean of those of its frames.

    Parameters
    ----------
    compared : files
    settings : options of the comparison
    progress : called as work is done

    Raises
    ------
    ValueError
        If a file cannot be read, a cloud is a hundred times larger than its reference, glTF, which is read in mm, is
        said to be in another unit, or nothing can be measured.
    """
    names = chosen(settings.measures, tuple(settings.known))
    _check_unit_of_gltf(compared, settings.unit)
    settings = _completed(settings, compared)
    findings = Findings(remarks=list(compared.left_out))
    done, total = 0, len(compared.frames) * len(compared.approaches)
    for frame in compared.frames:
        reference = Prepared(read_point_set(compared.reference_of(frame), settings.sampling))
        scale = Scale(settings.unit, settings.peak or intrinsic_peak(reference), settings.threshold)
        findings.clouds.append(_cloud_row(REFERENCE, frame, reference) | {"peak": scale.peak})
        for approach, files in compared.approaches.items():
            progress("clouds", done, total)
            shape, name = read_shape(files[frame]), str(files[frame])
            check_unit(shape, name, reference.cloud)
            distorted = Prepared(sampled(shape, name, settings.sampling))
            pair = Pair(reference, distorted, _pair_name(approach, frame))
            findings.clouds.append(_cloud_row(approach, frame, pair.distorted))
            findings.remarks.extend(remarks_on(pair))
            for name in names:
                _measure(name, settings, pair, scale, Place(compared.dataset, approach, frame), findings)
            if frame == compared.frames[0]:
                findings.shown.append(_shown(approach, pair))
            done += 1
    progress("clouds", total, total)
    if not findings.values:
        raise ValueError(f"nothing can be measured: {findings.skipped[0]['reason']}")
    values = _means(findings) if compared.frames != (None,) else []
    values += findings.values
    return Comparison(_report(compared, settings, names, findings, values), values, findings.shown)


def _check_unit_of_gltf(compared: Compared, unit: str) -> None:
    files = [path for group in (compared.reference, *compared.approaches.values()) for path in group.values()]
    gltf = next((path for path in files if path.suffix.lower() in GLTF_SUFFIXES), None)
    if gltf is not None and unit != "mm":
        raise ValueError(
            f"{gltf}: glTF is read in mm, but the unit is {unit}; bring the other clouds to mm, with --unit mm"
        )


def _completed(settings: CloudSettings, compared: Compared) -> CloudSettings:
    """Take the density and the threshold that were not given from the first frame's reference, for all frames."""
    reference = compared.reference_of(compared.frames[0])
    shape, sampling = read_shape(reference), settings.sampling
    if sampling.density is None and (area := area_of(shape)) > 0:
        sampling = Sampling(USUAL_POINTS / area, sampling.seed)
    side = longest_side(sampled(shape, str(reference), sampling))
    threshold = settings.threshold or THRESHOLD_SHARE * side or None
    return replace(settings, sampling=sampling, threshold=threshold)


def _pair_name(approach: str, frame: int | None) -> str:
    return approach if frame is None else f"{approach}_{frame:04d}"


def _measure(name: str, settings: CloudSettings, pair: Pair, scale: Scale, place: Place, findings: Findings) -> None:
    """Take a measure of a pair, and add its values, or the reason why there are none, to the findings."""
    measure, source = settings.known[name]
    row = {"approach": place.approach, "frame": place.frame, "measure": name}
    try:
        values = measure(pair, scale)
    except ValueError as error:
        findings.skipped.append(row | {"reason": str(error)})
        return
    findings.values.extend(
        Measured(*place, value.measure, value.direction, value.value, value.unit, value.better, source)
        for value in values
    )
    if scale.peak is None and name in WITH_PEAK:
        reason = f"{pair.reference.cloud.name}: has no two points apart to take a peak from; give --peak"
        findings.skipped.append(row | {"measure": f"{name}_psnr_db", "reason": reason})


def _shown(approach: str, pair: Pair) -> Shown:
    points, others = pair.distorted.places.points, pair.reference.places.points
    normals, nearest = pair.reference.cloud.normals, pair.first_in_reference
    if normals is None:
        return Shown(approach, points, np.sqrt(pair.to_reference.squared), is_signed=False)
    differences = points.astype(np.float64) - others[nearest]
    along = np.einsum("ij,ij->i", differences, pair.reference.places.first(normals)[nearest])
    return Shown(approach, points, along, is_signed=True)


def _means(findings: Findings) -> list[Measured]:
    """Average values over frames, for each approach, measure and direction."""
    groups: dict[tuple[str, str, str], list[Measured]] = {}
    for value in findings.values:
        groups.setdefault((value.approach, value.measure, value.direction), []).append(value)
    return [replace(group[0], frame=None, value=float(np.mean([v.value for v in group]))) for group in groups.values()]


def _cloud_row(name: str, frame: int | None, prepared: Prepared) -> dict[str, Any]:
    cloud = prepared.cloud
    return {
        "approach": name,
        "frame": frame,
        "file": cloud.name,
        "n_points": len(cloud),
        "n_duplicates": len(cloud) - len(prepared.places.points),
        "has_normals": cloud.normals is not None,
        "has_colours": cloud.colours is not None,
    }


def _report(
    compared: Compared, settings: CloudSettings, names: Sequence[str], findings: Findings, values: Sequence[Measured]
) -> dict[str, Any]:
    """Return the content of report.json; it writes infinity as "inf", because JSON has no number for it."""
    return {
        "schema_version": 1,
        "kind": "cloud",
        "settings": {
            "dataset": compared.dataset,
            "frames": list(compared.frames),
            "unit": settings.unit,
            "peak": settings.peak,
            "threshold": settings.threshold,
            "density": settings.sampling.density,
            "seed": settings.sampling.seed,
            "measures": list(names),
        },
        "clouds": findings.clouds,
        "values": [
            asdict(value) | {"value": value.value if isfinite(value.value) else str(value.value)} for value in values
        ],
        "skipped": findings.skipped,
        "remarks": list(dict.fromkeys(findings.remarks)),
        "measures": _with_scores(values),
    }


def _with_scores(values: Sequence[Measured]) -> list[dict[str, Any]]:
    """List the main measures of whole sequences, as a study takes them: finite ones, of both directions together."""
    ours = {value.measure for value in values if value.source == SOURCE}
    rows = []
    for value in values:
        is_whole = value.frame is None and value.direction in ("", SYMMETRIC)
        if is_whole and (value.measure in WITH_SCORES or value.measure not in ours):
            subject, direction = Subject(value.dataset, (value.approach,)), LESS if value.better == "lower" else MORE
            rows += measure_rows(subject, value.measure, value.value, direction=direction, unit=value.unit)
    return rows
