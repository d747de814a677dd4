"""What earlier frames saw of places that are still as they were: with it, the rims of surfaces flicker less.

At rims, depth is found in one frame and missed in the next. So a surface is also made of what a sensor measured a frame
or two before, as far as it is still true: the sensor's picture has not changed there, the sensor measures the same or
nothing now, and no other sensor looks through the place. What moved fails one of these, so that nothing trails behind
it. No frame depends on how an earlier one was fused.

Source
------
The permeability in time of Cigla and Alatan, Information permeability for stereo matching, 2013, as a threshold; the
look through is that of `recon.fusion.agreement`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from recon.depth.channels import grey_image
from recon.depth.matching.guide import change_beyond_noise, guide_image, noise_level
from recon.fusion.agreement import Seen, say_of, seen_by
from recon.geometry.mesh import Cloud
from recon.geometry.rig import Camera

SAME_SIGMAS = 2.0  # between two measurements of a pixel, that nothing has moved
STILL_LEVELS = 6.0  # half of the paper's permeability, 12 grey levels: what changed less passes by more than 60 %


def changes_since(before: NDArray[np.uint8], now: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Measure how much a sensor's picture has changed beyond its noise, float32 (H, W), grey levels.

    Parameters
    ----------
    before, now : uint8 (H, W, 3) or (H, W)
    """
    noise = noise_level(grey_image(now))
    return change_beyond_noise(guide_image(before, noise), guide_image(now, noise), noise)


def still_true(
    before: Sequence[Cloud], now: Sequence[Cloud], changes: Sequence[NDArray[np.float32]], cameras: Sequence[Camera]
) -> list[Cloud]:
    """Keep of the clouds of an earlier frame what holds now.

    Parameters
    ----------
    before, now : one per sensor, each point from the middle of a pixel; without sigma, nothing is known to hold
    changes : float32 (H, W) each, of the sensors' pictures since then, see `changes_since`
    cameras : of the pixels, without distortion
    """
    seen = [seen_by(camera, cloud) for cloud, camera in zip(now, cameras, strict=True)]
    kept = []
    for number, (cloud, change) in enumerate(zip(before, changes, strict=True)):
        view, others = seen[number], [other for other in seen[:number] + seen[number + 1 :] if other is not None]
        if view is None or cloud.sigma is None:
            kept.append(cloud.select(np.zeros(len(cloud), np.bool_)))
        else:
            kept.append(_still_true(cloud, change, view, others))
    return kept


def _still_true(cloud: Cloud, change: NDArray[np.float32], seen: Seen, others: Sequence[Seen]) -> Cloud:
    assert cloud.sigma is not None
    columns, rows = np.rint(seen.camera.project(cloud.points)).astype(np.int64).T
    gaps = seen.camera.points_in_camera(cloud.points)[:, 2] - seen.depth[rows, columns]
    moved = np.abs(gaps) > SAME_SIGMAS * np.hypot(seen.sigma[rows, columns], cloud.sigma)  # not where nothing is seen
    still = cloud.select((change[rows, columns] < STILL_LEVELS) & ~moved)
    return still.select(say_of(others, still, seen.camera).votes[:, 1] == 0)
