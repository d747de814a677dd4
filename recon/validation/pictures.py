"""Pictures of clouds: a ball with its fitted sphere and outliers (the paper's figure 5), and errors as colours."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import error_colours
from recon.validation.sampling import axes_facing, subsample

SIDE_PX = 360  # of each of the four squares
MAP_CELLS, TITLE_PX = 60, 22  # at most, along the longer edge of a face; above its map
POINTS_A_CELL = 4  # of a face, on average, or its map is full of holes
BACKGROUND = 205  # grey, on which white is seen
GAP_PX = 12  # between pictures in a row
SCALE_PX, SCALE_WIDTH_PX = 32, 240  # of the strip of colours under a picture
TILE_PX = 300
AROUND = 0.05  # of a mask's longer side: what is shown around it
AXIS_VIEWS = tuple(
    np.array(axes, dtype=np.float64)
    for axes in (
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    )
)
MOST_DRAWN = 200_000  # inliers, and as many outliers; a ball covers 45 000 pixels
SHOWN = 1.5  # radii from the centre that are shown
GREY, ORANGE, BLUE, CIRCLE = (150, 150, 150), (213, 94, 0), (0, 114, 178), (0, 0, 0)  # Okabe and Ito (2008)


def sphere_picture(
    points: NDArray[np.floating], centre: NDArray[np.float64], radius: float, threshold: float
) -> NDArray[np.uint8]:
    """Draw four squares, uint8 (S, 4 S, 3) RGB: cloud and outliers from the sensor, then both from the side.

    Inliers are grey, outliers beyond the threshold orange outside and blue inside; of many points a sample is drawn.
    The sensor is assumed where most of the surface faces.

    Parameters
    ----------
    points : floating (N, 3), mm
    centre : float64 (3,), mm, of the sphere
    radius, threshold : mm
    """
    offsets = np.asarray(points - centre.astype(np.float32), dtype=np.float32)
    offsets = offsets[_drawn(offsets, radius, threshold)]
    errors = np.linalg.norm(offsets, axis=1) - radius
    towards = offsets[np.abs(errors) < threshold].mean(axis=0)
    front, side = axes_facing(towards), axes_facing(np.cross(axes_facing(towards)[1], towards))
    is_out = np.abs(errors) > threshold
    colours = np.array([GREY, ORANGE, BLUE], np.uint8)[np.where(is_out, np.where(errors > 0, 1, 2), 0)]
    squares = [
        _square(places[chosen], colours[chosen], radius)
        for places in (offsets @ axes.T.astype(np.float32) for axes in (front, side))
        for chosen in (slice(None), is_out)
    ]
    return np.concatenate(squares, axis=1)


def _drawn(offsets: NDArray[np.float32], radius: float, threshold: float) -> NDArray[np.intp]:
    """Choose the offsets that are drawn: near the sphere, at most MOST_DRAWN inliers and as many outliers."""
    distances = np.sqrt(np.einsum("ij,ij->i", offsets, offsets))
    is_inlier = np.abs(distances - radius) <= threshold
    is_outlier = ~is_inlier & (distances < SHOWN * radius)
    return np.concatenate([subsample(np.flatnonzero(chosen), 1, MOST_DRAWN) for chosen in (is_inlier, is_outlier)])


def error_picture(
    points: NDArray[np.floating],
    errors: NDArray[np.floating],
    limit: float,
    views: Sequence[NDArray[np.float64]] = AXIS_VIEWS,
    *,
    unit: str = "mm",
) -> NDArray[np.uint8]:
    """Draw points coloured by signed error from each of the views, side by side, with the scale below.

    Parameters
    ----------
    points : floating (N, 3), mm
    errors : floating (N,), mm
    limit : mm, at which the colours end
    views : float64 (3, 3) each; rows are right, up and towards the viewer
    unit : of the lengths, for the scale
    """
    colours = error_colours(errors, limit).astype(np.int64)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    offsets = np.asarray(points, dtype=np.float64) - middle
    reach = 1.05 * max(float(np.abs(offsets @ axes[:2].T).max()) for axes in views) or 1.0  # of a single point
    squares = [_splats(offsets @ axes.T, colours, reach, BACKGROUND) for axes in views]
    return with_colour_scale(np.concatenate(squares, axis=1), limit, unit)


def face_map(places: NDArray[np.float64], errors: NDArray[np.float64], limit: float, title: str) -> NDArray[np.uint8]:
    """Draw the median error at each place of a face as a colour; grey where there are no points.

    Parameters
    ----------
    places : float64 (N, 2), mm along the face's two edges
    errors : float64 (N,), mm
    limit : mm, at which the colours end
    title : above the map
    """
    low, high = np.percentile(places, (0.5, 99.5), axis=0)
    area = float(np.prod(high - low))
    cell = max(float((high - low).max()) / MAP_CELLS, np.sqrt(POINTS_A_CELL * area / len(places)))
    shape = np.maximum(np.ceil((high - low) / cell).astype(int), 1)
    cells = np.floor((places - low) / cell).astype(int)
    inside = ((cells >= 0) & (cells < shape)).all(axis=1)
    keys = cells[inside, 1] * shape[0] + cells[inside, 0]
    order = np.lexsort((errors[inside], keys))
    occupied, first, count = np.unique(keys[order], return_index=True, return_counts=True)
    medians = np.full(shape[0] * shape[1], np.nan)
    medians[occupied] = errors[inside][order][first + count // 2]
    colours = error_colours(medians, limit).reshape(shape[1], shape[0], 3)[::-1]
    scale = max(1, SIDE_PX // max(colours.shape[:2]))
    large = np.repeat(np.repeat(colours, scale, axis=0), scale, axis=1)
    picture = np.full((SIDE_PX + TITLE_PX, SIDE_PX, 3), 255, np.uint8)
    left = (SIDE_PX - large.shape[1]) // 2
    picture[TITLE_PX : TITLE_PX + large.shape[0], left : left + large.shape[1]] = large[:SIDE_PX]
    text = f"{title}: blue -{limit:.2g} mm, red +{limit:.2g} mm"
    cv2.putText(picture, text, (left, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, CIRCLE, 1, cv2.LINE_AA)
    return picture


def in_a_row(pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Set pictures uint8 (H, W, 3) beside each other, with white between them and below the shorter."""
    height = max(picture.shape[0] for picture in pictures)
    parts = [np.pad(p, ((0, height - p.shape[0]), (0, GAP_PX), (0, 0)), constant_values=255) for p in pictures]
    return np.concatenate(parts, axis=1)[:, :-GAP_PX]


def with_colour_scale(picture: NDArray[np.uint8], limit: float, unit: str = "mm") -> NDArray[np.uint8]:
    """Set the colours of errors below a picture, with the numbers beside them.

    Parameters
    ----------
    picture : uint8 (H, W, 3)
    limit : the colours go from -limit to limit
    unit : of the limit
    """
    width = picture.shape[1]
    strip = np.full((SCALE_PX, width, 3), 255, np.uint8)
    left, right = width // 2 - SCALE_WIDTH_PX // 2, width // 2 + SCALE_WIDTH_PX // 2
    strip[8 : SCALE_PX - 8, left:right] = error_colours(np.linspace(-limit, limit, right - left), limit)
    low, high = f"{-limit:.3g} {unit}", f"{limit:.3g} {unit}"
    offset = cv2.getTextSize(low, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)[0][0]
    for text, column in ((low, left - offset - 8), (high, right + 8)):
        cv2.putText(strip, text, (column, SCALE_PX - 11), cv2.FONT_HERSHEY_SIMPLEX, 0.45, CIRCLE, 1, cv2.LINE_AA)
    return np.concatenate([picture, strip])


def tile(pixels: NDArray[np.uint8], title: str) -> NDArray[np.uint8]:
    """Draw a picture, uint8 (H, W, 3), under its title, its longer side TILE_PX."""
    scale = TILE_PX / max(pixels.shape[:2])
    size = (max(1, round(pixels.shape[1] * scale)), max(1, round(pixels.shape[0] * scale)))
    scaled = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST)
    drawn = np.full((scaled.shape[0] + TITLE_PX + 6, max(scaled.shape[1], TILE_PX // 2) + 8, 3), 255, np.uint8)
    drawn[TITLE_PX : TITLE_PX + scaled.shape[0], : scaled.shape[1]] = scaled
    cv2.putText(drawn, title, (0, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.4, CIRCLE, 1, cv2.LINE_AA)
    return drawn


def window_around(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the rows and columns of a picture around its mask, bool (H, W); all of them if the mask is empty."""
    if not mask.any():
        return slice(None), slice(None)
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    margin = round(AROUND * max(np.ptp(rows), np.ptp(columns))) + 1
    return slice(max(rows[0] - margin, 0), rows[-1] + margin), slice(max(columns[0] - margin, 0), columns[-1] + margin)


def _square(places: NDArray[np.floating], colours: NDArray[np.integer], radius: float) -> NDArray[np.uint8]:
    picture = _splats(places, colours, SHOWN * radius, 255)
    middle = round((SIDE_PX - 1) / 2)
    cv2.circle(picture, (middle, middle), round(SIDE_PX / (2 * SHOWN)), CIRCLE, 1, cv2.LINE_AA)
    return picture


def _splats(
    places: NDArray[np.floating], colours: NDArray[np.integer], reach: float, background: int
) -> NDArray[np.uint8]:
    """Draw a pixel for each place (right, up, towards the viewer), mm, within `reach` of the middle, nearest last."""
    picture = np.full((SIDE_PX, SIDE_PX, 3), background, np.uint8)
    scale, middle = SIDE_PX / (2 * reach), (SIDE_PX - 1) / 2
    nearest_last = np.argsort(places[:, 2], kind="stable")
    columns = np.rint(middle + scale * places[nearest_last, 0]).astype(int)
    rows = np.rint(middle - scale * places[nearest_last, 1]).astype(int)
    inside = (columns >= 0) & (columns < SIDE_PX) & (rows >= 0) & (rows < SIDE_PX)
    picture[rows[inside], columns[inside]] = colours[nearest_last][inside]
    return picture
