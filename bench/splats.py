"""Gaussian splats on the CPU, timed: `python bench/splats.py [--splats 1000000 ...] [--size 1920x1080] [--torch]`.

Splats with harmonics of degree 3 lie on a noisy ball that fills most of the picture's height; fewer ones are larger, so
that they cover alike. Printed are processor seconds of each stage, tile entries, and the process's highest memory.
With --torch, gsplat's plain torch code (projection and harmonics) with tiles laid over by torch draws the same picture;
it needs torch and gsplat in the environment, and only some thousand splats are advisable.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from memory import memory_mb
from numpy.typing import NDArray

from recon.geometry.rig import Camera, look_at
from recon.geometry.splats import Splats
from recon.render.gaussians.draw import render_splats
from recon.render.gaussians.projection import project
from recon.render.gaussians.tiles import TILE, binned, nearest_first

RADIUS_MM = 1000.0
THREADS = 2
BACKGROUND = (0.2, 0.3, 0.4)


def ball(n: int) -> Splats:
    """Scatter splats over a ball, as large as covers it some seven times."""
    rng = np.random.default_rng(0)
    directions, turns = rng.normal(size=(n, 3)), rng.normal(size=(n, 4))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    size = 2.0 * RADIUS_MM / np.sqrt(n)
    arrays = (
        directions * RADIUS_MM * (1 + 0.03 * rng.normal(size=(n, 1))),
        size * np.exp(0.6 * rng.normal(size=(n, 3))),
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        1 / (1 + np.exp(-rng.normal(1, 2, n))),
        rng.normal(size=(n, 16, 3)) * 0.2,
    )
    centres, scales, rotations, opacities, harmonics = (array.astype(np.float32) for array in arrays)
    return Splats(centres, scales, rotations, opacities, harmonics)


def camera(size: tuple[int, int]) -> Camera:
    """Look at the ball, so that it fills most of the picture's height."""
    focal = 1.48 * size[1]
    K = np.array([[focal, 0, size[0] / 2 - 0.5], [0, focal, size[1] / 2 - 0.5], [0, 0, 1]])
    return Camera(K, size, look_at([0, 0, 3.5 * RADIUS_MM], [0, 0, 0]))


def processor_s(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor seconds of all threads that a work takes, and its result."""
    started = time.process_time()
    result = work()
    return time.process_time() - started, result


def drawn_by_torch(splats: Splats, seen_by: Camera) -> NDArray[np.uint8]:
    """Draw by gsplat's torch code, tile by tile with the splats whose box meets it."""
    import torch  # of no environment of ours, as gsplat
    from gsplat.cuda._torch_impl import (
        _fully_fused_projection,
        _quat_scale_to_covar_preci,
        _spherical_harmonics,
    )

    torch.set_num_threads(THREADS)
    width, height = seen_by.size
    K = seen_by.K.copy()
    K[:2, 2] += 0.5
    centres, turns, scales = (torch.from_numpy(each) for each in (splats.centres, splats.rotations, splats.scales))
    covariances = _quat_scale_to_covar_preci(turns, scales, compute_preci=False)[0]
    pose = torch.from_numpy(seen_by.cam_from_world).float()[None]
    radii, means, depths, conics, _ = _fully_fused_projection(
        centres, covariances, pose, torch.from_numpy(K).float()[None], width, height
    )
    directions = torch.nn.functional.normalize(centres - torch.from_numpy(seen_by.centre).float(), dim=-1)
    colours = torch.clamp_min(_spherical_harmonics(3, directions, torch.from_numpy(splats.harmonics)) + 0.5, 0)
    order = torch.argsort(depths[0], stable=True)
    order = order[(radii[0][order] > 0).all(dim=-1)]
    means, conics, reach, colours = means[0][order], conics[0][order], radii[0][order], colours[order]
    opacities = torch.from_numpy(splats.opacities)[order]
    picture = torch.empty((height, width, 3))
    for top in range(0, height, TILE):
        in_rows = torch.nonzero((means[:, 1] + reach[:, 1] > top) & (means[:, 1] - reach[:, 1] < top + TILE))[:, 0]
        for left in range(0, width, TILE):
            x = means[in_rows, 0]
            chosen = in_rows[(x + reach[in_rows, 0] > left) & (x - reach[in_rows, 0] < left + TILE)]
            if not len(chosen):
                picture[top : top + TILE, left : left + TILE] = torch.tensor(BACKGROUND)
                continue
            rows, columns = torch.meshgrid(
                torch.arange(top, min(top + TILE, height)) + 0.5,
                torch.arange(left, min(left + TILE, width)) + 0.5,
                indexing="ij",
            )
            dx, dy = columns[..., None] - means[chosen, 0], rows[..., None] - means[chosen, 1]
            a, b, c = conics[chosen].T
            alpha = opacities[chosen] * torch.exp(-0.5 * (a * dx * dx + c * dy * dy) - b * dx * dy)
            alpha = torch.clamp_max(alpha, 0.999)
            alpha = torch.where(alpha < 1 / 255, 0.0, alpha)
            seen = torch.cumprod(torch.cat([torch.ones_like(alpha[..., :1]), 1 - alpha], dim=-1), dim=-1)
            shown = (alpha * seen[..., :-1]) @ colours[chosen] + seen[..., -1:] * torch.tensor(BACKGROUND)
            picture[top : top + TILE, left : left + TILE] = shown
    return np.asarray((picture.clamp(0, 1) * 255 + 0.5).numpy().astype(np.uint8))


def main() -> None:
    """Print a row for each number of splats."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--splats", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--torch", action="store_true")
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split("x"))
    seen_by = camera((width, height))
    render_splats(ball(100), seen_by, threads=THREADS)  # compiles
    print(
        "| splats | projection | order | tiles | whole frame, processor s | entries | peak MiB | torch | most apart |"
    )
    for n in arguments.splats:
        splats = ball(n)
        projection_s, ellipses = processor_s(partial(project, splats, seen_by, seen_by.size))
        order_s, order = processor_s(partial(nearest_first, ellipses.depths))
        tiles_s, (_, members) = processor_s(partial(binned, ellipses, order, seen_by.size))
        draw = partial(render_splats, splats, seen_by, background=BACKGROUND, threads=THREADS)
        frame_s, picture = processor_s(draw)
        numbers: list[object] = [
            n,
            *(f"{each:.2f}" for each in (projection_s, order_s, tiles_s, frame_s)),
            len(members),
        ]
        numbers.append(f"{memory_mb('VmHWM'):.0f}")
        if arguments.torch:
            torch_s, theirs = processor_s(partial(drawn_by_torch, splats, seen_by))
            numbers += [f"{torch_s:.1f}", int(np.abs(picture.astype(int) - theirs).max())]
        print("|", " | ".join(map(str, numbers)), "|", flush=True)


if __name__ == "__main__":
    main()
