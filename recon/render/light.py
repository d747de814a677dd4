"""Light on the model: captured colours times a soft gain, baked into the vertices for either side of the surface.

A texture keeps its colours, and the vertices hold the gain alone. Discs show their front, because they face the camera.

A reconstructed surface is dense, a few pixels a triangle, so light interpolated between vertices looks like light per
pixel; and it depends on no camera, so a model that stands still is lit once and both renderers show the same light.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Discs, Mesh, Model
from recon.geometry.splats import Splats
from recon.render.heights import height_map
from recon.render.scene import LitDiscs, LitMesh, LitModel, Scene
from recon.render.texture import drawable

GAMMA = 2.2  # light multiplies linear values; for a power law that is gain ** (1 / GAMMA) on encoded ones
SHADOW_BIAS = 0.012  # of the bounds' radius: layers of noisy surface nearer than that do not shade each other
SHADOW_TAPS = 2  # texels to either side over which the shadow's edge is softened


def lit(model: Model, scene: Scene) -> LitModel:
    """Light a model by the scene's light; splats keep the colours that they were trained with.

    Raises
    ------
    ValueError
        If a mesh has no faces, or a cloud no points.
    """
    if isinstance(model, Splats):
        return model
    return lit_discs(model, scene) if isinstance(model, Discs) else lit_mesh(model, scene)


def lit_mesh(mesh: Mesh, scene: Scene) -> LitMesh:
    """Light both sides of a mesh by the scene's light.

    Raises
    ------
    ValueError
        If the mesh has no faces.
    """
    if len(mesh.faces) == 0:
        raise ValueError(f"a mesh of {len(mesh.vertices)} vertices has no faces: there is nothing to render")
    colours = mesh.colours if mesh.texture is None else np.full_like(mesh.colours, 255)
    front, back = _sides(mesh, mesh.vertices, mesh.normals, colours, scene)
    return LitMesh(mesh.vertices, mesh.faces, front, back, mesh.texture and drawable(mesh.texture))


def lit_discs(discs: Discs, scene: Scene) -> LitDiscs:
    """Light the front of discs by the scene's light.

    Raises
    ------
    ValueError
        If there is no point.
    """
    cloud = discs.cloud
    if len(cloud) == 0:
        raise ValueError("the cloud has no points: there is nothing to render")
    front, _ = _sides(discs, cloud.points, cloud.normals, cloud.colours, scene)
    return LitDiscs(cloud.points, front, discs.radius_mm)


def _sides(
    model: Mesh | Discs,
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    colours: NDArray[np.uint8],
    scene: Scene,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Light the front and the back of points (N, 3) of a model that casts shadows on itself, uint8 (N, 3) each."""
    if scene.background.ambient >= 1:
        return colours, colours
    grid = scene.light_grid()
    shadow = height_map(model, grid)
    # A disc that faces the light stands out of an oblique surface by as much as its radius.
    margin = np.float32(scene.radius * SHADOW_BIAS + (model.radius_mm if isinstance(model, Discs) else 0))
    # A point is tested where it lies a little off the surface, so that a surface does not shade itself.
    lifted = grid.project(points + normals * margin), grid.project(points - normals * margin)
    visible = _visibility(shadow, *lifted, _towards_light(normals, scene), margin)
    front, back = (np.rint(colours * gain[:, None]).astype(np.uint8) for gain in _gains(normals, scene, visible))
    return front, back


def _towards_light(normals: NDArray[np.float32], scene: Scene) -> NDArray[np.float32]:
    """Compute the cosine (N,) between normals and the direction to the key light."""
    x, y, z = scene.to_light.astype(np.float32)
    return np.asarray(normals[:, 0] * x + normals[:, 1] * y + normals[:, 2] * z)


def _gains(
    normals: NDArray[np.float32], scene: Scene, visible: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Compute the gains on the encoded colours of front and back, (N,) each, at most 1."""
    background = scene.background
    towards = _towards_light(normals, scene)
    gains = []
    for side in (np.float32(1), np.float32(-1)):
        from_sky = 1 - background.sky * (1 - side * normals[:, 1]) / 2
        from_key = np.maximum(side * towards, 0) * visible
        light = background.ambient * from_sky + (1 - background.ambient) * from_key
        gains.append(np.clip(light, 0, 1).astype(np.float32) ** np.float32(1 / GAMMA))
    return gains[0], gains[1]


@njit(cache=True, nogil=True)
def _visibility(shadow, in_front, behind, towards, bias):  # type: ignore[no-untyped-def]  # numba
    """Compute the share of the key light that reaches each vertex, on the side that faces the light."""
    visible = np.empty(towards.shape[0], dtype=np.float32)
    share = np.float32(1) / np.float32((2 * SHADOW_TAPS) ** 2)
    for i in range(towards.shape[0]):
        point = in_front[i] if towards[i] > 0 else behind[i]
        column, row = int(np.floor(point[0])), int(np.floor(point[1]))
        reached = np.float32(0)
        for y in range(row - SHADOW_TAPS + 1, row + SHADOW_TAPS + 1):
            for x in range(column - SHADOW_TAPS + 1, column + SHADOW_TAPS + 1):
                is_outside = y < 0 or x < 0 or y >= shadow.shape[0] or x >= shadow.shape[1]
                if is_outside or point[2] <= shadow[y, x] + bias:
                    reached += share
        visible[i] = reached
    return visible
