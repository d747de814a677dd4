"""Triangles to pixels without any graphics library: the software renderer's kernels, compiled by numba.

Convention: pixel centres at integers. Corners are snapped to 1/256 pixel and covered by exact integer edge functions
with the top-left rule, so neighbouring triangles neither overlap nor leave cracks. Each tile of the picture is drawn by
one thread in the order of the faces: the picture is the same, bit by bit, for any number of threads.

A texture is sampled as OpenGL does: at the size with one texel a pixel in the direction that needs more of them,
between the two nearest sizes and the four nearest texels of each.

pyrender needs OpenGL, takes 3 to 4 times as long without a GPU (docs/surface.md), and its pixels depend on the driver;
the fly-throughs are drawn by it where there is a GPU (`offscreen`).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.render.texture import NO_MIPMAPS, Mipmaps

SUBPIXELS = 256  # snapping grid of corners
TILE = 64  # pixels; four samples of inverse depth and face of a tile are 128 KiB and stay in the second-level cache
N_SAMPLES = 4
# Rotated grid, in 1/256 pixel: over the whole picture the samples' columns are evenly spaced, one sample each a pixel.
SAMPLE_STEP, SAMPLE_REACH = 64, 96  # from one column to the next; of a pixel's outermost sample from its centre
SAMPLE_X = np.array([-96, -32, 32, 96], dtype=np.int64)
SAMPLE_Y = np.array([32, -96, 96, -32], dtype=np.int64)
NEAREST = 1e-3  # mm; a face that reaches behind the camera is not drawn, so `cut` cuts it before
FARTHEST_PIXEL = 2.0**21  # a face with a corner beyond is not drawn: edge functions would not be exact in 64 bits


def draw_model(
    picture: NDArray[np.uint8],
    projected: NDArray[np.float32],
    faces: NDArray[np.int32],
    front: NDArray[np.uint8],
    back: NDArray[np.uint8],
    *,
    texture: Mipmaps = NO_MIPMAPS,
    threads: int = 1,
) -> None:
    """Draw triangles over a picture, four samples a pixel, each face from whichever side it is seen.

    Parameters
    ----------
    picture : uint8 (H, W, 3), drawn over in place
    projected : float32 (N, 3): column, row (pixels) and depth (mm) of each vertex
    faces : int32 (M, 3), counter-clockwise seen from the front
    front, back : uint8 (N, 3), colours of the vertices on either side
    texture : multiplied by those colours, 255 leaving it as it is; by default there is none
    threads : how many threads share the tiles; the picture does not depend on it
    """
    corners, inverse_depth = _snapped(projected)
    triangles = _Triangles(corners, inverse_depth, faces, front, back, texture)
    rows, columns = (picture.shape[0] + TILE - 1) // TILE, (picture.shape[1] + TILE - 1) // TILE
    starts, members = _binned(corners, inverse_depth, faces, picture.shape[0], picture.shape[1], rows, columns)

    def draw(first: int) -> None:
        _draw_tiles(picture, triangles, starts, members, columns, first, threads)

    in_threads(draw, threads)


class _Triangles(NamedTuple):
    """What `draw_model` is given, with corners and inverse depths as of `_snapped`."""

    corners: NDArray[np.int64]
    inverse_depth: NDArray[np.float32]
    faces: NDArray[np.int32]
    front: NDArray[np.uint8]
    back: NDArray[np.uint8]
    texture: Mipmaps


def in_threads(work: Callable[[int], None], threads: int) -> None:
    """Call `work` with 0, 1, … threads - 1, each in a thread of its own; the kernels release the interpreter lock."""
    if threads == 1:
        work(0)
        return
    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(work, range(threads)):
            pass


@njit(cache=True, nogil=True, error_model="numpy")
def _snapped(projected):  # type: ignore[no-untyped-def]  # numba
    """Snap corners, int64 (N, 2) in 1/256 pixel; return inverse depths too, float32 (N,), 0 where none can be drawn."""
    n = projected.shape[0]
    corners = np.zeros((n, 2), dtype=np.int64)
    inverse_depth = np.zeros(n, dtype=np.float32)
    for i in range(n):
        x, y, z = projected[i, 0], projected[i, 1], projected[i, 2]
        if z >= NEAREST and abs(x) < FARTHEST_PIXEL and abs(y) < FARTHEST_PIXEL:
            corners[i, 0] = np.int64(np.floor(np.float64(x) * SUBPIXELS + 0.5))
            corners[i, 1] = np.int64(np.floor(np.float64(y) * SUBPIXELS + 0.5))
            inverse_depth[i] = np.float32(1.0) / z
    return corners, inverse_depth


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _sample_columns(low, high):  # type: ignore[no-untyped-def]  # numba
    """Find the first and last column of samples (four a pixel, from pixel 0's left) in low … high (1/256 pixel)."""
    return (low + SAMPLE_REACH + SAMPLE_STEP - 1) // SAMPLE_STEP, (high + SAMPLE_REACH) // SAMPLE_STEP


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _pixel_rows(low, high):  # type: ignore[no-untyped-def]  # numba
    """Find the first and last row of pixels with samples in low … high (1/256 pixel)."""
    return (low - SAMPLE_REACH + SUBPIXELS - 1) // SUBPIXELS, (high + SAMPLE_REACH) // SUBPIXELS


@njit(cache=True, nogil=True, error_model="numpy")
def _binned(corners, inverse_depth, faces, height, width, tile_rows, tile_columns):  # type: ignore[no-untyped-def]  # numba
    """List the faces that touch each tile t, ascending: `members[starts[t] : starts[t + 1]]`."""
    counts = np.zeros(tile_rows * tile_columns + 1, dtype=np.int64)
    ranges = np.empty((faces.shape[0], 4), dtype=np.int16)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ranges[f, 0], ranges[f, 1] = 0, -1
        if inverse_depth[a] == 0 or inverse_depth[b] == 0 or inverse_depth[c] == 0:
            continue
        ax, ay, bx, by = corners[a, 0], corners[a, 1], corners[b, 0], corners[b, 1]
        cx, cy = corners[c, 0], corners[c, 1]
        first, last = _sample_columns(min(ax, bx, cx), max(ax, bx, cx))
        top, bottom = _pixel_rows(min(ay, by, cy), max(ay, by, cy))
        left, right = max(first // N_SAMPLES, 0), min(last // N_SAMPLES, width - 1)
        top, bottom = max(top, 0), min(bottom, height - 1)
        if first > last or left > right or top > bottom:
            continue
        ranges[f, 0], ranges[f, 1] = top // TILE, bottom // TILE
        ranges[f, 2], ranges[f, 3] = left // TILE, right // TILE
        for row in range(ranges[f, 0], ranges[f, 1] + 1):
            for column in range(ranges[f, 2], ranges[f, 3] + 1):
                counts[row * tile_columns + column + 1] += 1
    starts = np.cumsum(counts)
    members = np.empty(starts[-1], dtype=np.int32)
    filled = starts[:-1].copy()
    for f in range(faces.shape[0]):
        for row in range(ranges[f, 0], ranges[f, 1] + 1):
            for column in range(ranges[f, 2], ranges[f, 3] + 1):
                tile = row * tile_columns + column
                members[filled[tile]] = f
                filled[tile] += 1
    return starts, members


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_tiles(picture, triangles, starts, members, tile_columns, first, step):  # type: ignore[no-untyped-def]  # numba
    """Draw every `step`-th tile from `first` on."""
    corners, inverse_depth, faces = triangles.corners, triangles.inverse_depth, triangles.faces
    nearest = np.empty((TILE, TILE, N_SAMPLES), dtype=np.float32)  # inverse depth of what each sample sees
    seen = np.empty((TILE, TILE, N_SAMPLES), dtype=np.int32)  # its face
    for tile in range(first, starts.shape[0] - 1, step):
        if starts[tile] == starts[tile + 1]:
            continue
        y0, x0 = tile // tile_columns * TILE, tile % tile_columns * TILE
        box = y0, x0, min(y0 + TILE, picture.shape[0]), min(x0 + TILE, picture.shape[1])
        nearest[:] = 0.0
        seen[:] = -1
        for m in range(starts[tile], starts[tile + 1]):
            _see_face(_corners_of(corners, inverse_depth, faces, members[m]), members[m], nearest, seen, box)
        _shade(picture, triangles, seen, box)


@njit(cache=True, nogil=True, error_model="numpy")
def _see_face(corners, face, nearest, seen, box):  # type: ignore[no-untyped-def]  # numba
    """Enter one face into the samples of a tile, its top, left, bottom and right, where it is the nearest so far."""
    y0, x0, y1, x1 = box
    (_, ax, ay, za), (_, bx, by, zb), (_, cx, cy, zc) = corners
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0:
        return
    if area < 0:
        bx, by, zb, cx, cy, zc = cx, cy, zc, bx, by, zb
        area = -area
    first, last = _sample_columns(min(ax, bx, cx), max(ax, bx, cx))
    top, bottom = _pixel_rows(min(ay, by, cy), max(ay, by, cy))
    first, last = max(first, x0 * N_SAMPLES), min(last, x1 * N_SAMPLES - 1)
    top, bottom = max(top, y0), min(bottom, y1 - 1)

    # Edge opposite a, b, c: value at a point is the doubled area of the triangle that it makes with the edge.
    a_dx, a_dy, b_dx, b_dy, c_dx, c_dy = by - cy, cx - bx, cy - ay, ax - cx, ay - by, bx - ax
    px, py = first * SAMPLE_STEP - SAMPLE_REACH, top * SUBPIXELS
    a_row = (px - bx) * a_dx + (py - by) * a_dy - _kept_out(a_dx, a_dy)
    b_row = (px - cx) * b_dx + (py - cy) * b_dy - _kept_out(b_dx, b_dy)
    c_row = (px - ax) * c_dx + (py - ay) * c_dy - _kept_out(c_dx, c_dy)
    za, zb, zc = np.float64(za), np.float64(zb), np.float64(zc)
    scale = 1.0 / area
    z_dx = (a_dx * za + b_dx * zb + c_dx * zc) * scale  # per 1/256 pixel
    z_dy = (a_dy * za + b_dy * zb + c_dy * zc) * scale
    z_row = za + (px - ax) * z_dx + (py - ay) * z_dy
    for y in range(top, bottom + 1):
        for column in range(first, last + 1):
            s = column % N_SAMPLES
            dx, dy = (column - first) * SAMPLE_STEP, SAMPLE_Y[s]
            inside = (a_row + dx * a_dx + dy * a_dy) | (b_row + dx * b_dx + dy * b_dy)
            if (inside | (c_row + dx * c_dx + dy * c_dy)) >= 0:
                depth = np.float32(z_row + dx * z_dx + dy * z_dy)
                x = column // N_SAMPLES - x0
                if depth > nearest[y - y0, x, s]:
                    nearest[y - y0, x, s] = depth
                    seen[y - y0, x, s] = face
        a_row += a_dy * SUBPIXELS
        b_row += b_dy * SUBPIXELS
        c_row += c_dy * SUBPIXELS
        z_row += z_dy * SUBPIXELS


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _kept_out(x_step, y_step):  # type: ignore[no-untyped-def]  # numba
    """Return 1 for an edge whose own points belong to the triangle beyond it (neither top nor left edge), else 0."""
    return 0 if x_step > 0 or (x_step == 0 and y_step > 0) else 1


@njit(cache=True, nogil=True, error_model="numpy")
def _shade(picture, triangles, seen, box):  # type: ignore[no-untyped-def]  # numba
    """Colour a tile: once for each face that a pixel's samples see, at the middle of those samples."""
    y0, x0, y1, x1 = box
    corners, inverse_depth, faces, front, back, (texels, levels, uv) = triangles
    for y in range(y0, y1):
        for x in range(x0, x1):
            red, green, blue, covered = np.float32(0), np.float32(0), np.float32(0), 0
            samples = seen[y - y0, x - x0]
            for s in range(N_SAMPLES):
                face = samples[s]
                if face < 0:
                    continue
                count, sx, sy, is_first = 0, 0, 0, True
                for other in range(N_SAMPLES):
                    if samples[other] == face:
                        if other < s:
                            is_first = False
                        count += 1
                        sx += SAMPLE_X[other]
                        sy += SAMPLE_Y[other]
                if not is_first:
                    continue
                px, py = x * SUBPIXELS + sx / count, y * SUBPIXELS + sy / count
                corner = _corners_of(corners, inverse_depth, faces, face)
                r, g, b = _colour_at(px, py, corner, front, back)
                if levels.shape[0] > 0:
                    texel = _texture_at(px, py, corner, uv, texels, levels)
                    r, g, b = r * texel[0], g * texel[1], b * texel[2]
                red += r * np.float32(count)
                green += g * np.float32(count)
                blue += b * np.float32(count)
                covered += count
            if covered > 0:
                rest = np.float32(N_SAMPLES - covered)
                share, half = np.float32(1.0 / N_SAMPLES), np.float32(0.5)
                pixel = picture[y, x]
                pixel[0] = np.uint8((red + rest * pixel[0]) * share + half)
                pixel[1] = np.uint8((green + rest * pixel[1]) * share + half)
                pixel[2] = np.uint8((blue + rest * pixel[2]) * share + half)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _corners_of(corners, inverse_depth, faces, face):  # type: ignore[no-untyped-def]  # numba
    """Return a face's vertices, each with its column, row (1/256 pixel) and inverse depth."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    return (
        (a, corners[a, 0], corners[a, 1], inverse_depth[a]),
        (b, corners[b, 0], corners[b, 1], inverse_depth[b]),
        (c, corners[c, 0], corners[c, 1], inverse_depth[c]),
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _colour_at(px, py, corners, front, back):  # type: ignore[no-untyped-def]  # numba
    """Return the colour of a face, correct in perspective, at a point (1/256 pixel) inside it."""
    (a, ax, ay, za), (b, bx, by, zb), (c, cx, cy, zc) = corners
    ax, ay, bx, by, cx, cy = px - ax, py - ay, px - bx, py - by, px - cx, py - cy
    wa, wb, wc = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
    colours = front if wa + wb + wc < 0 else back  # counter-clockwise with y up is clockwise with y down
    wa, wb, wc = wa * za, wb * zb, wc * zc
    scale = 1.0 / (wa + wb + wc)
    wa, wb, wc = np.float32(wa * scale), np.float32(wb * scale), np.float32(wc * scale)
    return (
        wa * colours[a, 0] + wb * colours[b, 0] + wc * colours[c, 0],
        wa * colours[a, 1] + wb * colours[b, 1] + wc * colours[c, 1],
        wa * colours[a, 2] + wb * colours[b, 2] + wc * colours[c, 2],
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _texture_at(px, py, corners, uv, texels, levels):  # type: ignore[no-untyped-def]  # numba
    """Return what the texture of a face, correct in perspective, multiplies its colour by, at a point inside it."""
    (a, ax, ay, za), (b, bx, by, zb), (c, cx, cy, zc) = corners
    ax, ay, bx, by, cx, cy = px - ax, py - ay, px - bx, py - by, px - cx, py - cy
    za, zb, zc = np.float64(za), np.float64(zb), np.float64(zc)
    wa, wb, wc = (bx * cy - by * cx) * za, (cx * ay - cy * ax) * zb, (ax * by - ay * bx) * zc
    scale = 1.0 / (wa + wb + wc)
    u = (wa * uv[a, 0] + wb * uv[b, 0] + wc * uv[c, 0]) * scale
    v = (wa * uv[a, 1] + wb * uv[b, 1] + wc * uv[c, 1]) * scale
    height, width = levels[0, 1], levels[0, 2]
    footprint = 0.0  # squared length in texels of the longer of a pixel's two sides
    for a_step, b_step, c_step in ((cy - by, ay - cy, by - ay), (bx - cx, cx - ax, ax - bx)):  # to the right, down
        wa, wb, wc = a_step * za, b_step * zb, c_step * zc
        du = (wa * (uv[a, 0] - u) + wb * (uv[b, 0] - u) + wc * (uv[c, 0] - u)) * scale * SUBPIXELS * width
        dv = (wa * (uv[a, 1] - v) + wb * (uv[b, 1] - v) + wc * (uv[c, 1] - v)) * scale * SUBPIXELS * height
        footprint = max(footprint, du * du + dv * dv)
    last = levels.shape[0] - 1
    if footprint <= 1.0 or last == 0:
        return _bilinear(texels, levels[0], u, v)
    size = min(0.5 * np.log2(footprint), np.float64(last))
    level = min(int(size), last - 1)
    r, g, b = _bilinear(texels, levels[level], u, v)
    r_next, g_next, b_next = _bilinear(texels, levels[level + 1], u, v)
    share = np.float32(size - level)
    return r + share * (r_next - r), g + share * (g_next - g), b + share * (b_next - b)


@njit(cache=True, nogil=True, error_model="numpy")
def _bilinear(texels, level, u, v):  # type: ignore[no-untyped-def]  # numba
    """Interpolate between the four nearest texels of one level, 0 to 1; the texture repeats."""
    start, height, width = level[0], level[1], level[2]
    x, y = (u - np.floor(u)) * width - 0.5, (np.ceil(v) - v) * height - 0.5
    left, top = int(np.floor(x)), int(np.floor(y))
    s, t = np.float32(x - left), np.float32(y - top)
    right, bottom = left + 1, top + 1
    if left < 0:
        left = width - 1
    if right >= width:
        right = 0
    if top < 0:
        top = height - 1
    if bottom >= height:
        bottom = 0
    upper_left, upper_right = texels[start + top * width + left], texels[start + top * width + right]
    lower_left, lower_right = texels[start + bottom * width + left], texels[start + bottom * width + right]
    share = np.float32(1.0 / 255.0)
    right_share, lower_share = s * share, t
    left_share, upper_share = share - right_share, np.float32(1) - t
    wa, wb = left_share * upper_share, right_share * upper_share
    wc, wd = left_share * lower_share, right_share * lower_share
    return (
        wa * upper_left[0] + wb * upper_right[0] + wc * lower_left[0] + wd * lower_right[0],
        wa * upper_left[1] + wb * upper_right[1] + wc * lower_left[1] + wd * lower_right[1],
        wa * upper_left[2] + wb * upper_right[2] + wc * lower_left[2] + wd * lower_right[2],
    )
