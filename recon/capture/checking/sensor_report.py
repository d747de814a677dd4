"""The report of one sensor's check: figures of geometry and texture, and a plain verdict of what to expect."""

from __future__ import annotations

from dataclasses import dataclass

UNCHECKED = "could not be checked"
TEXTURES = {"good": 0.7, "fair": 0.4, "poor": 0.0}  # by the textured share of what the bounds show


@dataclass(frozen=True)
class Rows:
    """How well matched points of a rectified pair lie in the same row.

    Parameters
    ----------
    n_matches : number of matched points
    vertical_error_px : median of |row left - row right| of the points that agree on one geometry, None without any
    disparity_px : their median disparity
    inside : share of them whose disparity is one of the bounds
    n_agreeing : how many they are
    left_px : what is left of the median where the rows' shift, turn and stretch are undone, None if it helps little
    """

    n_matches: int
    vertical_error_px: float | None
    disparity_px: float | None
    inside: float | None = None
    n_agreeing: int = 0
    left_px: float | None = None


@dataclass(frozen=True)
class SensorReport:
    """One sensor's geometry; what could not be found out is None.

    Parameters
    ----------
    rectified_size : (width, height), pixels
    depth_per_disparity_mm : mm of depth per pixel of disparity at the centre of the bounds
    expected_error_mm : standard deviation of depth to expect there
    textured : share of what the bounds (or masks) show that has enough texture to be matched
    mask_coverage : share of foreground pixels, mean over all frames, (left, right), or (left,) of one camera
    depth_coverage : share of what the bounds (or masks) show that has a given depth, None without depth maps
    depth_mm : median of the given depths
    is_checked : whether enough matched points agree to judge the calibration; None where there is no pair to check
    are_lenses_checked : whether a wrong distortion of both lenses would have been noticed; None as before
    are_instants_checked : whether a late camera of the pair would have been noticed; None as before, or with one frame
    is_compared : whether another sensor sees enough of the same points; None as before, or where there are problems
    """

    id: str
    baseline_mm: float | None
    rectified_size: tuple[int, int] | None = None
    n_disparities: int | None = None
    depth_per_disparity_mm: float | None = None
    expected_error_mm: float | None = None
    textured: float | None = None
    rows: Rows | None = None
    mask_coverage: tuple[float, ...] | None = None
    depth_coverage: float | None = None
    depth_mm: float | None = None
    is_checked: bool | None = None
    are_lenses_checked: bool | None = None
    are_instants_checked: bool | None = None
    is_compared: bool | None = None

    @property
    def texture(self) -> str:
        """Texture in one word: good, fair, poor or unknown."""
        return (
            "unknown" if self.textured is None else next(word for word, low in TEXTURES.items() if self.textured >= low)
        )

    def verdict(self) -> str:
        """Say which accuracy to expect, in plain words."""
        unmasked = f"; whether background stands within the bounds {UNCHECKED}, as it has no masks"
        masks = unmasked if self.mask_coverage is None else ""
        if self.baseline_mm is None:
            if self.depth_coverage is None:
                return f"{self.id}: nothing can be expected before the problems are solved"
            return (
                f"{self.id}: {self.depth_coverage:.0%} of what the bounds or masks show has a given depth; whether its "
                f"lens and its place are right {UNCHECKED}, as it has no pair{masks}"
            )
        if self.is_checked is False:
            return f"{self.id}: its calibration {UNCHECKED}, so which accuracy to expect is not known"
        if self.expected_error_mm is None or self.textured is None:
            return f"{self.id}: no accuracy can be expected before the problems are solved"
        lenses = f"; whether the distortion of its lenses is right {UNCHECKED}, as rows hardly tell it"
        scale = (
            f"; whether its focal lengths, principal points and the angle between its cameras are right {UNCHECKED}, "
            "as no other sensor sees enough of the same points"
        )
        instants = f"; whether its two cameras recorded at one time {UNCHECKED}: that takes 13 frames of uneven motion"
        advice = {"good": "", "fair": "; plain areas will be filled in", "poor": "; add texture, light or sharpness"}
        return (
            f"{self.id}: expect depth errors of about {self.expected_error_mm:.1f} mm at the object; texture is "
            f"{self.texture} ({self.textured:.0%} can be matched){advice[self.texture]}"
            f"{lenses if self.are_lenses_checked is False else ''}{scale if self.is_compared is False else ''}"
            f"{instants if self.are_instants_checked is False else ''}{masks}"
        )

    def as_line(self) -> str:
        """Say the figures in one line."""
        parts = [
            f"{self.id}: one camera" if self.baseline_mm is None else f"{self.id}: baseline {self.baseline_mm:.2f} mm"
        ]
        if self.rectified_size is not None:
            width, height = self.rectified_size
            parts.append(f"rectified {width}x{height}, {self.n_disparities} disparities")
            parts.append(f"{self.depth_per_disparity_mm:.2f} mm of depth per pixel of disparity")
        if self.rows is not None and self.rows.vertical_error_px is not None:
            parts.append(
                f"median vertical error {self.rows.vertical_error_px:.3f} px on {self.rows.n_agreeing} of "
                f"{self.rows.n_matches} matched points"
            )
        if self.mask_coverage is not None:
            parts.append("masks cover " + " and ".join(f"{share:.1%}" for share in self.mask_coverage))
        if self.depth_coverage is not None:
            parts.append(f"given depth {self.depth_mm:.0f} mm (median), {self.depth_coverage:.1%} covered")
        return ", ".join(parts)
