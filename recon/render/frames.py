"""From models and cameras to pictures, by one of the renderers: the stage between model and video."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Model
from recon.geometry.rig import Camera
from recon.geometry.splats import Splats
from recon.render.backdrop import backdrop, floor_shade
from recon.render.cut import drawn_by, projected
from recon.render.discs import draw_discs
from recon.render.gaussians.draw import draw_splats
from recon.render.gaussians.gpu import draw_splats_by_gsplat, gsplat_device
from recon.render.light import lit
from recon.render.offscreen import NoRendererError, is_hardware, pyrender_frames, working_platform
from recon.render.rasterise import draw_model
from recon.render.scene import LitDiscs, LitMesh, Scene, Shot
from recon.render.texture import NO_MIPMAPS, mipmaps
from recon.runtime.files import naming

GPU_DEVICES = ("/dev/dri", "/dev/nvidia0", "/dev/dxg")  # one of them exists wherever OpenGL has a GPU on Linux

Renderer = Callable[[Iterable[Shot]], Iterator[NDArray[np.uint8]]]


def software_frames(shots: Iterable[Shot], *, over: Callable[..., None] = draw_splats) -> Iterator[NDArray[np.uint8]]:
    """Draw shots by the rasteriser of this package, four samples a pixel, and splats by `over`.

    Yields
    ------
    uint8 (H, W, 3), sRGB
    """
    drawn: LitMesh | None = None
    texture = NO_MIPMAPS
    for shot in shots:
        model = shot.model
        if isinstance(model, Splats):
            over(shot.picture, model, shot.camera, threads=shot.threads)
            yield shot.picture
            continue
        if isinstance(model, LitDiscs):
            reach = model.radius_mm * shot.camera.K[0, 0], model.radius_mm * shot.camera.K[1, 1]
            places = projected(model.vertices, shot.camera)
            draw_discs(shot.picture, places, model.colours, reach, threads=shot.threads)
        else:
            if model is not drawn:
                texture, drawn = mipmaps(model.texture) if model.texture else NO_MIPMAPS, model
            values = model.front, model.back, texture.uv
            places, faces, (front, back, uv) = drawn_by(shot.camera, model.vertices, model.faces, values)
            placed = texture._replace(uv=uv)
            draw_model(shot.picture, places, faces, front, back, texture=placed, threads=shot.threads)
        yield shot.picture


RENDERERS: dict[str, Renderer] = {
    "pyrender": pyrender_frames,
    "software": software_frames,
    "gsplat": partial(software_frames, over=draw_splats_by_gsplat),
}


def render_frames(
    meshes: Iterable[Model] | Callable[[int], Model],
    cameras: Sequence[Camera],
    scene: Scene,
    *,
    renderer: str = "auto",
    threads: int = 1,
) -> Iterator[NDArray[np.uint8]]:
    """Draw a mesh, discs or splats in the scene for each camera.

    Parameters
    ----------
    meshes : the model of each frame in turn, or a function of the frame's number; the same object again is not lit anew
    cameras : one a frame, without distortion
    scene : as `scene_around` made it for the whole path, also where `cameras` are a part of it
    renderer : a name in `RENDERERS`, or "auto" (see `choose_renderer`); splats are drawn alike by all, up to one grey
        level by gsplat
    threads : how many threads the software renderer uses; its pictures do not depend on it

    Yields
    ------
    uint8 (H, W, 3), sRGB

    Raises
    ------
    ValueError
        If the renderer is unknown, a model cannot be drawn (the message names the frame), or the meshes end early.
    NoRendererError
        If pyrender was asked for and cannot draw here.
    """
    draw = RENDERERS[choose_renderer(renderer)]
    return draw(_shots(meshes, cameras, scene, threads))


def render_masked_frames(
    meshes: Iterable[Model] | Callable[[int], Model],
    cameras: Sequence[Camera],
    scene: Scene,
    *,
    renderer: str = "auto",
    threads: int = 1,
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.bool_]]]:
    """Draw as `render_frames` does, and mark where the model is.

    Parameters
    ----------
    meshes, cameras, scene, renderer, threads : as for `render_frames`

    Yields
    ------
    uint8 (H, W, 3), sRGB, and bool (H, W): the pixels that the model changed; its shadow is part of the scene
    """
    draw = RENDERERS[choose_renderer(renderer)]
    empty: deque[NDArray[np.uint8]] = deque()
    for picture in draw(_remembered(_shots(meshes, cameras, scene, threads), empty)):
        changed = picture != empty.popleft()
        yield picture, changed[..., 0] | changed[..., 1] | changed[..., 2]  # nine times as fast as NumPy's `any`


def choose_renderer(wanted: str = "auto") -> str:
    """Choose the renderer on this machine for "auto": pyrender where OpenGL has a GPU, else the software renderer.

    The same renderer draws a whole stimulus set: choose once, and record the name.

    Raises
    ------
    ValueError
        If there is no such renderer.
    NoRendererError
        If pyrender or gsplat was asked for and cannot draw here.
    """
    if wanted == "auto":
        return "pyrender" if _has_gpu() else "software"
    if wanted not in RENDERERS:
        raise ValueError(f"there is no renderer {wanted!r}; expected auto or one of {', '.join(RENDERERS)}")
    if wanted == "pyrender":
        working_platform()
    if wanted == "gsplat" and not gsplat_device():
        raise NoRendererError(
            "gsplat cannot draw here: expected the packages torch and gsplat (pip install 'reconstudy[gpu]') and an "
            "NVIDIA GPU; the software renderer draws splats without"
        )
    return wanted


def describe_renderer(name: str) -> str:
    """Name a renderer with the platform and driver that it draws on, for a manifest."""
    if name == "gsplat":
        return f"software; splats by gsplat {gsplat_device()}"
    return f"pyrender ({', '.join(working_platform())})" if name == "pyrender" else name


def _remembered(shots: Iterable[Shot], empty: deque[NDArray[np.uint8]]) -> Iterator[Shot]:
    """Copy the picture without the model of each shot before a renderer draws over it."""
    for shot in shots:
        empty.append(shot.picture.copy())
        yield shot


def _shots(
    meshes: Iterable[Model] | Callable[[int], Model], cameras: Sequence[Camera], scene: Scene, threads: int
) -> Iterator[Shot]:
    in_turn = map(meshes, count()) if callable(meshes) else iter(meshes)
    last: Model | None = None
    for frame, camera in enumerate(cameras):
        model = next(in_turn, None)
        if model is None:
            raise ValueError(f"the meshes ended after {frame} of {len(cameras)} frames")
        if model is not last:
            with naming(f"frame {frame}"):
                shown = lit(model, scene)
            shade, last = floor_shade(model, scene), model
        yield Shot(shown, camera, backdrop(scene, camera, shade, threads=threads), threads)


def _has_gpu() -> bool:
    if not any(Path(device).exists() for device in GPU_DEVICES):
        return False
    try:
        return is_hardware(working_platform()[1])
    except NoRendererError:
        return False
