"""Splats on an NVIDIA GPU by gsplat, from the same formulas as in `draw`: pictures differ by one grey level at most."""

from __future__ import annotations

from functools import lru_cache
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import Camera
from recon.geometry.splats import Splats
from recon.render.gaussians.draw import lay_over
from recon.render.gaussians.projection import DILATION, NEAREST


def gsplat_device() -> str:
    """Name gsplat's version and the GPU that it draws on; "" if it is not installed, or there is no GPU."""
    if find_spec("torch") is None or find_spec("gsplat") is None:
        return ""
    import gsplat
    import torch

    return f"{gsplat.__version__} on {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ""


def draw_splats_by_gsplat(picture: NDArray[np.uint8], splats: Splats, camera: Camera, **_: int) -> None:
    """Draw splats over a picture, uint8 (H, W, 3), in place.

    Parameters
    ----------
    picture, splats, camera : as for `recon.render.gaussians.draw.draw_splats`, whose other options mean nothing here
    """
    lay_over(picture, gsplat_layer(splats, camera, (picture.shape[1], picture.shape[0])))


def gsplat_layer(splats: Splats, camera: Camera, size: tuple[int, int], *, device: str = "cuda") -> NDArray[np.float32]:
    """Draw splats alone.

    Parameters
    ----------
    splats, camera : as for `recon.render.gaussians.draw.splat_layer`; the camera has no skew, which gsplat leaves out
    size : (width, height), pixels
    device : in PyTorch's words

    Returns
    -------
    float32 (H, W, 4), as `recon.render.gaussians.draw.splat_layer`
    """
    import torch
    from gsplat import rasterization

    K = camera.K.copy()
    K[:2, 2] += 0.5  # gsplat's pixels have their centres at a half
    pose = camera.cam_from_world.copy()
    pose[:3, :3] = pose[:3, :3] @ splats.model_from_world.T  # gsplat sees the model in the axes of its harmonics
    model = _uploaded(splats, device)
    seen_from, lens = (torch.from_numpy(each).float()[None].to(device) for each in (pose, K))
    colours, covered, _ = rasterization(
        **model,
        viewmats=seen_from,
        Ks=lens,
        width=size[0],
        height=size[1],
        near_plane=NEAREST * splats.unit,
        eps2d=DILATION,
        sh_degree=round(splats.harmonics.shape[1] ** 0.5) - 1,
        rasterize_mode="antialiased" if splats.antialiased else "classic",
    )
    return np.concatenate([colours[0].cpu().numpy(), 1 - covered[0].cpu().numpy()], axis=2)


@lru_cache(maxsize=1)
def _uploaded(splats: Splats, device: str) -> dict[str, Any]:
    """Hand a model to the GPU, once for all the frames in a row that show it."""
    import torch

    turned = np.eye(4)
    turned[:3, :3] = splats.model_from_world
    model = splats.moved(turned)
    arrays = {
        "means": model.centres,
        "quats": model.rotations,
        "scales": model.scales,
        "opacities": model.opacities,
        "colors": model.harmonics,
    }
    return {name: torch.from_numpy(array).to(device) for name, array in arrays.items()}
