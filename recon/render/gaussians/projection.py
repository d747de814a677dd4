"""Where splats fall in a picture: ellipses, their depths and the colours that they have from there.

Source: Zwicker et al., EWA Splatting, 2002; Kerbl et al., 2023, section 4; with the bounds of gsplat 1.5 for splats
beside the picture. The dilation of a third of a pixel stands for the pixel's own size; Mip-Splatting (Yu et al., 2024,
equation 9) takes from the opacity what it adds to the area.
"""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class Ellipses:
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
    depths = np.zeros(n, np.float32)
    places, reaches = np.empty((n, 2), np.float32), np.empty((n, 2), np.float32)
    shapes, colours = np.empty((n, 4), np.float32), np.empty((n, 3), np.float32)
    model_from_world = np.ascontiguousarray(splats.model_from_world)
    K = camera.K
    lens = np.array([K[0, 0], K[0, 1], K[0, 2], K[1, 1], K[1, 2], *size], np.float64)

    def work(part: int) -> None:
        first, end = n * part // threads, n * (part + 1) // threads
        _project(
            splats.centres,
            splats.scales,
            splats.rotations,
            splats.opacities,
            splats.harmonics,
            np.ascontiguousarray(camera.cam_from_world),
            camera.centre,
            model_from_world,
            lens,
            NEAREST * splats.unit,
            splats.antialiased,
            depths,
            places,
            reaches,
            shapes,
            colours,
            first,
            end,
        )

    in_threads(work, threads)
    return Ellipses(depths, places, reaches, shapes, colours)


@njit(cache=True, nogil=True, error_model="numpy")
def _project(  # type: ignore[no-untyped-def]  # numba
    centres,
    scales,
    rotations,
    opacities,
    harmonics,
    pose,
    eye,
    model_from_world,
    lens,
    nearest,
    antialiased,
    depths,
    places,
    reaches,
    shapes,
    colours,
    first,
    end,
):
    """Project the splats from `first` to before `end`."""
    fx, skew, cx, fy, cy, width, height = lens[0], lens[1], lens[2], lens[3], lens[4], lens[5], lens[6]
    side_x, side_y = SIDE_SHARE * 0.5 * width / fx, SIDE_SHARE * 0.5 * height / fy
    left, right = -(cx + 0.5) / fx - side_x, (width - cx - 0.5) / fx + side_x
    top, bottom = -(cy + 0.5) / fy - side_y, (height - cy - 0.5) / fy + side_y
    for i in range(first, end):
        opacity = np.float64(opacities[i])
        if opacity < LEAST_ALPHA:
            continue
        px, py, pz = np.float64(centres[i, 0]), np.float64(centres[i, 1]), np.float64(centres[i, 2])
        z = pose[2, 0] * px + pose[2, 1] * py + pose[2, 2] * pz + pose[2, 3]
        if not z > nearest:
            continue
        x = pose[0, 0] * px + pose[0, 1] * py + pose[0, 2] * pz + pose[0, 3]
        y = pose[1, 0] * px + pose[1, 1] * py + pose[1, 2] * pz + pose[1, 3]
        u, v = x / z, y / z
        column, row = fx * u + skew * v + cx, fy * v + cy
        if not (abs(column) < FARTHEST_PIXEL and abs(row) < FARTHEST_PIXEL):
            continue
        su, sv = min(max(u, left), right), min(max(v, top), bottom)
        j00, j01, j02 = fx / z, skew / z, -(fx * su + skew * sv) / z
        j11, j12 = fy / z, -fy * sv / z
        # Rows of the picture's axes in the world: J times the rotation into the camera.
        ax = j00 * pose[0, 0] + j01 * pose[1, 0] + j02 * pose[2, 0]
        ay = j00 * pose[0, 1] + j01 * pose[1, 1] + j02 * pose[2, 1]
        az = j00 * pose[0, 2] + j01 * pose[1, 2] + j02 * pose[2, 2]
        bx = j11 * pose[1, 0] + j12 * pose[2, 0]
        by = j11 * pose[1, 1] + j12 * pose[2, 1]
        bz = j11 * pose[1, 2] + j12 * pose[2, 2]
        qw, qx = np.float64(rotations[i, 0]), np.float64(rotations[i, 1])
        qy, qz = np.float64(rotations[i, 2]), np.float64(rotations[i, 3])
        s0, s1, s2 = np.float64(scales[i, 0]), np.float64(scales[i, 1]), np.float64(scales[i, 2])
        # The ellipsoid's axes in the world, columns of its rotation, and what they are in the picture.
        r00, r10, r20 = 1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy + qw * qz), 2 * (qx * qz - qw * qy)
        r01, r11, r21 = 2 * (qx * qy - qw * qz), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz + qw * qx)
        r02, r12, r22 = 2 * (qx * qz + qw * qy), 2 * (qy * qz - qw * qx), 1 - 2 * (qx * qx + qy * qy)
        a0 = (ax * r00 + ay * r10 + az * r20) * s0
        a1 = (ax * r01 + ay * r11 + az * r21) * s1
        a2 = (ax * r02 + ay * r12 + az * r22) * s2
        b0 = (bx * r00 + by * r10 + bz * r20) * s0
        b1 = (bx * r01 + by * r11 + bz * r21) * s1
        b2 = (bx * r02 + by * r12 + bz * r22) * s2
        xx, xy, yy = a0 * a0 + a1 * a1 + a2 * a2, a0 * b0 + a1 * b1 + a2 * b2, b0 * b0 + b1 * b1 + b2 * b2
        # A sum of squares, so that a flat splat's area does not vanish in the rounding of xx * yy - xy * xy.
        c01, c02, c12 = a0 * b1 - a1 * b0, a0 * b2 - a2 * b0, a1 * b2 - a2 * b1
        area = c01 * c01 + c02 * c02 + c12 * c12
        dilated = area + DILATION * (xx + yy) + DILATION * DILATION
        if antialiased:
            opacity *= np.sqrt(area / dilated)
            if opacity < LEAST_ALPHA:
                continue
        xx, yy = xx + DILATION, yy + DILATION
        extent = 2 * np.log(opacity / LEAST_ALPHA)  # squared, in standard deviations
        reach_x, reach_y = np.sqrt(extent * xx), np.sqrt(extent * yy)
        if column + reach_x < 0 or column - reach_x > width - 1 or row + reach_y < 0 or row - reach_y > height - 1:
            continue
        depths[i] = z
        places[i, 0], places[i, 1] = column, row
        reaches[i, 0], reaches[i, 1] = reach_x, reach_y
        shapes[i, 0], shapes[i, 1], shapes[i, 2] = yy / dilated, -xy / dilated, xx / dilated
        shapes[i, 3] = opacity
        dx, dy, dz = px - eye[0], py - eye[1], pz - eye[2]
        scale = 1 / np.sqrt(dx * dx + dy * dy + dz * dz)
        dx, dy, dz = dx * scale, dy * scale, dz * scale
        m = model_from_world
        _shade(
            np.float32(m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz),
            np.float32(m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz),
            np.float32(m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz),
            harmonics[i],
            colours[i],
        )


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
