"""Made-up pairs with truth: rooms of slanted walls and a floor, with boxes and bars in front, each with a texture.

Smooth slanted walls of weak texture are what stereo methods mistake for steps. The texture of a surface is noise, or a
part of a given picture, blurred and weakened. Places are pixels of the left picture.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.depth import StereoPair

Floats = NDArray[np.float32]
Image = NDArray[np.uint8]
Paint = tuple[Floats, tuple[float, float]]
"""A texture (h, w, 3), mirrored beyond its ends, and the light gained a column to the right and a row down, a share."""
WIDTH, HEIGHT = 440, 370  # pixels
N_DISPARITIES = 72
SAMPLES = 3  # along a side of a pixel: mixed colours at the outlines of surfaces
MAX_SHADING = 0.35 / 300  # of the light, a pixel
LENS_BLUR = 0.45  # pixels, standard deviation


@dataclass(frozen=True)
class Kind:
    """What the rooms of one kind have in common.

    Parameters
    ----------
    contrast : range of what is left of a texture's contrast; twice as much at most on boxes and bars
    blur : range of the textures' blur, pixels
    slope : the largest slope of a wall or a box, pixels of disparity a column
    noise : of the camera, grey levels
    n_boxes, n_bars : how many stand in the room; bars are 3 to 8 pixels wide
    exposure : of the right picture, as a ratio to the left
    vignette : how much darker the corners are than the centre, as a share
    """

    contrast: tuple[float, float] = (0.1, 0.35)
    blur: tuple[float, float] = (0.5, 2.0)
    slope: float = 0.12
    noise: float = 1.0
    n_boxes: int = 5
    n_bars: int = 0
    exposure: float = 1.0
    vignette: float = 0.0


KINDS = {
    "weak texture": Kind(),
    "very weak, blurred": Kind(contrast=(0.03, 0.15), blur=(0.5, 4.0), noise=0.7),
    "weak, steep walls": Kind(contrast=(0.1, 0.4), slope=0.3),
    "weak, hardly slanted": Kind(contrast=(0.05, 0.2), blur=(0.5, 3.0), slope=0.04, noise=0.7),
    "weak, bars": Kind(n_boxes=3, n_bars=10),
    "weak, vignette, exposure": Kind(contrast=(0.08, 0.3), exposure=0.85, vignette=0.5),
    "weak, noise": Kind(contrast=(0.2, 0.5), noise=3.0),
    "strong texture": Kind(contrast=(0.6, 1.0), n_boxes=7),
}


@dataclass(frozen=True)
class Surface:
    """A plane of disparities.

    Parameters
    ----------
    near : disparity at the centre, as a share of the range
    slope : pixels of disparity a column to the right, and a row down
    centre : column and row
    half : half the width and the height, pixels
    contrast : range of what is left of the texture's contrast
    is_round : whether it is an ellipse
    """

    near: float
    slope: tuple[float, float]
    centre: tuple[float, float]
    half: tuple[float, float]
    contrast: tuple[float, float]
    is_round: bool = False


def room(kind: Kind, seed: int, pictures: Sequence[Image] = ()) -> tuple[StereoPair, Floats, Floats]:
    """Make the room of this number.

    Parameters
    ----------
    kind : of the room
    seed : the same number makes the same room
    pictures : uint8 (h, w, 3); each texture is cut from one of them or is noise, by equal chances

    Returns
    -------
    pair : left and right picture
    truth, right_truth : float32 (H, W), disparities of both views, pixels, NaN where outside the range
    """
    rng = np.random.default_rng(seed)
    surfaces = [*_walls(kind, rng), *_boxes(kind, rng), *_bars(kind, rng)]
    painted = [(surface, _paint(surface, kind, rng, pictures)) for surface in surfaces]
    (left, truth), (right, right_truth) = (_view(painted, is_right=is_right) for is_right in (False, True))
    images = _photograph(left, kind, rng), _photograph(right * np.float32(kind.exposure), kind, rng)
    return StereoPair(*images, N_DISPARITIES), truth, right_truth


def _walls(kind: Kind, rng: np.random.Generator) -> Iterator[Surface]:
    """Two or three walls side by side, and a floor; the nearest is seen, so the corners of the room are hollow."""
    endless = (np.inf, np.inf)
    n_walls = int(rng.integers(2, 4))
    for number in range(n_walls):
        slope = rng.uniform(-kind.slope, kind.slope), rng.uniform(-0.7, 0.7) * kind.slope
        centre = WIDTH * (number + 0.5) / n_walls, HEIGHT * rng.uniform(0.3, 0.7)
        yield Surface(rng.uniform(0.2, 0.4), slope, centre, endless, kind.contrast)
    yield Surface(0.35, (0, rng.uniform(0.5, 1.3) * kind.slope), (WIDTH / 2, HEIGHT * 0.75), endless, kind.contrast)


def _boxes(kind: Kind, rng: np.random.Generator) -> Iterator[Surface]:
    contrast = kind.contrast[0], 2 * kind.contrast[1]
    for _ in range(kind.n_boxes):
        slope = rng.uniform(-kind.slope, kind.slope), rng.uniform(-kind.slope, kind.slope)
        half = rng.uniform(0.04, 0.16) * WIDTH, rng.uniform(0.05, 0.25) * HEIGHT
        yield Surface(rng.uniform(0.4, 0.85), slope, _place(rng), half, contrast, rng.random() < 0.4)


def _bars(kind: Kind, rng: np.random.Generator) -> Iterator[Surface]:
    """Upright and lying bars, slanted along their length."""
    contrast = 2 * kind.contrast[0], 2 * kind.contrast[1]
    for _ in range(kind.n_bars):
        near, slope, thin = rng.uniform(0.5, 0.9), rng.uniform(-0.1, 0.1), rng.uniform(1.5, 4)
        if rng.random() < 0.7:
            yield Surface(near, (0, slope), _place(rng), (thin, rng.uniform(0.2, 0.4) * HEIGHT), contrast)
        else:
            yield Surface(near, (slope, 0), _place(rng), (rng.uniform(0.1, 0.3) * WIDTH, thin), contrast)


def _place(rng: np.random.Generator) -> tuple[float, float]:
    return rng.uniform(0.1, 0.95) * WIDTH, rng.uniform(0.1, 0.9) * HEIGHT


def _paint(surface: Surface, kind: Kind, rng: np.random.Generator, pictures: Sequence[Image]) -> Paint:
    source = int(rng.integers(len(pictures) + 1))
    texture = noise_texture(rng, HEIGHT, WIDTH) if source == len(pictures) else _cut(rng, pictures[source])
    texture = cv2.GaussianBlur(texture, (0, 0), rng.uniform(*kind.blur)).astype(np.float32)
    mean = texture.mean((0, 1))
    weak = (mean + (texture - mean) * rng.uniform(*surface.contrast)) * rng.uniform(0.5, 1.2)
    angle, gain = rng.uniform(0, 2 * np.pi), rng.uniform(0, MAX_SHADING)
    return weak.astype(np.float32), (gain * np.cos(angle), gain * np.sin(angle))


def _cut(rng: np.random.Generator, picture: Image) -> Floats:
    """A part half as wide and high, mirrored at random."""
    height, width = picture.shape[0] // 2, picture.shape[1] // 2
    top, left = rng.integers(height), rng.integers(width)
    turn_y, turn_x = rng.choice((-1, 1), 2)
    return np.ascontiguousarray(picture[top : top + height, left : left + width][::turn_y, ::turn_x], np.float32)


def noise_texture(rng: np.random.Generator, height: int, width: int) -> Floats:
    """Noise of several scales in one hue, float32 (height, width, 3), grey levels."""
    total = np.zeros((height, width), np.float32)
    for scale in (1, 3, 9, 27):
        values = rng.normal(size=(height // scale + 2, width // scale + 2)).astype(np.float32)
        total += cv2.resize(values, (width, height), interpolation=cv2.INTER_CUBIC) * scale**0.5
    grey = 128 + total * rng.uniform(4, 14)
    return np.asarray(grey[..., None] * rng.uniform(0.5, 1.2, 3), np.float32)


def _view(painted: list[tuple[Surface, Paint]], *, is_right: bool) -> tuple[Floats, Floats]:
    """Draw what a camera sees: grey levels, float32 (H, W, 3), and the disparities of pixel centres, float32 (H, W)."""
    shape = (HEIGHT * SAMPLES, WIDTH * SAMPLES)
    y, column = ((grid.astype(np.float32) + 0.5) / SAMPLES - 0.5 for grid in np.indices(shape))
    image, nearest = np.zeros((*shape, 3), np.float32), np.full(shape, -np.inf, np.float32)
    for surface, (texture, shading) in painted:
        (slope_x, slope_y), (centre_x, centre_y) = surface.slope, surface.centre
        level = surface.near * N_DISPARITIES + slope_y * (y - centre_y)
        x = (column + level - slope_x * centre_x) / (1 - slope_x) if is_right else column  # of the left picture
        disparity = level + slope_x * (x - centre_x)
        across, down = np.abs(x - centre_x) / surface.half[0], np.abs(y - centre_y) / surface.half[1]
        inside = across**2 + down**2 < 1 if surface.is_round else np.maximum(across, down) < 1
        seen = inside & (disparity > nearest)
        places = x.astype(np.float32), y.astype(np.float32)
        colours = cv2.remap(texture, *places, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
        light = 1 + shading[0] * (x - WIDTH / 2) + shading[1] * (y - HEIGHT / 2)
        image[seen], nearest[seen] = (colours * light[..., None])[seen], disparity[seen]
    centres = nearest[SAMPLES // 2 :: SAMPLES, SAMPLES // 2 :: SAMPLES]
    known = (centres >= 0) & (centres <= N_DISPARITIES - 1)
    pixels = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float32)
    return pixels, np.where(known, centres, np.float32(np.nan))


def _photograph(image: Floats, kind: Kind, rng: np.random.Generator) -> Image:
    """Add what a camera does: darker corners, blur, noise and rounding."""
    y, x = np.indices((HEIGHT, WIDTH))
    radius = np.hypot(x / WIDTH - 0.5, y / HEIGHT - 0.5) / np.hypot(0.5, 0.5)
    seen = cv2.GaussianBlur(image * (1 - kind.vignette * radius**2)[..., None], (0, 0), LENS_BLUR)
    noisy = np.rint(seen + rng.normal(0, kind.noise, image.shape))
    return np.asarray(np.clip(noisy, 0, 255), np.uint8)
