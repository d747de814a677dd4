"""How cameras take pictures over time and through a lens: imperfections that the studio adds on request."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import Camera
from recon.studio.light.exposure import GAMMA
from recon.studio.stage import Staged

READOUT_MS = 20.0  # from the first to the last row of a rolling shutter; cameras' sensors take 10 to 30
FLICKER_HZ = 117.0  # of the light: no multiple of usual frame rates, with which it would stand still
BLUR_STEP_PX = 1.5  # of motion between two instants of an open shutter
MOST_INSTANTS = 15  # of an open shutter
LEAST_GAIN = 0.1
SHARES = ("colour_cast", "vignetting", "flicker")

Window = tuple[NDArray[np.float32], int, int]
"""Linear colour and coverage, float32 (h, w, 4), with its first column and row in the picture."""


@dataclass(frozen=True, kw_only=True)
class Imaging:
    """What is imperfect in the cameras' pictures; all of it is off by default.

    Parameters
    ----------
    shutter_ms : how long the shutter is open: what moves is blurred
    rolling_shutter : rows are taken one after the other, within READOUT_MS
    colour_cast : standard deviation of each camera's gains of red, green and blue, share
    vignetting : share of the light that a picture's corners lack
    flicker : of the light, share of its mean
    compression : quality of JPEG, 1 to 100, in which pictures are stored; None for PNG, which loses nothing
    defocus : sensors out of focus, and the standard deviation of a point's image, pixels
    gloss : times as much shine on all surfaces
    """

    shutter_ms: float = 0.0
    rolling_shutter: bool = False
    colour_cast: float = 0.0
    vignetting: float = 0.0
    flicker: float = 0.0
    compression: int | None = None
    defocus: tuple[tuple[str, float], ...] = ()
    gloss: float = 1.0

    def check(self, fps: float, sensors: Sequence[str]) -> None:
        """Raise a ValueError that names the first value that cannot be.

        Parameters
        ----------
        fps : frames per second
        sensors : ids of all
        """
        if not 0 <= self.shutter_ms <= 1000.0 / fps:
            raise ValueError(f"shutter_ms is {self.shutter_ms}, expected 0 to {1000.0 / fps:g}, as long as a frame")
        for name in SHARES:
            if not 0 <= getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, expected a share, zero or more and below 1")
        if self.compression is not None and not 1 <= self.compression <= 100:
            raise ValueError(f"compression is {self.compression}, expected a quality of JPEG, 1 to 100")
        if not (np.isfinite(self.gloss) and self.gloss >= 0):
            raise ValueError(f"gloss is {self.gloss}, expected zero or more")
        for name, pixels in self.defocus:
            if name not in sensors or not (np.isfinite(pixels) and pixels >= 0):
                raise ValueError(
                    f"defocus is {name}={pixels:g}, expected one of {', '.join(sensors)} and zero pixels or more"
                )

    @property
    def suffix(self) -> str:
        """The ending of the pictures' names."""
        return ".png" if self.compression is None else ".jpg"

    def offsets(self, fps: float, speed_px: float) -> list[float]:
        """Return when light is gathered for one picture, frames from its instant, evenly and symmetric about it.

        Parameters
        ----------
        fps : frames per second
        speed_px : largest motion within a frame
        """
        share = self.shutter_ms * fps / 1000.0
        half = min(int(np.ceil(share * speed_px / BLUR_STEP_PX / 2)), MOST_INSTANTS // 2) if share else 0
        n = 2 * half + 1
        return [share * ((k + 0.5) / n - 0.5) for k in range(n)]

    def readout(self, fps: float) -> float:
        """Return how long the rows of a picture take, frames; 0 with a global shutter."""
        return min(READOUT_MS * fps / 1000.0, 1.0) if self.rolling_shutter else 0.0

    def dimming(self, size: tuple[int, int], seconds: float, fps: float) -> NDArray[np.float32] | None:
        """Return the share of the light that reaches each pixel, float32 (H, W); None for all of it.

        Parameters
        ----------
        size : (width, height), pixels
        seconds : when the picture is taken
        fps : frames per second
        """
        if not (self.vignetting or self.flicker):
            return None
        width, height = size
        across, down = (np.linspace(-1.0, 1.0, n) for n in (width, height))
        radius2 = ((across[None] * width) ** 2 + (down[:, None] * height) ** 2) / (width**2 + height**2)
        when = seconds + self.readout(fps) / fps * down / 2
        open_for = np.sinc(FLICKER_HZ * self.shutter_ms / 1000.0)  # a longer exposure averages the flicker
        light = 1.0 + self.flicker * open_for * np.sin(2 * np.pi * FLICKER_HZ * when)
        return np.asarray(light[:, None] * (1.0 - self.vignetting * radius2), dtype=np.float32)

    def cast(self, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw the gains of a camera's channels, float64 (3,)."""
        return np.maximum(1.0 + self.colour_cast * rng.normal(size=3), LEAST_GAIN)

    def encoded(self, picture: NDArray[np.uint8], png: Sequence[int]) -> bytes:
        """Encode a picture, uint8 (H, W, 3) in the order blue, green, red.

        Parameters
        ----------
        png : OpenCV's settings, if it becomes one
        """
        settings = png if self.compression is None else (cv2.IMWRITE_JPEG_QUALITY, self.compression)
        return cv2.imencode(self.suffix, picture, settings)[1].tobytes()


def rolled(camera: Camera, moments: Sequence[Staged]) -> Staged:
    """Return the bodies with every vertex where it was when its row was taken.

    Parameters
    ----------
    camera : whose rows are taken one after the other
    moments : when the first row is taken, the middle one and the last one
    """
    _, middle, _ = moments
    middle_row = (camera.size[1] - 1) / 2
    vertices: NDArray[np.float64] = middle.vertices
    for _ in range(2):  # what moves up or down is taken at another row
        time = np.clip(camera.project(vertices)[:, 1] / middle_row - 1.0, -1.5, 1.5)[:, None]
        weights = time * (time - 1) / 2, 1 - time**2, time * (time + 1) / 2  # Lagrange's
        vertices = np.sum([weight * each.vertices for weight, each in zip(weights, moments, strict=True)], axis=0)
    surface = np.sum([weight * each.surface for weight, each in zip(weights, moments, strict=True)], axis=0)
    return Staged(np.asarray(surface, np.float32), vertices, middle.looks)


def averaged(windows: Sequence[Window]) -> Window:
    """Average what a camera sees at several instants, with the windows' places."""
    if len(windows) == 1:
        return windows[0]
    low = np.min([(column, row) for _, column, row in windows], axis=0)
    high = np.max([(c + pixels.shape[1], r + pixels.shape[0]) for pixels, c, r in windows], axis=0)
    total = np.zeros((high[1] - low[1], high[0] - low[0], 4), np.float32)
    for pixels, column, row in windows:
        part = total[row - low[1] :, column - low[0] :][: pixels.shape[0], : pixels.shape[1]]
        part += _weighed(pixels)
    return _unweighed(np.asarray(total / len(windows), np.float32)), int(low[0]), int(low[1])


def defocused(window: Window, sigma: float, size: tuple[int, int]) -> Window:
    """Blur what a camera sees of the actors.

    Parameters
    ----------
    sigma : standard deviation of a point's image, pixels
    size : (width, height) of the picture, beyond which nothing is kept
    """
    pixels, column, row = window
    edge = int(np.ceil(4 * sigma))  # as far as OpenCV blurs
    padded = np.pad(_weighed(pixels), ((edge, edge), (edge, edge), (0, 0)))
    blurred = _unweighed(np.asarray(cv2.GaussianBlur(padded, (0, 0), sigma)))
    left, top = max(0, edge - column), max(0, edge - row)
    right, bottom = size[0] - column + edge, size[1] - row + edge
    return np.ascontiguousarray(blurred[top:bottom, left:right]), column - edge + left, row - edge + top


def defocused_plate(plate: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """Blur display values, float32 (H, W, 3), 0 to 255, as light."""
    light = cv2.GaussianBlur((plate / np.float32(255.0)) ** np.float32(GAMMA), (0, 0), sigma)
    return np.asarray(255.0 * light ** np.float32(1 / GAMMA), np.float32)


def _weighed(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.concatenate([pixels[..., :3] * pixels[..., 3:], pixels[..., 3:]], axis=2)


def _unweighed(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    colour = pixels[..., :3] / np.maximum(pixels[..., 3:], np.float32(1e-6))
    return np.concatenate([colour, pixels[..., 3:]], axis=2)
