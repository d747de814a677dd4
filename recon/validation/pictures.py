"""The paper's figure 5: a reconstructed ball with the fitted sphere, and its outliers, from the sensor and the side."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

SIDE_PX = 360  # of each of the four squares
SHOWN = 1.5  # radii from the centre that are shown
GREY, ORANGE, BLUE, CIRCLE = (150, 150, 150), (213, 94, 0), (0, 114, 178), (0, 0, 0)  # Okabe and Ito (2008)


def sphere_picture(
    points: NDArray[np.floating], centre: NDArray[np.float64], radius: float, threshold: float
) -> NDArray[np.uint8]:
    """Four squares, uint8 (2 S, 2 S, 3) RGB: rows from the sensor and from the side, columns cloud and outliers.

    Inliers are grey, outliers beyond the threshold orange outside and blue inside. The sensor is taken to stand where
    most of the surface faces.
    """
    offsets = np.asarray(points, dtype=np.float64) - centre
    distances = np.linalg.norm(offsets, axis=1)
    near = distances < SHOWN * radius
    offsets, errors = offsets[near], distances[near] - radius
    towards = offsets[np.abs(errors) < threshold].mean(axis=0)
    front, side = _view(towards), _view(np.cross(_view(towards)[1], towards))
    colours = np.where((np.abs(errors) <= threshold)[:, None], GREY, np.where((errors > 0)[:, None], ORANGE, BLUE))
    is_out = np.abs(errors) > threshold
    rows = [
        np.concatenate(
            [_square(offsets @ axes.T, colours, radius), _square(offsets[is_out] @ axes.T, colours[is_out], radius)],
            axis=1,
        )
        for axes in (front, side)
    ]
    return np.concatenate(rows)


def png(picture: NDArray[np.uint8]) -> bytes:
    """An RGB picture as PNG."""
    return bytes(cv2.imencode(".png", picture[..., ::-1])[1].tobytes())


def _view(towards: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows: right, up and towards the viewer."""
    z = towards / np.linalg.norm(towards)
    right = np.cross((0.0, 1.0, 0.0) if abs(z[1]) < 0.95 else (1.0, 0.0, 0.0), z)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(z, right), z])


def _square(places: NDArray[np.float64], colours: NDArray[np.integer], radius: float) -> NDArray[np.uint8]:
    picture = np.full((SIDE_PX, SIDE_PX, 3), 255, np.uint8)
    scale, middle = SIDE_PX / (2 * SHOWN * radius), (SIDE_PX - 1) / 2
    nearest_last = np.argsort(places[:, 2], kind="stable")
    columns = np.rint(middle + scale * places[nearest_last, 0]).astype(int)
    rows = np.rint(middle - scale * places[nearest_last, 1]).astype(int)
    inside = (columns >= 0) & (columns < SIDE_PX) & (rows >= 0) & (rows < SIDE_PX)
    picture[rows[inside], columns[inside]] = colours[nearest_last][inside]
    cv2.circle(picture, (round(middle), round(middle)), round(scale * radius), CIRCLE, 1, cv2.LINE_AA)
    return picture
