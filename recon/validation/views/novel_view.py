"""Novel views: a model rendered from the place of a camera that it was not made from, against that camera's photograph.

The mesh is rendered without light, in the colours of its vertices, by the rasteriser of the fly-throughs. Where the
capture holds the true depth, a mesh is made from it in the same way: the best result that geometry allows here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.depth_maps import sensor_view
from recon.capture.format import Capture, CaptureError, Picture, read_frame, read_held_out, read_mask, read_masks
from recon.capture.masks.segment import mask_on_dark
from recon.capture.rectify import Rectification, rectify_left, undistort
from recon.cloud import CloudParameters, cloud_from_disparity, crop_cloud
from recon.fusion import FUSIONS
from recon.geometry.mesh import Mesh
from recon.geometry.rig import Camera
from recon.geometry.splats import Splats
from recon.render.cut import drawn_by
from recon.render.gaussians.draw import splat_layer
from recon.render.rasterise import draw_model
from recon.render.texture import NO_MIPMAPS, mipmaps
from recon.studio.truth import MASK, read_depth
from recon.surface import SurfaceParameters
from recon.surface.outlines import read_sights, with_outlines
from recon.validation.views.image_quality import gradient_map, psnr, ssim_map

HELD_OUT, SENSOR = "held out", "sensor"
COVERED = 0.5  # share of a pixel's samples
RIM_SHARE = 0.03  # width of the rim along the outline, of the mask's root area
LEAST_AGREEMENT = 0.9  # intersection over union of the masks by a dark background with the sensors' masks


@dataclass(frozen=True, eq=False)
class Photograph:
    """A camera's picture, without distortion.

    Parameters
    ----------
    name : such as "S1/left", or the held-out photograph's name
    kind : HELD_OUT, or SENSOR: models were made from it, so that it shows only what they lose
    pixels : uint8 (H, W, 3), sRGB
    mask : bool (H, W), where the object is; None where that is not known
    """

    name: str
    kind: str
    frame: int
    camera: Camera
    pixels: NDArray[np.uint8]
    mask: NDArray[np.bool_] | None


def photographs(capture: Capture, frames: Sequence[int]) -> Iterator[Photograph]:
    """Read the held-out photographs of the frames, then those of the sensors."""
    dark = _dark_background(capture) if capture.held_out else False
    for held_out in capture.held_out:
        if held_out.frame in frames:
            pixels = read_held_out(capture, held_out)
            mask = _true_mask(capture, held_out.image, held_out.camera, held_out.frame)
            if mask is None and dark:
                mask = mask_on_dark(pixels)
            name = held_out.image.removeprefix("held_out/")
            yield _undistorted(Photograph(name, HELD_OUT, held_out.frame, held_out.camera, pixels, mask))
    for frame in frames:
        for stream in capture.sensors:
            pictures, masks = read_frame(capture, stream.id, frame), read_masks(capture, stream.id, frame)
            for index, (side, camera) in enumerate(zip(stream.sides, stream.cameras, strict=True)):
                name, mask = f"{stream.id}/{side}", masks[index] if masks else None
                yield _undistorted(Photograph(name, SENSOR, frame, camera.camera, pictures[index], mask))


class Rendering(NamedTuple):
    """A model as a camera would see it.

    Parameters
    ----------
    picture : uint8 (H, W, 3), sRGB
    covered : bool (H, W), where a mesh shows its front, or splats cover half of the pixel
    back : bool (H, W), where it shows its back: nothing there was seen from this side
    """

    picture: NDArray[np.uint8]
    covered: NDArray[np.bool_]
    back: NDArray[np.bool_]

    def turned(self) -> Rendering:
        """Take the other side of the faces for their front."""
        return self._replace(covered=self.back, back=self.covered)


def rendered(mesh: Mesh | Splats, camera: Camera) -> Rendering:
    """Render a mesh without light, or splats; faces are counter-clockwise seen from their front."""
    if isinstance(mesh, Splats):
        return _rendered_splats(mesh, camera)
    colours = mesh.colours if mesh.texture is None else np.full_like(mesh.colours, 255)
    texture = NO_MIPMAPS if mesh.texture is None else mipmaps(mesh.texture)
    projected, faces, (colours, uv) = drawn_by(camera, mesh.vertices, mesh.faces, (colours, texture.uv))
    white = np.full_like(colours, 255)
    shape = (camera.size[1], camera.size[0], 3)
    picture, cover, front = (np.zeros(shape, np.uint8) for _ in range(3))
    draw_model(picture, projected, faces, colours, colours, texture=texture._replace(uv=uv))
    draw_model(cover, projected, faces, white, white)
    draw_model(front, projected, faces, white, np.zeros_like(white))
    share = cover.astype(np.float32) / 255
    full = np.clip(np.rint(picture / np.maximum(share, 1e-3)), 0, 255).astype(np.uint8)
    drawn, is_front = share[..., 0] >= COVERED, front[..., 0] * 2.0 >= cover[..., 0]
    return Rendering(full, drawn & is_front, drawn & ~is_front)


def _rendered_splats(splats: Splats, camera: Camera) -> Rendering:
    layer = splat_layer(splats, camera, camera.size)
    share = 1 - layer[..., 3:]
    full = np.rint(np.clip(layer[..., :3] / np.maximum(share, np.float32(1e-3)), 0, 1) * 255).astype(np.uint8)
    drawn = share[..., 0] >= COVERED
    return Rendering(full, drawn, np.zeros_like(drawn))


def view_rows(rendering: Rendering, photograph: Photograph) -> list[dict[str, Any]]:
    """Measure a rendering per region: all, the rim along the outline, and inside it.

    Colours are compared where the rendering covers the object with fronts of faces; beside that stands the PSNR over
    the whole object, in which what is not covered is black. Coverage is the covered share of the object, spill the
    share of what was drawn that lies beside it, roughness as in `roughness`; back faces are a share of all that was
    drawn, and count as nothing. Without a mask there are no regions, and what needs the object is None.

    Parameters
    ----------
    rendering : of the model
    photograph : from the same camera
    """
    picture, covered = rendering.picture, rendering.covered
    blackened = np.where(covered[..., None], picture, 0).astype(np.uint8)
    mask = photograph.mask
    both = covered if mask is None else covered & mask
    filled = np.where(both[..., None], picture, photograph.pixels)  # what lies outside neither gains nor loses
    likeness, edges = ssim_map(filled, photograph.pixels), gradient_map(filled, photograph.pixels)
    rows = []
    for region, inside in _regions(mask, covered).items():
        where = both & inside
        rows.append(
            {
                "region": region,
                "n_pixels": int(np.count_nonzero(where)),
                "psnr_db": psnr(picture, photograph.pixels, where),
                "psnr_object_db": None if mask is None else psnr(blackened, photograph.pixels, mask & inside),
                "ssim": _mean(likeness, where),
                "gradient": _mean(edges, where),
                "coverage": None if mask is None else _share(covered, mask & inside),
                "spill": None if mask is None or region != "all" else _share(~mask, covered),
                "roughness": None if mask is None or region != "all" else roughness(covered, mask),
                "back_faces": _share(rendering.back, rendering.back | covered) if region == "all" else None,
            }
        )
    return rows


def roughness(covered: NDArray[np.bool_], mask: NDArray[np.bool_]) -> float | None:
    """Divide the length of a rendering's outline by that of the object's, holes included; None without an object.

    Parameters
    ----------
    covered : bool (H, W), where the rendering shows the mesh
    mask : bool (H, W), where the object is
    """
    object_px = _outline_px(mask)
    return _outline_px(covered) / object_px if object_px else None


def _outline_px(region: NDArray[np.bool_]) -> float:
    outlines, _ = cv2.findContours(region.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    return float(sum(cv2.arcLength(outline, True) for outline in outlines))


def has_truth(capture: Capture, frame: int) -> bool:
    """Tell whether the capture holds the true depth of its sensors."""
    try:
        read_depth(capture, capture.sensors[0].id, "left", frame)
    except CaptureError:
        return False
    return True


def true_mesh(
    capture: Capture,
    frame: int,
    fusion: str,
    cloud: CloudParameters,
    surface: SurfaceParameters,
    *,
    outlines: bool = False,
) -> Mesh:
    """Make a mesh from the sensors' true depth, as an approach makes it from measured depth.

    Parameters
    ----------
    capture : with true depth
    frame : of the capture
    fusion : a name in `FUSIONS`
    cloud, surface : parameters of the steps from depth to mesh; with outlines, the surface has a voxel size
    outlines : whether the mesh's outlines follow the masks
    """
    clouds = []
    for stream in capture.sensors:
        view = sensor_view(stream, capture.bounds)
        left = rectify_left(view, read_frame(capture, stream.id, frame)[0])
        disparity = true_disparity(read_depth(capture, stream.id, "left", frame), stream.left.camera, view)
        clouds.append(crop_cloud(cloud_from_disparity(disparity, left, view, cloud), capture.bounds))
    if not outlines:
        return FUSIONS[fusion](clouds, surface)
    assert surface.voxel_mm is not None
    sights = read_sights(capture, capture.sensors, clouds, frame)
    return with_outlines(sights, surface.voxel_mm, lambda kept: (FUSIONS[fusion](kept, surface), []))[0]


def true_disparity(depth: NDArray[np.float32], camera: Camera, view: Rectification) -> NDArray[np.float32]:
    """Convert true depth into the disparity of the rectified left view.

    A rectified pixel takes the mean of the inverse depths around it, and NaN where one of them has no depth.

    Parameters
    ----------
    depth : float32 (H, W), z in the original camera, mm, NaN where there is none
    camera : the original
    view : of the sensor, rectified

    Returns
    -------
    float32 (H, W), pixels, NaN where there is none
    """
    inverse = cv2.remap(1 / depth, *view.left_maps, cv2.INTER_LINEAR, borderValue=float("nan"))
    height, width = inverse.shape
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    slopes = np.stack([columns, rows, np.ones_like(rows)], axis=2) @ np.linalg.inv(view.left.K).T
    in_original = slopes @ (camera.rotation @ view.left.rotation.T).T
    # z of a point at rectified depth Z is Z times the third coordinate of its slope in the original camera.
    rectified_inverse = inverse * in_original[..., 2]
    return np.asarray(view.focal * view.baseline * rectified_inverse + view.offset, dtype=np.float32)


def _regions(mask: NDArray[np.bool_] | None, covered: NDArray[np.bool_]) -> dict[str, NDArray[np.bool_]]:
    if mask is None:
        return {"all": np.ones_like(covered)}
    padded = np.pad(mask, 1, mode="edge").astype(np.uint8)  # an object may leave the picture: no outline is there
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
    rim = mask & (depth <= max(2.0, RIM_SHARE * float(np.sqrt(np.count_nonzero(mask)))))
    return {"all": np.ones_like(mask), "rim": rim, "inside": mask & ~rim}


def _mean(values: NDArray[np.float32], where: NDArray[np.bool_]) -> float | None:
    return float(values[where].mean()) if where.any() else None


def _share(part: NDArray[np.bool_], whole: NDArray[np.bool_]) -> float | None:
    return float(np.mean(part[whole])) if whole.any() else None


def _true_mask(capture: Capture, image: str, camera: Camera, frame: int) -> NDArray[np.bool_] | None:
    path = capture.folder / MASK.format(view=PurePosixPath(image).parent, frame=frame)
    return read_mask(Picture(path, frame, camera)) if path.is_file() else None


def _dark_background(capture: Capture) -> bool:
    """Tell whether a threshold of brightness separates the object: it agrees with the masks of the first sensor."""
    stream = capture.sensors[0]
    masks = read_masks(capture, stream.id, 0)
    if masks is None:
        return False
    bright = mask_on_dark(read_frame(capture, stream.id, 0)[0])
    return float((bright & masks[0]).sum()) >= LEAST_AGREEMENT * float((bright | masks[0]).sum())


def _undistorted(photograph: Photograph) -> Photograph:
    camera, pixels, mask = undistort(photograph.camera, photograph.pixels, photograph.mask)
    return replace(photograph, camera=camera, pixels=pixels, mask=mask)
