"""The pyrender renderer: models drawn by OpenGL without a window, on EGL or, where that is missing, on OSMesa.

pyrender draws the lit model flat, so that the colours of its vertices and texture are shown as they are (its own lights
would take them as linear), and the picture is laid over the same backdrop that the software renderer draws on. Its
points are squares of one size in pixels, so discs are drawn as polygons, made anew for every frame.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Texture
from recon.geometry.rig import OPENGL, Camera
from recon.geometry.splats import Splats
from recon.render.discs import LEAST_RADIUS
from recon.render.gaussians.draw import draw_splats
from recon.render.scene import LitDiscs, LitMesh, LitModel, Shot

# In the order in which they are tried, with the Debian packages that hold them.
PLATFORMS = {"egl": "libegl1 libegl-mesa0 libgl1-mesa-dri", "osmesa": "libosmesa6"}
SOFTWARE_DRIVERS = ("llvmpipe", "softpipe", "swrast", "software")
STRIPS = 8  # that a picture is drawn in: samples and read-back of a whole one of full HD take 120 MB, measured
DISC_CORNERS = 8  # an octagon as large as the disc differs from it by 0.05 of the radius
DISCS_AT_ONCE = 2**16  # that pyrender copies several times on the way to OpenGL, about 1 kB each
Lens = tuple[Camera, float, float]  # with the smallest and the largest depth that it sees, mm
PROBE_TIMEOUT_S = 60
# In a process of its own: PyOpenGL cannot change its platform once loaded, and a broken driver may crash.
PROBE = """
import pyrender
from OpenGL.GL import GL_RENDERER, glGetString
renderer = pyrender.OffscreenRenderer(16, 16)
print(glGetString(GL_RENDERER).decode())
"""


class NoRendererError(RuntimeError):
    """OpenGL cannot draw without a window on this machine."""


@cache
def working_platform() -> tuple[str, str]:
    """Find the first OpenGL platform that works, and the name of its driver.

    Where `PYOPENGL_PLATFORM` names one of them, only that one is tried.

    Raises
    ------
    NoRendererError
        If none works; says why and which package to install.
    """
    wanted = os.environ.get("PYOPENGL_PLATFORM", "")
    failures = []
    for platform in [wanted] if wanted in PLATFORMS else PLATFORMS:
        driver, failure = _probed(platform)
        if driver:
            return platform, driver
        failures.append(f"{platform}: {failure} (Debian: apt-get install {PLATFORMS[platform]})")
    raise NoRendererError(
        "pyrender cannot draw without a window here. "
        + "; ".join(failures)
        + ". Install one of these, or choose the software renderer, which needs no OpenGL"
    )


def is_hardware(driver: str) -> bool:
    """Tell an OpenGL driver for a GPU from one that draws on the processor, by its name."""
    return not any(name in driver.lower() for name in SOFTWARE_DRIVERS)


def pyrender_frames(shots: Iterable[Shot]) -> Iterator[NDArray[np.uint8]]:
    """Draw shots by pyrender, four samples a pixel; yields uint8 (H, W, 3), sRGB. Frees its OpenGL context at the end.

    Raises
    ------
    NoRendererError
        If neither EGL nor OSMesa works.
    """
    platform, _ = working_platform()
    os.environ["PYOPENGL_PLATFORM"] = platform
    import pyrender  # reads the platform when it is imported

    scale = 1 if platform == "egl" else 2  # OSMesa has one sample a pixel: four pixels become one
    renderer: Any = None
    scene = pyrender.Scene(bg_color=(0.0, 0.0, 0.0, 0.0))
    try:
        shown: LitModel | None = None
        for shot in shots:
            model = shot.model
            if isinstance(model, Splats):
                draw_splats(shot.picture, model, shot.camera, threads=shot.threads)
                yield shot.picture
                continue
            width, height = shot.camera.size
            strip = -(-height // STRIPS)
            renderer = renderer or pyrender.OffscreenRenderer(width * scale, strip * scale)
            renderer.viewport_width, renderer.viewport_height = width * scale, strip * scale
            if model is not shown or isinstance(model, LitDiscs):
                _empty(pyrender, renderer, scene)
                scene.add(_placed(pyrender, model, shot.camera))
                shown = model
            depth = shot.camera.points_in_camera(model.vertices)[:, 2]
            lens = (shot.camera, float(depth.min()), float(depth.max()))
            for top in range(0, height, strip):
                part = shot.picture[top : top + strip]
                _lay_over(part, _drawn(pyrender, renderer, scene, lens, top, scale)[: len(part)])
            yield shot.picture
    finally:
        if renderer is not None:
            renderer.delete()


def _probed(platform: str) -> tuple[str, str]:
    """Try a platform: the driver's name and "", or "" and why it does not work."""
    environment = {**os.environ, "PYOPENGL_PLATFORM": platform}
    try:
        done = subprocess.run(
            [sys.executable, "-c", PROBE], env=environment, capture_output=True, text=True, timeout=PROBE_TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        return "", f"no answer in {PROBE_TIMEOUT_S} s"
    lines = done.stdout.strip().splitlines()
    if done.returncode == 0 and lines:
        return lines[-1], ""
    complaints = done.stderr.strip().splitlines()
    return "", complaints[-1] if complaints else f"stopped with code {done.returncode}"


def _empty(pyrender: Any, renderer: Any, scene: Any) -> None:
    """Remove the meshes, and draw once: only then are they freed, before the next take as much again."""
    for node in list(scene.mesh_nodes):
        scene.remove_node(node)
    lens = scene.add(pyrender.IntrinsicsCamera(1, 1, 0, 0))
    renderer.render(scene, flags=pyrender.RenderFlags.DEPTH_ONLY)
    scene.remove_node(lens)


def _placed(pyrender: Any, model: LitMesh | LitDiscs, camera: Camera) -> Any:
    """Make a pyrender mesh of a model."""
    return _discs(pyrender, model, camera) if isinstance(model, LitDiscs) else _two_sided(pyrender, model)


def _two_sided(pyrender: Any, mesh: LitMesh) -> Any:
    """Make a pyrender mesh that shows other colours from behind: two surfaces, each visible from its front."""
    picture = mesh.texture and _texture(pyrender, mesh.texture)
    material = pyrender.MetallicRoughnessMaterial(doubleSided=False, baseColorTexture=picture)
    sides = ((mesh.faces, mesh.front), (mesh.faces[:, ::-1], mesh.back))
    return pyrender.Mesh(
        [
            pyrender.Primitive(
                positions=mesh.vertices,
                indices=np.ascontiguousarray(faces),
                color_0=_rgba(colours),
                texcoord_0=mesh.texture and mesh.texture.uv,
                material=material,
                mode=pyrender.constants.GLTF.TRIANGLES,
            )
            for faces, colours in sides
        ]
    )


def _texture(pyrender: Any, texture: Texture) -> Any:
    """Make a pyrender texture, of four channels: OpenGL expects rows of whole words, and pyrender does not pad them."""
    opaque = np.pad(texture.pixels, ((0, 0), (0, 0), (0, 1)), constant_values=255)
    return pyrender.Texture(source=opaque, source_channels="RGBA")


def _discs(pyrender: Any, discs: LitDiscs, camera: Camera) -> Any:
    """Make a pyrender mesh of polygons parallel to the picture, each as large as its disc."""
    angles = 2 * np.pi * np.arange(DISC_CORNERS) / DISC_CORNERS
    stretch = np.sqrt(np.pi / (DISC_CORNERS / 2 * np.sin(2 * np.pi / DISC_CORNERS)))  # of the corners, for equal areas
    right, down, _ = camera.rotation
    corners = stretch * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    first = np.arange(1, DISC_CORNERS - 1)
    fan = np.stack([np.zeros_like(first), first, first + 1], axis=1)
    primitives = []
    for start in range(0, len(discs.vertices), DISCS_AT_ONCE):
        middles = discs.vertices[start : start + DISCS_AT_ONCE]
        depth = camera.points_in_camera(middles)[:, 2:]
        across, along = (np.maximum(discs.radius_mm, LEAST_RADIUS * depth / camera.K[axis, axis]) for axis in (0, 1))
        offsets = (across * corners[:, 0])[..., None] * right + (along * corners[:, 1])[..., None] * down  # (N, 8, 3)
        faces = fan + DISC_CORNERS * np.arange(len(middles))[:, None, None]
        primitives.append(
            pyrender.Primitive(
                positions=(middles[:, None] + offsets).reshape(-1, 3).astype(np.float32),
                indices=faces.reshape(-1, 3).astype(np.uint32),
                color_0=_rgba(np.repeat(discs.colours[start : start + DISCS_AT_ONCE], DISC_CORNERS, axis=0)),
                material=pyrender.MetallicRoughnessMaterial(doubleSided=True),
                mode=pyrender.constants.GLTF.TRIANGLES,
            )
        )
    return pyrender.Mesh(primitives)


def _rgba(colours: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Convert colours (N, 3) to OpenGL's, float32 (N, 4), 0 to 1."""
    return np.pad(colours.astype(np.float32) / 255, ((0, 0), (0, 1)), constant_values=1)


def _drawn(pyrender: Any, renderer: Any, scene: Any, lens: Lens, top: int, scale: int) -> NDArray[np.uint8]:
    """Draw the model alone from row `top` on, uint8 (rows, W, 4): colours multiplied by coverage, and coverage."""
    camera, nearest, farthest = lens
    near = max(nearest * 0.9, 1.0)
    K = camera.K
    glass = pyrender.IntrinsicsCamera(
        fx=K[0, 0] * scale,
        fy=K[1, 1] * scale,
        cx=(K[0, 2] + 0.5) * scale,  # OpenGL counts from the picture's edge, not from a pixel's centre
        cy=(K[1, 2] - top + 0.5) * scale,
        znear=near,
        zfar=max(farthest * 1.1, near * 2),
    )
    node = scene.add(glass, pose=_world_from_gl_camera(camera))
    flags = pyrender.RenderFlags.FLAT | pyrender.RenderFlags.RGBA
    drawn, distance = renderer.render(scene, flags=flags)
    scene.remove_node(node)
    if scale == 1:
        return np.asarray(drawn, np.uint8)
    covered = (distance > 0)[..., None]
    whole = np.concatenate([drawn[..., :3] * covered, covered * np.uint8(255)], axis=2)
    height, width = whole.shape[0] // scale, whole.shape[1] // scale
    return np.asarray(np.rint(whole.reshape(height, scale, width, scale, 4).mean(axis=(1, 3))), np.uint8)


def _world_from_gl_camera(camera: Camera) -> NDArray[np.float64]:
    """Convert a pose to OpenGL's camera, which looks along -z with y up."""
    return np.asarray(np.linalg.inv(camera.cam_from_world) @ np.diag([*OPENGL, 1.0]))


@njit(cache=True, nogil=True)
def _lay_over(picture, model):  # type: ignore[no-untyped-def]  # numba
    """Lay a model (H, W, 4), its colours already multiplied by coverage, over a picture in place."""
    for y in range(picture.shape[0]):
        for x in range(picture.shape[1]):
            uncovered = 255 - np.int32(model[y, x, 3])
            if uncovered < 255:
                for channel in range(3):
                    behind = (uncovered * picture[y, x, channel] + 127) // 255
                    picture[y, x, channel] = min(model[y, x, channel] + behind, 255)
