"""Pictures of a run to look at: the contact sheet of all approaches, and what each stage made of a frame."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import read_capture, read_frame
from recon.capture.images import write_picture
from recon.cloud import merge_clouds
from recon.depth.disparity_io import colour_preview, read_disparity
from recon.geometry.mesh import Cloud
from recon.geometry.mesh_files import read_mesh
from recon.geometry.rig import Camera
from recon.methods.approaches import parse_approach
from recon.models.inspection import standing_height
from recon.pipeline.run import Run, View, read_clouds, recorded_in
from recon.render.camera_path import camera_path
from recon.render.frames import render_frames
from recon.render.scene import scene_around
from recon.render.sheet import contact_sheet
from recon.runtime.artefacts import Artefacts, code_version
from recon.runtime.files import write_bytes

SIZE = (480, 480)  # of each picture, pixels
PATH_FRAMES = 5  # the camera stands where the path is a quarter over, so that depth is seen from a new side
VIEW = 1
WEBP_QUALITY = 85
PAPER = 128  # grey of the background "plain", also behind clouds


def make_preview(run: Run, frame: int) -> Path:
    """Write ``previews/<frame>.png`` of a run, unless it is there already, and return its path.

    A NoPathError says that there is no place to look from.
    """

    def write(path: Path) -> None:
        write_picture(path, _sheet(run, frame))

    name = f"previews/{frame:04d}.png"
    run.artefacts.make(name, _key(run, frame), write)
    return run.folder / name


def write_stage_pictures(run: Run, frame: int, folder: Path) -> None:
    """Write what each stage made of a frame as WebP files, such as recording_S1, depth_pm and model_pm_fb.

    Files that are there already are kept; the depth is the middle sensor's.

    Parameters
    ----------
    run, frame : what to show
    folder : where the pictures go

    Raises
    ------
    ValueError
        If the run's recording is not where it was.
    """
    methods = {parse_approach(approach).depth: run.shown_in(approach, frame) for approach in run.approaches}
    pictures: dict[str, Callable[[], NDArray[np.uint8]]] = {
        **{f"recording_{stream.id}": partial(_recorded, run, stream.id, frame) for stream in run.capture.sensors},
        **{f"depth_{method}": partial(_depth, run, method, shown) for method, shown in methods.items()},
        **{f"model_{approach}": partial(_model, run, approach, frame, "studio") for approach in run.approaches},
    }

    def write(paths: list[Path]) -> None:
        for path in paths:
            write_bytes(path, webp(pictures[path.stem]()))

    Artefacts(folder).make_together([f"{name}.webp" for name in pictures], _key(run, frame), write)


def webp(picture: NDArray[np.uint8]) -> bytes:
    """Encode a picture, uint8 (H, W, 3), sRGB, as WebP."""
    return bytes(cv2.imencode(".webp", picture[..., ::-1], (cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY))[1].tobytes())


def draw_cloud(cloud: Cloud, camera: Camera) -> NDArray[np.uint8]:
    """Draw a cloud as a camera sees it, one pixel a point, the nearest on top: uint8 (H, W, 3), sRGB."""
    width, height = camera.size
    picture = np.full((height, width, 3), PAPER, np.uint8)
    depth = camera.points_in_camera(cloud.points)[:, 2]
    far_first = np.argsort(-depth)
    far_first = far_first[depth[far_first] > 0]
    pixels = np.rint(camera.project(cloud.points[far_first])).astype(int)
    inside = ((pixels >= 0) & (pixels < (width, height))).all(axis=1)
    picture[pixels[inside, 1], pixels[inside, 0]] = cloud.colours[far_first[inside]]
    return picture


def _key(run: Run, frame: int) -> dict[str, object]:
    """List what the pictures of a frame are made from."""
    meshes = [run.mesh_name(approach, frame) for approach in run.approaches]
    return {"meshes": run.artefacts.digests(meshes), "code": code_version("pipeline/preview.py", "render")}


def _sheet(run: Run, frame: int) -> NDArray[np.uint8]:
    """Return a row of four pictures for each approach."""
    camera = _cameras(run)[VIEW]
    pictures, labels = [], []
    for approach in run.approaches:
        method = parse_approach(approach).depth
        sensors = run.capture.sensors_for(method)
        clouds = read_clouds(run.artefacts, [View(method, stream.id, frame).cloud for stream in sensors])
        pictures += [
            _fitted(_depth(run, method, frame)),
            draw_cloud(merge_clouds(clouds), camera),
            _model(run, approach, frame, "plain"),
            _model(run, approach, frame, "studio"),
        ]
        labels += [f"{approach}: {part}" for part in (f"depth of {_middle(run, method)}", "cloud", "mesh", "video")]
    return contact_sheet(pictures, labels, columns=4, width=SIZE[0])


def _recorded(run: Run, sensor_id: str, frame: int) -> NDArray[np.uint8]:
    return read_frame(read_capture(recorded_in(run)), sensor_id, frame)[0]


def _depth(run: Run, method: str, frame: int) -> NDArray[np.uint8]:
    return colour_preview(read_disparity(run.artefacts.path(View(method, _middle(run, method), frame).depth)))


def _model(run: Run, approach: str, frame: int, background: str) -> NDArray[np.uint8]:
    cameras = _cameras(run)
    mesh = read_mesh(run.artefacts.path(run.mesh_name(approach, frame)))
    bounds = run.capture.bounds
    scene = scene_around(bounds, cameras, background, floor_y=standing_height(mesh, bounds))
    return next(render_frames([mesh], [cameras[VIEW]], scene, renderer="software"))


def _cameras(run: Run) -> tuple[Camera, ...]:
    return camera_path(run.capture.rig, run.capture.bounds, PATH_FRAMES, SIZE)


def _middle(run: Run, method: str) -> str:
    """Return the name of the middle one of the sensors that a depth method uses."""
    sensors = run.capture.sensors_for(method)
    return sensors[len(sensors) // 2].id


def _fitted(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image scaled to fit `SIZE`, centred on black."""
    scale = min(SIZE[0] / image.shape[1], SIZE[1] / image.shape[0])
    scaled = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)[: SIZE[1], : SIZE[0]]
    top, left = (SIZE[1] - scaled.shape[0]) // 2, (SIZE[0] - scaled.shape[1]) // 2
    fitted = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    fitted[top : top + scaled.shape[0], left : left + scaled.shape[1]] = scaled
    return fitted
