"""Rendering and encoding beside plain pyrender, in one run: `python bench/video.py`.

Full HD, about 300 000 faces, a new mesh every frame, lit, with a shadow on the floor, upload and readback included.
Each case runs in a process of its own on one core; seconds are medians a frame. Quote ratios, not seconds: those of
renderers are of processor time, which other work on the machine disturbs least.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np
from memory import memory_mb
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh, Texture
from recon.geometry.mesh_files import read_mesh, write_mesh
from recon.geometry.rig import Camera, Rig, Sensor, look_at
from recon.render.camera_path import camera_path
from recon.render.encoding.checked import check_video
from recon.render.encoding.video import DELIVERED, MASTER, write_video
from recon.render.frames import render_frames
from recon.render.scene import scene_around

SIZE = (1920, 1080)
BOUNDS = np.array([[-560.0, 0.0, -300.0], [620.0, 1850.0, 300.0]])
# Capsules of a person: ends and radius, mm.
BODY = (
    ((-120, 80, 0), (-100, 850, 0), 80),
    ((120, 80, 60), (100, 850, 0), 80),
    ((0, 900, 0), (0, 1350, 0), 170),
    ((-170, 1380, 0), (-420, 1000, 150), 60),
    ((170, 1380, 0), (500, 1650, 100), 60),
    ((0, 1500, 0), (0, 1680, 20), 110),
)
VOXEL_MM = 4.5  # gives 304 000 faces
CASES = ("plain pyrender", "pyrender", "software", "software with a texture")
TEXTURE = (2048, 2048)  # texels; as many as three full HD cameras put on a person


def person() -> Mesh:
    """The smooth union of capsules, its surface by marching cubes as a reconstruction's would be."""
    from skimage.measure import marching_cubes  # here, because the processes that are measured do not need it

    lowest = BOUNDS[0] - 20
    axes = [np.arange(*ends, VOXEL_MM, dtype=np.float32) for ends in zip(lowest, BOUNDS[1], strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    field = np.zeros(grid.shape[:3], dtype=np.float32)
    for start, end, radius in BODY:
        a, axis = np.array(start, np.float32), np.subtract(end, start).astype(np.float32)
        along = np.clip((grid - a) @ axis / (axis @ axis), 0, 1)
        field += np.exp(-(np.linalg.norm(grid - a - along[..., None] * axis, axis=-1) - radius) / 40)
    vertices, faces, normals, _ = marching_cubes(-np.log(field), 0.0)
    vertices = vertices * VOXEL_MM + lowest
    colours = 128 + 90 * np.sin(vertices / [70.0, 60.0, 50.0])
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), normals, colours.astype(np.uint8))


def with_texture(mesh: Mesh) -> Mesh:
    """The mesh under a picture of fine noise, seen from in front."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    pixels = np.random.default_rng(0).integers(0, 256, (*TEXTURE, 3), dtype=np.uint8)
    return replace(mesh, texture=Texture(pixels, ((mesh.vertices - low) / (high - low))[:, :2]))


def in_motion(mesh: Mesh, n: int) -> Iterator[Mesh]:
    """The mesh, swaying: new vertices in every frame."""
    for frame in range(n):
        sway = 30 * np.sin(2 * np.pi * frame / 50) * np.sin(mesh.vertices[:, 1] / 400)
        yield replace(mesh, vertices=mesh.vertices + np.outer(sway, [1, 0, 0]).astype(np.float32))


def cameras(n: int) -> tuple[Camera, ...]:
    """A path along three sensors."""
    K = np.array([[1500.0, 0, 959.5], [0, 1500.0, 539.5], [0, 0, 1]])
    sensors: list[Sensor] = []
    for azimuth in np.deg2rad([-50, 0, 50]):
        place = np.array([2600 * np.sin(azimuth), 1300, 2600 * np.cos(azimuth)])
        aside = 40 * np.array([np.cos(azimuth), 0, -np.sin(azimuth)])
        pair = [Camera(K, SIZE, look_at(place + way * aside, BOUNDS.mean(axis=0))) for way in (-1, 1)]
        sensors.append(Sensor(f"S{len(sensors) + 1}", *pair))
    return camera_path(Rig(tuple(sensors)), BOUNDS, n, SIZE)


def plain_pyrender(meshes: Iterator[Mesh], path: tuple[Camera, ...]) -> Iterator[NDArray[np.uint8]]:
    """What its documentation would have us write: lit, one shadow-casting light, a floor, vertex colours."""
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    import pyrender
    import trimesh

    renderer = pyrender.OffscreenRenderer(*SIZE)
    floor = trimesh.creation.box((6000, 1, 6000))
    light = pyrender.DirectionalLight(color=np.ones(3), intensity=4.0)
    for mesh, camera in zip(meshes, path, strict=True):
        scene = pyrender.Scene(ambient_light=(0.4, 0.4, 0.4), bg_color=(0.7, 0.7, 0.7))
        body = trimesh.Trimesh(
            mesh.vertices, mesh.faces, vertex_normals=mesh.normals, vertex_colors=mesh.colours, process=False
        )
        scene.add(pyrender.Mesh.from_trimesh(body, smooth=True))
        scene.add(pyrender.Mesh.from_trimesh(floor, smooth=False))
        scene.add(light, pose=np.linalg.inv(look_at((-1500, 3500, 2500), (0, 900, 0))) @ np.diag([1, -1, -1, 1]))
        K = camera.K
        lens = pyrender.IntrinsicsCamera(K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5, znear=100, zfar=20000)
        scene.add(lens, pose=np.linalg.inv(camera.cam_from_world) @ np.diag([1, -1, -1, 1]))
        yield renderer.render(scene, flags=pyrender.RenderFlags.SHADOWS_DIRECTIONAL)[0]
    renderer.delete()


def frames_of(case: str, mesh: Mesh, n: int) -> Iterator[NDArray[np.uint8]]:
    path, meshes = cameras(n), in_motion(mesh, n)
    if case == "plain pyrender":
        return plain_pyrender(meshes, path)
    return render_frames(meshes, path, scene_around(BOUNDS, path), renderer=case.split()[0])


def measure(case: str, mesh: Mesh, n: int) -> dict[str, float]:
    """Seconds a frame (wall and processor), peak memory, and how much more the second half needed, in this process."""
    wall, processor, resident = [], [], []
    frames = frames_of(case, mesh, n + 2)
    for _ in range(2):  # compiling, first upload
        next(frames)
    for _ in range(n):
        before = time.perf_counter(), time.process_time()
        next(frames)
        wall.append(time.perf_counter() - before[0])
        processor.append(time.process_time() - before[1])
        resident.append(memory_mb("VmRSS"))
    return {
        "wall_s": median(wall),
        "processor_s": median(processor),
        "total_processor_s": sum(processor),
        "peak_mib": memory_mb("VmHWM"),
        "growth_mib": max(resident[len(resident) // 2 :]) - max(resident[: len(resident) // 2]),
    }


def started(case: str, mesh: Path, n: int, core: int) -> subprocess.Popen[str]:
    """`measure` in a process of its own on one core."""
    environment = {**os.environ, "LP_NUM_THREADS": "0", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = ["taskset", "-c", str(core), sys.executable, __file__]
    command += ["--case", case, "--mesh", str(mesh), "--frames", str(n)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def finished(process: subprocess.Popen[str]) -> dict[str, float]:
    result: dict[str, float] = json.loads(process.communicate()[0])
    return result


def encoding(mesh: Mesh, n: int) -> dict[str, float]:
    """Speed, size and quality of a delivered video and its master of rendered frames."""
    with tempfile.TemporaryDirectory() as folder:
        raw = np.memmap(Path(folder) / "frames.raw", np.uint8, "w+", shape=(n, SIZE[1], SIZE[0], 3))
        for number, frame in enumerate(frames_of("software", mesh, n)):
            raw[number] = frame
        result = {}
        for name, quality in (("delivered", DELIVERED), ("master", MASTER)):
            path = Path(folder) / f"{name}.mp4"
            before = time.perf_counter()
            write_video(path, raw, size=SIZE, fps=25, encoding=quality)
            result[f"{name}_fps"] = n / (time.perf_counter() - before)
            result[f"{name}_mb"] = path.stat().st_size / 1e6
            check = check_video(path, raw)
            result[f"{name}_psnr_db"], result[f"{name}_worst_db"] = fmean(check.psnr_db), min(check.psnr_db)
            result[f"{name}_ssim"] = fmean(check.ssim)
        return result


def everything(n: int, n_encoded: int) -> dict[str, Any]:
    """All cases, one after another."""
    body = person()
    with tempfile.TemporaryDirectory() as folder:
        mesh = write_mesh(Path(folder) / "person.ply", body)
        results: dict[str, Any] = {"faces": len(body.faces)}
        textured = write_mesh(Path(folder) / "person.glb", with_texture(body))
        results |= {case: finished(started(case, textured if "texture" in case else mesh, n, 0)) for case in CASES}
        pair = [started("software", mesh, 4 * n, core) for core in (0, 1)]
        together = [finished(process) for process in pair]
        alone = finished(started("software", mesh, 4 * n, 0))
    results["two processes / one"] = (
        2 * alone["total_processor_s"] / max(result["total_processor_s"] for result in together)
    )
    results[f"software, {4 * n} frames"] = alone
    for case in CASES[1:]:
        results[f"plain pyrender / {case}"] = results["plain pyrender"]["processor_s"] / results[case]["processor_s"]
    return results | {"encoding": encoding(body, n_encoded)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--encode-frames", type=int, default=375)
    parser.add_argument("--case", choices=CASES, help="measure only this, in this process")
    parser.add_argument("--mesh", type=Path, help="the mesh to measure it with")
    arguments = parser.parse_args()
    if arguments.case:
        result = measure(arguments.case, read_mesh(arguments.mesh), arguments.frames)
    else:
        result = everything(arguments.frames, arguments.encode_frames)
    sys.stdout.write(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
