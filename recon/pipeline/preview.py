"""The contact sheet of a run: depth, cloud, mesh and video frame of every approach side by side, to look at."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.approaches import parse_approach
from recon.capture.format import read_capture, read_frame
from recon.cloud import merge_clouds
from recon.depth.disparity_io import colour_preview, read_disparity
from recon.geometry.mesh import Cloud, read_mesh
from recon.pipeline.run import Run, cloud_name, depth_name, mesh_name, read_clouds, recorded_in
from recon.render.camera_path import camera_path
from recon.render.frames import render_frames
from recon.render.scene import scene_around
from recon.render.sheet import contact_sheet
from recon.rig import Camera
from recon.storage.artefacts import Artefacts, code_version
from recon.storage.files import whole_file
from recon.storage.remote import fetched

SIZE = (480, 480)  # of each picture, pixels
PATH_FRAMES = 5  # the camera stands where the path is a quarter over, so that depth is seen from a new side
VIEW = 1
PAPER = 128  # grey of the background "plain", also behind clouds


def make_preview(run: Run, frame: int) -> Path:
    """Write ``previews/<frame>.png`` of a run, unless it is there already, and return its path."""
    name = f"previews/{frame:04d}.png"
    meshes = [mesh_name(approach, frame) for approach in run.approaches]
    key = {"meshes": Artefacts(run.folder).digests(meshes), "code": code_version("pipeline/preview.py", "render")}

    def write(path: Path) -> None:
        done, encoded = cv2.imencode(".png", _sheet(run, frame)[..., ::-1])
        assert done  # an image in memory can always be encoded
        with whole_file(path) as temporary:
            temporary.write_bytes(encoded.tobytes())

    Artefacts(run.folder).make(name, key, write)
    return run.folder / name


def stage_pictures(run: Run, frame: int) -> dict[str, NDArray[np.uint8]]:
    """What each stage made of a frame, by the stage and its part such as "recording S1", "depth pm", "model pm_fb".

    Returns
    -------
    uint8 (H, W, 3) each, sRGB; the depth is the middle sensor's

    Raises
    ------
    ValueError
        If the run's recording is not where it was.
    """
    capture = read_capture(recorded_in(run))
    sensors = [stream.id for stream in capture.sensors]
    middle = sensors[len(sensors) // 2]
    pictures = {f"recording {sensor}": read_frame(capture, sensor, frame)[0] for sensor in sensors}
    for method in dict.fromkeys(parse_approach(approach).depth for approach in run.approaches):
        pictures[f"depth {method}"] = colour_preview(read_disparity(run.folder / depth_name(method, middle, frame)))
    cameras = camera_path(run.capture.rig, run.capture.bounds, PATH_FRAMES, SIZE)
    scene = scene_around(run.capture.bounds, cameras, "studio")
    for approach in run.approaches:
        mesh = read_mesh(run.folder / mesh_name(approach, frame))
        pictures[f"model {approach}"] = next(render_frames([mesh], [cameras[VIEW]], scene, renderer="software"))
    return pictures


def write_stage_pictures(run: Run, frame: int, folder: Path) -> None:
    """Write what each stage made of a frame as WebP files, "depth pm" as depth_pm.webp, unless they are there."""
    meshes = [mesh_name(approach, frame) for approach in run.approaches]
    key = {"meshes": Artefacts(run.folder).digests(meshes), "code": code_version("pipeline/preview.py", "render")}
    sensors = [f"recording_{stream.id}" for stream in run.capture.sensors]
    depths = [f"depth_{method}" for method in dict.fromkeys(parse_approach(one).depth for one in run.approaches)]
    names = [*sensors, *depths, *(f"model_{approach}" for approach in run.approaches)]

    def write(paths: list[Path]) -> None:
        pictures = {name.replace(" ", "_"): picture for name, picture in stage_pictures(run, frame).items()}
        for path in paths:
            with whole_file(path) as temporary:
                temporary.write_bytes(webp(pictures[path.stem]))

    Artefacts(folder).make_together([f"{name}.webp" for name in names], key, write)


def webp(picture: NDArray[np.uint8], quality: int = 85) -> bytes:
    """An RGB picture as WebP."""
    done, encoded = cv2.imencode(".webp", picture[..., ::-1], (cv2.IMWRITE_WEBP_QUALITY, quality))
    assert done  # an image in memory can always be encoded
    return bytes(encoded.tobytes())


def draw_cloud(cloud: Cloud, camera: Camera) -> NDArray[np.uint8]:
    """A cloud as a camera sees it, one pixel a point, the nearest on top: uint8 (H, W, 3), sRGB."""
    width, height = camera.size
    picture = np.full((height, width, 3), PAPER, np.uint8)
    depth = camera.points_in_camera(cloud.points)[:, 2]
    far_first = np.argsort(-depth)
    far_first = far_first[depth[far_first] > 0]
    pixels = np.rint(camera.project(cloud.points[far_first])).astype(int)
    inside = ((pixels >= 0) & (pixels < (width, height))).all(axis=1)
    picture[pixels[inside, 1], pixels[inside, 0]] = cloud.colours[far_first[inside]]
    return picture


def _sheet(run: Run, frame: int) -> NDArray[np.uint8]:
    cameras = camera_path(run.capture.rig, run.capture.bounds, PATH_FRAMES, SIZE)
    scenes = [scene_around(run.capture.bounds, cameras, background) for background in ("plain", "studio")]
    camera = cameras[VIEW]
    sensors = [stream.id for stream in run.capture.sensors]
    middle = sensors[len(sensors) // 2]
    pictures, labels = [], []
    for approach in run.approaches:
        method = parse_approach(approach).depth
        clouds = read_clouds(run.folder, [cloud_name(method, sensor, frame) for sensor in sensors])
        mesh = read_mesh(fetched(run.folder / mesh_name(approach, frame)))
        disparity = read_disparity(fetched(run.folder / depth_name(method, middle, frame)))
        pictures += [
            _fitted(colour_preview(disparity)),
            draw_cloud(merge_clouds(clouds), camera),
            *(next(render_frames([mesh], [camera], scene, renderer="software")) for scene in scenes),
        ]
        labels += [f"{approach}: depth of {middle}", f"{approach}: cloud", f"{approach}: mesh", f"{approach}: video"]
    return contact_sheet(pictures, labels, columns=4, width=SIZE[0])


def _fitted(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An image scaled to fit `SIZE`, centred on black."""
    scale = min(SIZE[0] / image.shape[1], SIZE[1] / image.shape[0])
    scaled = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)[: SIZE[1], : SIZE[0]]
    top, left = (SIZE[1] - scaled.shape[0]) // 2, (SIZE[0] - scaled.shape[1]) // 2
    fitted = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    fitted[top : top + scaled.shape[0], left : left + scaled.shape[1]] = scaled
    return fitted
