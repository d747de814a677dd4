"""Where splats fall in a picture: ellipses, their depths and the colours that they have from there.

Source: Zwicker et al., EWA Splatting, 2002; Kerbl et al., 2023, section 4; with the bounds of gsplat 1.5 for splats
beside the picture. The dilation of a third of a pixel stands for the pixel's own size; Mip-Splatting (Yu et al., 2024,
equation 9) takes from the opacity what it adds to the area.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.rig import Camera
from recon.geometry.splats import Splats
from recon.render.rasterise import in_threads

DILATION = 0.3  # squared pixels
NEAREST = 0.01  # of the file's unit, as gsplat
LEAST_ALPHA = 1 / 255  # what covers less is left out
SIDE_SHARE = 0.3  # of the half picture, beyond which an ellipse keeps the shape that it has there
FARTHEST_PIXEL = 1e6

# Real spherical harmonics (Sloan, Efficient Spherical Harmonic Evaluation, 2013), in the order of the original trainer.
C0 = np.float32(0.28209479177387814)
C1 = np.float32(0.4886025119029199)
C2 = np.array([1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396])
C3 = np.array(
    [
        -0.5900435899266435,
        2.890611442640554,
        -0.4570457994644658,
        0.3731763325901154,
        -0.4570457994644658,
        1.445305721320277,
        -0.5900435899266435,
    ]
)


class Ellipses(NamedTuple):
    """Splats in a picture.

    Parameters
    ----------
    depths : float32 (N,), along the optical axis; 0 for what is not drawn
    places : float32 (N, 2), column and row of the middles
    reaches : float32 (N, 2), half the width and height of what is covered, pixels
    shapes : float32 (N, 4): the inverse covariance as its numbers xx, xy and yy, and the opacity
    colours : float32 (N, 3), at least 0
    """

    depths: NDArray[np.float32]
    places: NDArray[np.float32]
    reaches: NDArray[np.float32]
    shapes: NDArray[np.float32]
    colours: NDArray[np.float32]


def project(splats: Splats, camera: Camera, size: tuple[int, int], *, threads: int = 1) -> Ellipses:
    """Project splats into a picture.

    Parameters
    ----------
    splats, camera : what is seen, and from where; the camera's distortion is not applied
    size : (width, height) of the picture, pixels
    threads : how many threads share the splats
    """
    n = len(splats)
    ellipses = Ellipses(np.zeros(n, np.float32), *(np.empty((n, columns), np.float32) for columns in (2, 2, 4, 3)))
    ellipsoids = _Ellipsoids(splats.centres, splats.scales, splats.rotations, splats.opacities, splats.harmonics)
    (fx, skew, cx), (_, fy, cy), _ = camera.K.tolist()
    width, height = size
    side_x, side_y = SIDE_SHARE * 0.5 * width / fx, SIDE_SHARE * 0.5 * height / fy
    sides = (-(cx + 0.5) / fx - side_x, (width - cx - 0.5) / fx + side_x)
    ends = (-(cy + 0.5) / fy - side_y, (height - cy - 0.5) / fy + side_y)
    rows, turn = (tuple(map(tuple, matrix.tolist())) for matrix in (camera.cam_from_world[:3], splats.model_from_world))
    pose = rows, tuple(zip(*rows, strict=True)), tuple(camera.centre.tolist()), turn
    view = _View(*pose, fx, skew, cx, fy, cy, width, height, NEAREST * splats.unit, sides, ends)

    def work(part: int) -> None:
        first, end = n * part // threads, n * (part + 1) // threads
        _project(ellipsoids, view, splats.antialiased, ellipses, first, end)

    in_threads(work, threads)
    return ellipses


class _Ellipsoids(NamedTuple):
    """The arrays of `Splats`."""

    centres: NDArray[np.float32]
    scales: NDArray[np.float32]
    rotations: NDArray[np.float32]
    opacities: NDArray[np.float32]
    harmonics: NDArray[np.float32]


class _View(NamedTuple):
    """From where splats are seen, in tuples, whose numbers numba keeps in registers.

    `cam_from_world` in rows and in columns, the centre, the rotation of `Splats.model_from_world`, the camera's matrix
    and the size of its picture, pixels, the least depth, and between which normalised coordinates shapes still change.
    """

    rows: tuple[tuple[float, ...], ...]
    columns: tuple[tuple[float, ...], ...]
    eye: tuple[float, ...]
    model_from_world: tuple[tuple[float, ...], ...]
    fx: float
    skew: float
    cx: float
    fy: float
    cy: float
    width: int
    height: int
    nearest: float
    sides: tuple[float, float]
    ends: tuple[float, float]


@njit(cache=True, nogil=True, error_model="numpy")
def _project(ellipsoids, view, antialiased, ellipses, first, end):  # type: ignore[no-untyped-def]  # numba
    """Project the splats from `first` to before `end`."""
    centres, scales, rotations, opacities, harmonics = ellipsoids
    depths, places, reaches, shapes, colours = ellipses
    for i in range(first, end):
        opacity = np.float64(opacities[i])
        if opacity < LEAST_ALPHA:
            continue
        centre = _floats(centres[i])
        z = _dot(view.rows[2], centre) + view.rows[2][3]
        if not z > view.nearest:
            continue
        u = (_dot(view.rows[0], centre) + view.rows[0][3]) / z
        v = (_dot(view.rows[1], centre) + view.rows[1][3]) / z
        column, row = view.fx * u + view.skew * v + view.cx, view.fy * v + view.cy
        if not (abs(column) < FARTHEST_PIXEL and abs(row) < FARTHEST_PIXEL):
            continue
        a, b = _half_axes(rotations[i], _floats(scales[i]), view, u, v, z)
        xx, xy, yy = _dot(a, a), _dot(a, b), _dot(b, b)
        # A sum of squares, so that a flat splat's area does not vanish in the rounding of xx * yy - xy * xy.
        c = a[0] * b[1] - a[1] * b[0], a[0] * b[2] - a[2] * b[0], a[1] * b[2] - a[2] * b[1]
        area = _dot(c, c)
        dilated = area + DILATION * (xx + yy) + DILATION * DILATION
        if antialiased:
            opacity *= np.sqrt(area / dilated)
            if opacity < LEAST_ALPHA:
                continue
        xx, yy = xx + DILATION, yy + DILATION
        extent = 2 * np.log(opacity / LEAST_ALPHA)  # squared, in standard deviations
        reach_x, reach_y = np.sqrt(extent * xx), np.sqrt(extent * yy)
        is_beside = column + reach_x < 0 or column - reach_x > view.width - 1
        if is_beside or row + reach_y < 0 or row - reach_y > view.height - 1:
            continue
        depths[i] = z
        places[i, 0], places[i, 1] = column, row
        reaches[i, 0], reaches[i, 1] = reach_x, reach_y
        shape = shapes[i]
        shape[0], shape[1], shape[2], shape[3] = yy / dilated, -xy / dilated, xx / dilated, opacity
        seen = centre[0] - view.eye[0], centre[1] - view.eye[1], centre[2] - view.eye[2]
        scale = 1 / np.sqrt(_dot(seen, seen))
        seen = seen[0] * scale, seen[1] * scale, seen[2] * scale
        _shade(
            np.float32(_dot(view.model_from_world[0], seen)),
            np.float32(_dot(view.model_from_world[1], seen)),
            np.float32(_dot(view.model_from_world[2], seen)),
            harmonics[i],
            colours[i],
        )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _half_axes(rotation, scale, view, u, v, z):  # type: ignore[no-untyped-def]  # numba
    """Return what an ellipsoid's three half axes are along the columns and along the rows of the picture, pixels."""
    u, v = min(max(u, view.sides[0]), view.sides[1]), min(max(v, view.ends[0]), view.ends[1])
    to_column = view.fx / z, view.skew / z, -(view.fx * u + view.skew * v) / z
    to_row = 0.0, view.fy / z, -view.fy * v / z
    # The picture's axes in the world: the projection's derivative times the rotation into the camera.
    x_axis, y_axis, z_axis = view.columns[0], view.columns[1], view.columns[2]
    a = _dot(to_column, x_axis), _dot(to_column, y_axis), _dot(to_column, z_axis)
    b = _dot(to_row, x_axis), _dot(to_row, y_axis), _dot(to_row, z_axis)
    w, (x, y, z) = np.float64(rotation[0]), _floats(rotation[1:])
    # The ellipsoid's axes in the world, columns of its rotation.
    first = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
    second = 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
    third = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    return (
        (_dot(a, first) * scale[0], _dot(a, second) * scale[1], _dot(a, third) * scale[2]),
        (_dot(b, first) * scale[0], _dot(b, second) * scale[1], _dot(b, third) * scale[2]),
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _floats(numbers):  # type: ignore[no-untyped-def]  # numba
    """Return three numbers in double precision."""
    return np.float64(numbers[0]), np.float64(numbers[1]), np.float64(numbers[2])


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _dot(a, b):  # type: ignore[no-untyped-def]  # numba
    """Return the product of two vectors of three numbers."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True, error_model="numpy")
def _shade(x, y, z, coefficients, colour):  # type: ignore[no-untyped-def]  # numba
    """Write the colour that harmonics (K, 3) have in a direction of unit length."""
    n = coefficients.shape[0]
    xx, yy, zz = x * x, y * y, z * z
    for channel in range(3):
        value = np.float32(0.5) + C0 * coefficients[0, channel]
        if n > 1:
            value += C1 * (z * coefficients[2, channel] - y * coefficients[1, channel] - x * coefficients[3, channel])
        if n > 4:
            value += np.float32(
                C2[0] * x * y * coefficients[4, channel]
                + C2[1] * y * z * coefficients[5, channel]
                + C2[2] * (2 * zz - xx - yy) * coefficients[6, channel]
                + C2[3] * x * z * coefficients[7, channel]
                + C2[4] * (xx - yy) * coefficients[8, channel]
            )
        if n > 9:
            value += np.float32(
                C3[0] * y * (3 * xx - yy) * coefficients[9, channel]
                + C3[1] * x * y * z * coefficients[10, channel]
                + C3[2] * y * (4 * zz - xx - yy) * coefficients[11, channel]
                + C3[3] * z * (2 * zz - 3 * xx - 3 * yy) * coefficients[12, channel]
                + C3[4] * x * (4 * zz - xx - yy) * coefficients[13, channel]
                + C3[5] * z * (xx - yy) * coefficients[14, channel]
                + C3[6] * x * (xx - 3 * yy) * coefficients[15, channel]
            )
        colour[channel] = max(value, np.float32(0))
