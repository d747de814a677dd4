"""From a model and cameras to pictures and videos."""

from recon.render.camera_path import camera_path
from recon.render.encoding.video import DELIVERED, MASTER, read_video, write_video
from recon.render.frames import render_frames
from recon.render.gaussians.draw import render_splats
from recon.render.path_file import read_path, write_path
from recon.render.scene import scene_around

__all__ = [
    "DELIVERED",
    "MASTER",
    "camera_path",
    "read_path",
    "read_video",
    "render_frames",
    "render_splats",
    "scene_around",
    "write_path",
    "write_video",
]
