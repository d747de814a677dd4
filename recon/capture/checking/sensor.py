"""The check of one sensor: does its calibration fit its pictures, is there texture, what accuracy can be expected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.checking.agreement import (
    FEWEST,
    LOWEST_SHARE,
    Agreement,
    agreeing,
    agreeing_with_each_other,
    mirrored_problems,
)
from recon.capture.checking.continuity import exposure_warnings, matched_levels
from recon.capture.checking.depth import DepthCheck, bounds_area, check_depth_maps
from recon.capture.checking.diagnosis import (
    MIN_ERROR_PX,
    MIN_GAIN,
    Correction,
    diagnose,
    small_correction,
    would_lenses_show,
)
from recon.capture.checking.matches import Matches, epipolar_errors, joined, match_pictures
from recon.capture.checking.rows import OFF_PX, fit_rows, pivot_of
from recon.capture.checking.sensor_report import Rows, SensorReport
from recon.capture.checking.silhouettes import Silhouettes, check_masks, listed
from recon.capture.format import CaptureError, SensorStream, frame_pictures, mask_pictures, read_mask, read_picture
from recon.capture.noise import noise_deviation
from recon.capture.recording import evenly_chosen
from recon.capture.rectify import Rectification, rectify, rectify_images, rectify_masks
from recon.geometry.rig import Sensor

MAX_VERTICAL_ERROR_PX = 1.0  # above, matching along rows fails; good calibrations reach 0.1 to 0.3
MEASURED_FRAMES = 3  # first, middle, last
MOST_SHOTS = 12  # frames of a recording that is one of shots, not a film
MIRRORED = 0.5  # of the disparities of swapped pictures lie within the bounds with their sign changed
MIN_INSIDE = 0.05  # of the matched points have a disparity of the bounds, or of the masks lie in them
MIN_BOUNDS_PX = 256  # of a picture that show the bounds; an object of fewer has no shape
MATCHED_PX = 0.25  # what disparities are good to: root mean square on benchmarks with known truth
TEXTURE_WINDOW = 9  # pixels, about a matcher's
MIN_TEXTURE = 2.5  # grey levels of local standard deviation, the noise's taken off
WHITE = 250  # levels of two channels: of colours, the third has little structure, and comes last
MOST_WHITE, MOST_WHITE_UNMASKED = 0.2, 0.6  # of the object; of what the bounds show, which may be a white wall


@dataclass(frozen=True, eq=False)
class _Look:
    """Measurements on one frame.

    Parameters
    ----------
    frame : its number
    rectified : matches of the rectified pair, within the masks or bounds
    matches : of the pictures as recorded
    levels : (2, M, 4) of `matched_levels`
    textured : share of the area; None if there is none
    inside : share of the left mask that lies within the bounds; None without a mask, or if it is empty
    white : share of the area with two channels at the top, of the picture with more; None if there is no area
    """

    frame: int
    rectified: Matches
    matches: Matches
    levels: NDArray[np.float64]
    textured: float | None
    inside: float | None
    white: float | None


@dataclass(frozen=True, eq=False)
class SensorCheck:
    """The result of one sensor's check.

    Parameters
    ----------
    problems, warnings : one sentence for everything that spoils depth, and for everything that makes it worse
    matches : by the measured frame, points of the pictures as recorded
    correction : of the calibration, where rows are apart and one helps
    """

    report: SensorReport
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    matches: dict[int, Matches] = field(default_factory=dict)
    correction: Correction | None = None


def check_sensor(
    folder: Path,
    stream: SensorStream,
    n_frames: int,
    bounds: NDArray[np.float64] | None,
    silhouettes: Silhouettes = MappingProxyType({}),
) -> SensorCheck:
    """Measure one sensor: its pair, its depth maps, or both.

    Parameters
    ----------
    folder : the capture's
    stream : the sensor and its images
    n_frames : of the capture
    bounds : float64 (2, 3), mm, of the capture; None if they are unknown
    silhouettes : of its masks
    """
    baseline = None if stream.right is None else stream.sensor.baseline
    coverage, problems, warnings = check_masks(stream, silhouettes)
    check = SensorCheck(SensorReport(stream.id, baseline, mask_coverage=coverage), tuple(problems), tuple(warnings))
    if bounds is not None and stream.depth is not None:
        check = _with_depth_maps(check, check_depth_maps(folder, stream, n_frames, bounds))
    if bounds is not None and stream.right is not None:
        check = _with_pair(check, folder, stream, n_frames, bounds)
    return check


def _with_depth_maps(check: SensorCheck, depth: DepthCheck) -> SensorCheck:
    """Add what the check of a sensor's depth maps says."""
    return replace(
        check,
        report=replace(check.report, depth_coverage=depth.coverage, depth_mm=depth.median_mm),
        problems=(*check.problems, *depth.problems),
        warnings=(*check.warnings, *depth.warnings),
    )


def _with_pair(
    check: SensorCheck, folder: Path, stream: SensorStream, n_frames: int, bounds: NDArray[np.float64]
) -> SensorCheck:
    """Add what the pictures of a sensor's pair say."""
    try:
        rectification = rectify(stream.sensor, bounds)
    except ValueError as error:
        return replace(check, problems=(*check.problems, str(error)))
    shots = []
    for frame in measured_frames(n_frames):
        with suppress(CaptureError):  # its pictures are listed already
            shots.append(_look(folder, stream, frame, rectification, bounds))
    swapped = _swapped(stream.sensor, shots, rectification)
    looks = [look for look in shots if look.frame not in swapped]
    matched = joined([look.matches for look in looks])
    agree = agreeing_with_each_other(stream.sensor, matched)
    levels = np.concatenate([np.zeros((2, 0, 4)), *(look.levels for look in looks)], axis=1)
    matches = matched[agree]
    agreement = Agreement(len(matches), len(matched))
    rows = _rows(joined([look.rectified for look in looks]), rectification)
    is_checked = agreement.is_enough or Agreement(rows.n_agreeing, rows.n_matches).is_enough
    misfit = _misfit(stream.sensor, matches, rows)
    correction = small_correction(stream.sensor, matches) if agreement.is_enough and misfit > OFF_PX else None
    faults = diagnose(stream.sensor, matches) if agreement.is_enough else ()
    row_faults = faults or tuple(_row_problems(rectification, rows, misfit))
    textured = [look.textured for look in looks if look.textured is not None]
    depth = rectification.left.points_in_camera(bounds.mean(axis=0, keepdims=True))[0, 2]
    per_pixel = float(depth**2 / (rectification.focal * rectification.baseline))
    report = replace(
        check.report,
        rectified_size=rectification.left.size,
        n_disparities=rectification.n_disparities,
        depth_per_disparity_mm=per_pixel,
        expected_error_mm=per_pixel * float(np.hypot(MATCHED_PX, misfit)) if is_checked and not faults else None,
        textured=float(np.mean(textured)) if textured else None,
        rows=rows,
        is_checked=is_checked,
        are_lenses_checked=agreement.is_enough and would_lenses_show(stream.sensor, matches),
    )
    return SensorCheck(
        report,
        (
            *check.problems,
            *_swapped_problems(stream.id, swapped, len(shots)),
            *mirrored_problems(folder, stream, [look.frame for look in looks], agreement),
            *row_faults,
            *(list(_bounds_problems(stream, bounds, looks)) or _error_problems(report, bounds)),
        ),
        (
            *check.warnings,
            *(() if is_checked else (_unchecked(stream.id, agreement),)),
            *_row_warnings(report, misfit, correction, is_told=bool(row_faults)),
            *(exposure_warnings(stream.id, levels[:, agree]) if agreement.is_enough else ()),
            *_texture_warnings(report),
            *_white_warnings(stream, looks),
        ),
        {look.frame: look.matches for look in looks},
        correction,
    )


def _unchecked(sensor_id: str, agreement: Agreement) -> str:
    return (
        f"sensor {sensor_id}: its calibration could not be checked, because only {agreement}, expected at least "
        f"{FEWEST} and {LOWEST_SHARE:.0%}; look whether left and right show the same, with texture and light"
    )


def _swapped(sensor: Sensor, shots: Sequence[_Look], rectification: Rectification) -> list[int]:
    """List the frames whose left and right pictures are swapped; none if all are, as then the sensor is wrong."""
    swapped = [look.frame for look in shots if _is_swapped(sensor, look, rectification)]
    return swapped if len(swapped) < len(shots) else []


def _is_swapped(sensor: Sensor, look: _Look, rectification: Rectification) -> bool:
    """Do the matches of one shot fit the calibration clearly better with left and right exchanged?"""
    matches = look.matches[agreeing_with_each_other(sensor, look.matches)]
    if not Agreement(len(matches), len(look.matches)).is_enough:
        return False
    error = float(np.median(np.abs(epipolar_errors(sensor, matches))))
    exchanged = float(np.median(np.abs(epipolar_errors(sensor, Matches(matches.right, matches.left)))))
    if error > MIN_ERROR_PX and exchanged < MIN_GAIN * error:
        return True
    disparities = (look.rectified.left - look.rectified.right)[agreeing(look.rectified), 0]
    if len(disparities) < FEWEST:
        return False
    n = rectification.n_disparities
    inside, mirrored = (((d >= 0) & (d < n)).mean() for d in (disparities, -disparities))
    return bool(inside < MIN_INSIDE and mirrored > MIRRORED)


def _swapped_problems(sensor_id: str, swapped: Sequence[int], n_shots: int) -> Iterator[str]:
    if swapped:
        yield (
            f"sensor {sensor_id}: left and right are swapped in {listed(swapped)}, but not in the other "
            f"{n_shots - len(swapped)} that were measured; exchange these pictures"
        )


def _error_problems(report: SensorReport, bounds: NDArray[np.float64]) -> Iterator[str]:
    """Say that what the geometry promises is worse than knowing nothing but the bounds."""
    smallest = float((bounds[1] - bounds[0]).min())
    if report.expected_error_mm is not None and report.expected_error_mm > smallest:
        yield (
            f"sensor {report.id}: the depth error to expect, {report.expected_error_mm:.0f} mm, is larger than the "
            f"bounds ({smallest:.0f} mm); the baseline is too short for this distance, or the calibration is wrong"
        )


def _bounds_problems(stream: SensorStream, bounds: NDArray[np.float64], looks: Sequence[_Look]) -> Iterator[str]:
    """Say that bounds in front of a sensor show next to nothing, or not what is masked; distortion is left out."""
    n_pixels = int(bounds_area(stream.left.camera, bounds).sum())
    if n_pixels < MIN_BOUNDS_PX:
        size = "x".join(f"{length:.4g}" for length in bounds[1] - bounds[0])
        yield (
            f"sensor {stream.id}: the bounds of {size} mm show as {n_pixels} pixels of the left picture, expected at "
            f"least {MIN_BOUNDS_PX}; they are the box around the object, in mm"
        )
        return
    inside = [look.inside for look in looks if look.inside is not None]
    if inside and np.mean(inside) < MIN_INSIDE:
        yield (
            f"sensor {stream.id}: {np.mean(inside):.0%} of what the left masks show lies within the bounds; check the "
            "bounds, their unit (mm) and the masks"
        )


def measured_frames(n_frames: int) -> list[int]:
    """Choose the frames that are measured closely: of shots all, as each may be wrong for itself."""
    return evenly_chosen(n_frames, n_frames if n_frames <= MOST_SHOTS else MEASURED_FRAMES)


def _look(
    folder: Path, stream: SensorStream, frame: int, rectification: Rectification, bounds: NDArray[np.float64]
) -> _Look:
    left, right = map(read_picture, frame_pictures(folder, stream, frame))
    masks = tuple(map(read_mask, mask_pictures(folder, stream, frame)))
    pair = rectify_images(rectification, left, right)
    if masks:
        areas = rectify_masks(rectification, *masks)
    else:
        areas = (bounds_area(rectification.left, bounds), bounds_area(rectification.right, bounds))
    rectified = match_pictures(*pair, areas)
    matches = match_pictures(left, right)
    return _Look(
        frame,
        rectified,
        matches,
        matched_levels(left, right, matches),
        _textured(pair[0], areas[0]),
        float(bounds_area(stream.left.camera, bounds)[masks[0]].mean()) if masks and masks[0].any() else None,
        max(
            (
                float((np.median(side[area], axis=1) >= WHITE).mean())
                for side, area in zip(pair, areas, strict=True)
                if area.any()
            ),
            default=None,
        ),
    )


def _textured(image: NDArray[np.uint8], area: NDArray[np.bool_]) -> float | None:
    """Return the share of an area whose structure stands out of the noise; None of an empty one."""
    if not area.any():
        return None
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    levels, window = grey.astype(np.float32), (TEXTURE_WINDOW, TEXTURE_WINDOW)
    variance = cv2.blur(levels * levels, window) - cv2.blur(levels, window) ** 2
    return float((variance[area] - noise_deviation(grey) ** 2 > MIN_TEXTURE**2).mean())


def _rows(rectified: Matches, rectification: Rectification) -> Rows:
    kept = rectified[agreeing(rectified)]
    if len(kept) == 0:
        return Rows(len(rectified), None, None)
    disparities, differences = (kept.left - kept.right).T
    inside = (disparities >= 0) & (disparities < rectification.n_disparities)
    vertical_error, disparity = float(np.median(np.abs(differences))), float(np.median(disparities))
    fit = fit_rows(rectified, pivot_of(rectification))
    left = fit.after_px if fit is not None and fit.is_off else None
    return Rows(len(rectified), vertical_error, disparity, float(np.mean(inside)), len(kept), left)


def _misfit(sensor: Sensor, matches: Matches, rows: Rows) -> float:
    """Return how far the calibration is off, pixels: on the object, or on all of the picture where that tells more.

    A glossy or plain object gives few and wrong matches; the room behind it then shows that the calibration fits.
    """
    on_object = rows.vertical_error_px
    if len(matches) < max(FEWEST, rows.n_agreeing):
        return on_object or 0.0
    everywhere = float(np.median(np.abs(epipolar_errors(sensor, matches))))
    return everywhere if on_object is None else min(on_object, everywhere)


def _row_problems(rectification: Rectification, rows: Rows, misfit: float) -> Iterator[str]:
    is_enough = Agreement(rows.n_agreeing, rows.n_matches).is_enough
    if not is_enough or rows.vertical_error_px is None or rows.inside is None:
        return
    place = f"sensor {rectification.sensor_id}: {rows.n_agreeing} of {rows.n_matches} matched points agree; they"
    if misfit > MAX_VERTICAL_ERROR_PX:
        yield (
            f"{place} differ vertically by {rows.vertical_error_px:.2f} px after rectification (median), expected at "
            f"most {MAX_VERTICAL_ERROR_PX:g}; the calibration does not fit the pictures"
        )
    if rows.inside < MIN_INSIDE:
        yield (
            f"{place} have a disparity of {rows.disparity_px:.1f} px (median), the bounds span 0 to "
            f"{rectification.n_disparities - 1}; the bounds, the baseline or the order of left and right are wrong"
        )


def _row_warnings(
    report: SensorReport, misfit: float, correction: Correction | None, *, is_told: bool
) -> Iterator[str]:
    """Say that rows are apart, and what a correction would gain; `is_told` of what is a problem already."""
    if report.is_checked is False or misfit <= OFF_PX:
        return
    if not is_told:
        yield (
            f"sensor {report.id}: rows are {misfit:.2f} px apart after rectification, expected at most a third of a "
            "pixel; "
        ) + (
            "no small shift, turn and stretch brings them together: calibrate again"
            if report.rows is None or report.rows.left_px is None
            else f"`reconstruct` and `match` move them together, of which {report.rows.left_px:.2f} remain"
        )
    if correction is not None:
        yield f"sensor {report.id}: {correction}; `capture check --correct` writes the recording with it"


def _white_warnings(stream: SensorStream, looks: Sequence[_Look]) -> Iterator[str]:
    white = [look.white for look in looks if look.white is not None]
    if white and np.mean(white) > (MOST_WHITE if stream.mask else MOST_WHITE_UNMASKED):
        yield (
            f"sensor {stream.id}: {np.mean(white):.0%} of what the {'masks' if stream.mask else 'bounds'} show is "
            "overexposed, without structure; use less light or a shorter exposure"
        )


def _texture_warnings(report: SensorReport) -> Iterator[str]:
    if report.texture == "poor":
        yield f"sensor {report.id}: only {report.textured:.0%} of the object has enough texture to be matched"
