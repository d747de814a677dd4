"""Calibrations in the shape that each program writes put the cameras where OpenCV projects to."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from recon.capture.format import Capture, CaptureError, read_capture, read_frame
from recon.capture.importing.calibrations.multi_view import METRE, read_strecha
from recon.capture.importing.calibrations.placed import Placed
from recon.capture.importing.calibrations.robots import read_euroc, read_kalibr, read_ros
from recon.capture.importing.formats import AUTO, FORMATS, find_format, import_recording
from recon.capture.importing.lenses import FisheyeCamera
from recon.capture.importing.sources import ImportOptions
from recon.cli.commands.recordings import IMPORTED
from recon.geometry.rig import Camera, look_at, rigid
from recon.runtime.notices import Notice
from tests.recon.capture.importing.labelled_recording import (
    BOUNDS,
    OPTIONS,
    POINTS,
    RIG,
    SIZE,
    TURNED,
    colmap_model,
    seen,
    write_picture,
)

LEFT, RIGHT = RIG.sensors[0].left, RIG.sensors[0].right
RELATIVE = RIGHT.cam_from_world @ np.linalg.inv(LEFT.cam_from_world)
AHEAD = np.array([[0.1, 0.05, 1.5], [-0.2, 0.1, 1.2], [0.15, -0.12, 1.8]]) * 1000  # mm, before the left camera


def rectified(x: float) -> Camera:
    """The camera of a rectified pair, x mm to the right."""
    return Camera(
        np.array([[400.0, 0, 150.5 + x / 20], [0, 400, 118.25], [0, 0, 1]]), SIZE, rigid(np.eye(3), (-x, 0, 0))
    )


PAIR = (rectified(0.0), rectified(120.0))


def pictures(folder: Path, *names: str) -> None:
    for number, name in enumerate(names):
        write_picture(folder / name, 40 + 20 * number)


def dump(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content, default_flow_style=None))


def matrix(values: NDArray[np.float64], rows: int) -> dict[str, object]:
    return {"rows": rows, "cols": values.size // rows, "data": values.ravel().tolist()}


def rectification() -> tuple[NDArray[np.float64], ...]:
    metres = RELATIVE[:3, 3:] / 1000
    dist = (np.append(LEFT.dist, 0), np.append(RIGHT.dist, 0))
    return cv2.stereoRectify(LEFT.K, dist[0], RIGHT.K, dist[1], SIZE, RELATIVE[:3, :3], metres)[:4]


def ros(folder: Path) -> list[Camera]:
    R1, R2, P1, P2 = rectification()
    for side, camera, R, P in (("left", LEFT, R1, P1), ("right", RIGHT, R2, P2)):
        content = {
            "image_width": SIZE[0],
            "image_height": SIZE[1],
            "camera_name": f"narrow_stereo/{side}",
            "camera_matrix": matrix(camera.K, 3),
            "distortion_model": "plumb_bob",
            "distortion_coefficients": matrix(np.append(camera.dist, 0), 1),
            "rectification_matrix": matrix(R, 3),
            "projection_matrix": matrix(P, 3),
        }
        dump(folder / f"{side}.yaml", content)
        pictures(folder, f"{side}/0.png", f"{side}/1.png")
    return [LEFT, RIGHT]


def ros_messages(folder: Path) -> list[Camera]:
    """As `ros2 topic echo` prints them, by other names and without order."""
    R1, R2, P1, P2 = rectification()
    for name, camera, R, P in (("b_first", LEFT, R1, P1), ("a_second", RIGHT, R2, P2)):
        content = {
            "header": {"frame_id": name},
            "height": SIZE[1],
            "width": SIZE[0],
            "distortion_model": "rational_polynomial",
            "d": [*camera.dist.tolist(), 0, 0, 0, 0],
            "k": camera.K.ravel().tolist(),
            "r": R.ravel().tolist(),
            "p": P.ravel().tolist(),
        }
        (folder / name).mkdir(parents=True)
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content) + "---\n")
        pictures(folder, f"{name}/0.png")
    return [LEFT, RIGHT]


def in_metres(transform: NDArray[np.float64]) -> list[list[float]]:
    return [[*row[:3], row[3] / 1000] if number < 3 else row for number, row in enumerate(transform.tolist())]


def kalibr(folder: Path) -> list[Camera]:
    chain = {}
    for number, camera in enumerate((LEFT, RIGHT)):
        chain[f"cam{number}"] = {
            "cam_overlaps": [1 - number],
            "camera_model": "pinhole",
            "distortion_coeffs": camera.dist.tolist(),
            "distortion_model": "radtan",
            "intrinsics": [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]],
            "resolution": list(SIZE),
            "rostopic": f"/cam{number}/image_raw",
        }
        pictures(folder, f"cam{number}/1403636579763555584.png")
    chain["cam1"]["T_cn_cnm1"] = in_metres(RELATIVE)
    dump(folder / "log-camchain.yaml", json.loads(json.dumps(chain)))
    return [LEFT, RIGHT]


def kalibr_without_last_rows(folder: Path) -> list[Camera]:
    cameras = kalibr(folder)
    chain = yaml.safe_load((folder / "log-camchain.yaml").read_text())
    chain["cam1"]["T_cn_cnm1"] = chain["cam1"]["T_cn_cnm1"][:3]
    dump(folder / "log-camchain.yaml", chain)
    return cameras


def euroc(folder: Path) -> list[Camera]:
    body = rigid(Rotation.from_euler("xyz", (10, 80, -30), degrees=True).as_matrix(), (30.0, -20, 9))
    for number, camera in enumerate((LEFT, RIGHT)):
        from_camera = body @ np.linalg.inv(rigid(np.eye(3), np.zeros(3)) if number == 0 else RELATIVE)
        content = {
            "sensor_type": "camera",
            "T_BS": matrix(np.array(in_metres(from_camera)), 4),
            "rate_hz": 20,
            "resolution": list(SIZE),
            "camera_model": "pinhole",
            "intrinsics": [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]],
            "distortion_model": "radial-tangential",
            "distortion_coefficients": camera.dist.tolist(),
        }
        base = folder / f"mav0/cam{number}"
        dump(base / "sensor.yaml", json.loads(json.dumps(content, default=float)))
        (base / "sensor.yaml").write_text("#Default camera\n" + (base / "sensor.yaml").read_text())
        pictures(base, "data/1403636579763555584.png", "data/1403636579813555456.png")
    return [LEFT, RIGHT]


def euroc_in_rows(folder: Path) -> list[Camera]:
    cameras = euroc(folder)
    for path in folder.glob("mav0/*/sensor.yaml"):
        content = yaml.safe_load(path.read_text())
        dump(path, content | {"T_BS": np.reshape(content["T_BS"]["data"], (4, 4)).tolist()})
    return cameras


def matlab_struct(is_new: bool) -> dict[str, object]:
    struct: dict[str, object] = {}
    for number, camera in ((1, LEFT), (2, RIGHT)):
        K = camera.K + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
        struct[f"CameraParameters{number}"] = {
            "RadialDistortion": camera.dist[:2].tolist(),
            "TangentialDistortion": camera.dist[2:].tolist(),
            "ImageSize": [SIZE[1], SIZE[0]],
            "WorldUnits": "millimeters",
            **({"K": K.tolist()} if is_new else {"IntrinsicMatrix": K.T.tolist()}),
        }
    if is_new:
        pose = {"Dimensionality": 3, "R": RELATIVE[:3, :3].tolist(), "Translation": RELATIVE[:3, 3].tolist()}
        return struct | {"PoseCamera2": pose}
    return struct | {
        "RotationOfCamera2": RELATIVE[:3, :3].T.tolist(),
        "TranslationOfCamera2": RELATIVE[:3, 3].tolist(),
    }


def matlab(folder: Path) -> list[Camera]:
    folder.mkdir(parents=True)
    savemat(folder / "stereo.mat", {"stereoParams": matlab_struct(False)})
    pictures(folder, "left/1.png", "right/1.png")
    return [LEFT, RIGHT]


def matlab_json(folder: Path) -> list[Camera]:
    folder.mkdir(parents=True)
    (folder / "stereo.json").write_text(json.dumps(matlab_struct(True)))
    pictures(folder, "camera1/1.png", "camera2/1.png")
    return [LEFT, RIGHT]


def matlab_without_sizes(folder: Path) -> list[Camera]:
    """`ImageSize` of parameters that nobody told it is empty."""
    cameras, struct = matlab(folder), matlab_struct(False)
    empty = {"ImageSize": np.zeros((0, 0))}
    struct |= {key: value | empty for key, value in struct.items() if isinstance(value, dict)}
    savemat(folder / "stereo.mat", {"stereoParams": struct})
    return cameras


def matlab_as_opencv(folder: Path) -> list[Camera]:
    """What `stereoParametersToOpenCV` returns, saved by its page's names."""
    cameras = matlab(folder)
    variables: dict[str, object] = {"rotationOfCamera2": RELATIVE[:3, :3], "translationOfCamera2": RELATIVE[:3, 3]}
    for number, camera in ((1, LEFT), (2, RIGHT)):
        variables |= {
            f"intrinsicMatrix{number}": camera.K,
            f"distortionCoefficients{number}": np.append(camera.dist, 0),
        }
    savemat(folder / "stereo.mat", variables)
    return cameras


def calibration_toolbox(folder: Path) -> list[Camera]:
    """Bouguet's toolbox saves each camera's own file beside the pair's, and takes its pictures in the same folder."""
    folder.mkdir(parents=True)
    savemat(folder / "Calib_Results_left.mat", {"fc": np.ones((2, 1)), "cc": np.ones((2, 1))})
    variables: dict[str, object] = {"om": Rotation.from_matrix(RELATIVE[:3, :3]).as_rotvec()[:, None]}
    variables |= {"T": RELATIVE[:3, 3:], "nx": float(SIZE[0]), "ny": float(SIZE[1])}
    for side, camera in (("left", LEFT), ("right", RIGHT)):
        variables |= {f"fc_{side}": np.diag(camera.K)[:2, None], f"cc_{side}": camera.K[:2, 2:], f"alpha_c_{side}": 0.0}
        variables |= {f"kc_{side}": np.append(camera.dist, 0)[:, None]}
    savemat(folder / "Calib_Results_stereo.mat", variables)
    pictures(folder, "left01.png", "left02.png", "right01.png", "right02.png")
    return [LEFT, RIGHT]


def ros_calibrator(folder: Path) -> list[Camera]:
    """What ROS's calibrator packs: pictures beside both files, and what it says of one camera."""
    cameras = ros(folder)
    dump(folder / "ost.yaml", yaml.safe_load((folder / "left.yaml").read_text()) | {"camera_name": "narrow_stereo"})
    for side in ("left", "right"):
        (folder / side).rename(folder / f"{side}s")
        for number, path in enumerate(sorted((folder / f"{side}s").iterdir())):
            path.rename(folder / f"{side}-{number:04d}{path.suffix}")
    return cameras


def rows(K: NDArray[np.float64]) -> str:
    return "[" + "; ".join(" ".join(f"{value!r}" for value in row) for row in K.tolist()) + "]"


def middlebury_pair(folder: Path) -> list[Camera]:
    folder.mkdir(parents=True)
    left, right = PAIR
    doffs = right.K[0, 2] - left.K[0, 2]
    lines = [f"cam0={rows(left.K)}", f"cam1={rows(right.K)}", f"doffs={doffs}", "baseline=120"]
    lines += [f"width={SIZE[0]}", f"height={SIZE[1]}", "ndisp=64", "isint=0", "vmin=10", "vmax=40", "dyavg=0"]
    (folder / "calib.txt").write_text("\n".join(lines) + "\n")
    pictures(folder, "im0.png", "im1.png")
    disparity = np.full(SIZE[::-1], np.inf, np.float32)
    disparity[20:60, 30:90] = 26.0
    (folder / "disp0.pfm").write_bytes(b"Pf\n320 240\n-1.0\n" + disparity[::-1].astype("<f4").tobytes())
    return list(PAIR)


def kitti_projection(camera: Camera) -> str:
    P = camera.K @ np.column_stack([np.eye(3), camera.cam_from_world[:3, 3] / 1000])
    return " ".join(map(repr, P.ravel().tolist()))


def kitti_odometry(folder: Path) -> list[Camera]:
    folder.mkdir(parents=True)
    (folder / "calib.txt").write_text(
        "".join(f"P{n}: {kitti_projection(PAIR[n % 2])}\n" for n in range(4)) + "Tr: 1 0 0\n"
    )
    pictures(folder, "image_0/000000.png", "image_1/000000.png")
    return list(PAIR)


def kitti_raw(folder: Path) -> list[Camera]:
    """Pictures of the size before rectification have the cameras before it."""
    lines = ["calib_time: 09-Jan-2012 13:57:47", "corner_dist: 9.950000e-02"]
    for number, camera in ((2, LEFT), (3, RIGHT)):
        relative = np.eye(4) if number == 2 else RELATIVE
        entries = {
            "S": SIZE,
            "K": camera.K.ravel(),
            "D": np.append(camera.dist, 0),
            "R": relative[:3, :3].ravel(),
            "T": relative[:3, 3] / 1000,
            "S_rect": (300, 200),
            "R_rect": np.eye(3).ravel(),
        }
        lines += [f"{key}_0{number}: {' '.join(map(repr, map(float, values)))}" for key, values in entries.items()]
        lines.append(f"P_rect_0{number}: {kitti_projection(PAIR[number - 2])}")
        pictures(folder / "date/drive", f"image_0{number}/data/0000000000.png")
    (folder / "date/calib_cam_to_cam.txt").write_text("\n".join(lines) + "\n")
    return [LEFT, RIGHT]


@pytest.mark.parametrize(
    ("name", "write", "below"),
    [
        ("ros", ros, ""),
        ("ros", ros_messages, ""),
        ("kalibr", kalibr, ""),
        ("kalibr", kalibr_without_last_rows, ""),
        ("euroc", euroc, ""),
        ("euroc", euroc_in_rows, ""),
        ("matlab", matlab, ""),
        ("matlab", matlab_json, ""),
        ("matlab", matlab_without_sizes, ""),
        ("matlab", matlab_as_opencv, ""),
        ("matlab", calibration_toolbox, ""),
        ("ros", ros_calibrator, ""),
        ("middlebury-pair", middlebury_pair, ""),
        ("kitti", kitti_odometry, ""),
        ("kitti", kitti_raw, "date/drive"),
    ],
)
def test_a_rig_is_found_by_its_files_and_projects_as_opencv_does(
    tmp_path: Path, name: str, write: Callable[[Path], list[Camera]], below: str
) -> None:
    expected = write(tmp_path / "source")
    assert find_format(tmp_path / "source" / below) == name
    capture = import_recording(AUTO, tmp_path / "source" / below, tmp_path / "out", replace(OPTIONS, fps=None))
    first = expected[0].cam_from_world
    world = AHEAD @ TURNED.T
    for stream, camera in zip(capture.sensors[0].cameras, expected, strict=True):
        relative = replace(camera, cam_from_world=camera.cam_from_world @ np.linalg.inv(first))
        np.testing.assert_allclose(seen(stream.camera, world), seen(relative, AHEAD), atol=1e-6)
    read_frame(read_capture(tmp_path / "out"), "S1", capture.n_frames - 1)


def test_rates_and_true_disparities_come_in(tmp_path: Path) -> None:
    euroc(tmp_path / "euroc")
    assert import_recording("euroc", tmp_path / "euroc", tmp_path / "a", OPTIONS).fps == 20
    middlebury_pair(tmp_path / "pair")
    capture = import_recording("middlebury-pair", tmp_path / "pair", tmp_path / "b", ImportOptions())
    depth = np.load(tmp_path / "b/S1/depth/0000.npy")
    Q = np.float32([[1, 0, 0, -150.5], [0, 1, 0, -118.25], [0, 0, 0, 400], [0, 0, 1 / 120, 6 / 120]])
    disparity = np.full(SIZE[::-1], 26.0, np.float32)
    np.testing.assert_allclose(depth[20:60, 30:90], cv2.reprojectImageTo3D(disparity, Q)[20:60, 30:90, 2], rtol=1e-6)
    assert np.isnan(depth[:20]).all()
    assert capture.sensors[0].depth is not None
    nearest, farthest = 400 * 120 / (40 + 6), 400 * 120 / (10 + 6)
    np.testing.assert_allclose(-capture.bounds[:, 2], [farthest * 1.02, nearest * 0.98])


def around() -> list[Camera]:
    return [
        Camera(LEFT.K, SIZE, look_at((1500 * np.sin(angle), 200.0, 1500 * np.cos(angle)), (0, 0, 0)))
        for angle in (0.0, 0.1, 0.5)
    ]


def strecha(folder: Path) -> None:
    for number, camera in enumerate(around()):
        R, centre = camera.rotation.T, camera.centre / 1000
        lines = [" ".join(map(repr, row)) for row in (*camera.K.tolist(), [0.0, 0, 0], *R.tolist(), centre.tolist())]
        pictures(folder, f"{number:04d}.png")
        (folder / f"{number:04d}.png.camera").write_text("\n".join([*lines, f"{SIZE[0]} {SIZE[1]}"]) + "\n")


def mvsnet(folder: Path) -> None:
    for number, camera in enumerate(around()):
        pictures(folder, f"images/{number:08d}.jpg")
        (folder / "cams").mkdir(exist_ok=True)
        pose = "\n".join(" ".join(map(repr, row)) for row in in_metres(camera.cam_from_world))
        K = "\n".join(" ".join(map(repr, row)) for row in camera.K.tolist())
        text = f"extrinsic\n{pose}\n\nintrinsic\n{K}\n\n1.0 0.005 192 2.0\n"
        (folder / f"cams/{number:08d}_cam.txt").write_text(text)
    (folder / "pair.txt").write_text("3\n0\n2 1 9.0 2 5.0\n")


def miv(folder: Path) -> None:
    """The axes of the set: x forwards, y to the left, z upwards."""
    to_miv = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    world = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # of the y-up world, as x, y, z of one with z up
    cameras = []
    for number, camera in enumerate(around()):
        turn = world @ camera.rotation.T @ to_miv.T
        cameras.append(
            {
                "Name": f"v{number}",
                "Position": (world @ camera.centre / 1000).tolist(),
                "Rotation": Rotation.from_matrix(turn).as_euler("ZYX", degrees=True).tolist(),
                "Projection": "Perspective",
                "Focal": [camera.K[0, 0], camera.K[1, 1]],
                "Principle_point": [camera.K[0, 2] + 0.5, camera.K[1, 2] + 0.5],
                "Resolution": list(SIZE),
                "Depth_range": [1.0, 2.0],
                "BitDepthColor": 10,
            }
        )
        pictures(folder, f"v{number}/0.png")
    cameras.append({**cameras[0], "Name": "viewport"})
    (folder / "A.json").write_text(json.dumps({"Version": "4.0", "Fps": 30, "cameras": cameras}))


@pytest.mark.parametrize(
    ("name", "write", "unit", "up"),
    [("strecha", strecha, None, "y"), ("mvsnet", mvsnet, 1000.0, "y"), ("miv", miv, None, None)],
)
@pytest.mark.filterwarnings("ignore:.*viewport")
def test_views_of_a_set_project_as_they_were_seen(
    tmp_path: Path, name: str, write: Callable[[Path], None], unit: float | None, up: str | None
) -> None:
    write(tmp_path / "source")
    assert find_format(tmp_path / "source") == name
    options = ImportOptions(bounds=BOUNDS, unit_mm=unit, pairs=[(0, 1)], up=up)
    capture = import_recording(name, tmp_path / "source", tmp_path / "out", options)
    world = POINTS if name != "miv" else POINTS @ np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]).T
    world = world if name != "miv" else world @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]).T  # z up to y up
    cameras = [side.camera for side in capture.sensors[0].cameras] + [shot.camera for shot in capture.held_out]
    assert len(cameras) == (2 if name == "miv" else 3)  # a folder of frames is no photograph
    for found, truth in zip(cameras, around(), strict=False):
        np.testing.assert_allclose(seen(found, world), seen(truth, POINTS), atol=1e-6)


def test_every_format_has_a_name_for_people() -> None:
    assert list(IMPORTED) == [AUTO, *(name for name in IMPORTED if name in FORMATS)]
    assert {*IMPORTED} == {AUTO, *FORMATS}


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("calibs.txt", "", r"nearest is middlebury-pair, which has calib\.txt: `im0\.png`"),
        ("calib.txt", "nothing", r"nearest is middlebury-pair, but calib\.txt is none of its files"),
        ("holiday.mp3", "", "as none of its files tells cameras\\. "),
        ("holiday.png", "", "as none of its files tells cameras; `reconstudy capture calibrate` measures them"),
        ("calibrationdata.tar.gz", "", r"but calibrationdata\.tar\.gz is an archive; unpack it, and name the folder"),
        ("house.psx", "", "but house.psx is Metashape's; export its cameras in COLMAP's format"),
        ("sfm_data.json", "{}", r"but sfm_data\.json is of a program whose cameras are not read; export them"),
        (
            "cameras.xml",
            '<document version="2.0.0">\n  <chunk label="1">',
            r"but cameras\.xml is Metashape's; export its",
        ),
        ("cameras.csv", "#cameras 2\n#name,x,y,alt,heading", r"but cameras\.csv is of a program whose cameras are not"),
        ("a.xml", '<?xml?><BlocksExchange version="3.2">', r"but a\.xml is of a program whose cameras are not read"),
        ("a.json", "[]", r"nearest is json, which has \*\.json"),
        ("calib.npz", "", r"but calib\.npz is Python's own; write the matrices as `opencv`"),
    ],
)
def test_a_source_of_no_known_format_is_told_the_nearest(
    tmp_path: Path, name: str, content: str, sentence: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(CaptureError, match=f"is in no format that is known.*{sentence}.*Known are middlebury, "):
        find_format(tmp_path)


def test_a_source_that_is_named_wrongly_is_told_what_it_looks_like(tmp_path: Path) -> None:
    kalibr(tmp_path / "kalibr")
    with pytest.raises(CaptureError, match=r"holds no COLMAP model.*the source looks like kalibr"):
        import_recording("colmap", tmp_path / "kalibr", tmp_path / "out", replace(OPTIONS, unit_mm=1.0))


def edited(path: Path, old: str, new: str) -> None:
    path.write_text(path.read_text().replace(old, new))


def one_camera_info(folder: Path) -> None:
    ros(folder)
    (folder / "right.yaml").unlink()


def no_baseline(folder: Path) -> None:
    ros(folder)
    (folder / "right.yaml").write_text((folder / "left.yaml").read_text())


def unnamed(folder: Path) -> None:
    ros_messages(folder)
    for path in folder.glob("*.yaml"):
        edited(path, "distortion_model: rational_polynomial", "distortion_model: ''")
        edited(path, "- 0\n- 0\n- 0\n- 0\n", "")


def kalibr_omni(folder: Path) -> None:
    kalibr(folder)
    edited(folder / "log-camchain.yaml", "pinhole", "omni")


def kalibr_fov(folder: Path) -> None:
    kalibr(folder)
    edited(folder / "log-camchain.yaml", "radtan", "fov")


def bombed(folder: Path) -> None:
    folder.mkdir()
    (folder / "camchain.yaml").write_text("cam0: &a [x, x]\ncam1: " + "[" * 5000)


def matlab_object(folder: Path) -> None:
    folder.mkdir()
    savemat(folder / "stereo.mat", {"stereoParams": np.zeros(3)})


def no_matlab(folder: Path) -> None:
    folder.mkdir()
    (folder / "stereo.mat").write_bytes(b"MATLAB 5.0" + bytes(200))


def crashing_matlab(folder: Path) -> None:
    """A matrix of 9 numbers of the kind 255, on which scipy's reader ends its process by a segmentation fault."""
    matlab(folder)
    content = (folder / "stereo.mat").read_bytes()
    (folder / "stereo.mat").write_bytes(content.replace(b"\x09\0\0\0H\0\0\0", b"\xff\0\0\0H\0\0\0", 1))


def too_new_matlab(folder: Path) -> None:
    matlab(folder)
    (folder / "stereo.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))


def other_resolution(folder: Path) -> None:
    mvsnet(folder)
    edited(folder / "cams/00000000_cam.txt", "158.5", "39.6")


def distorted(folder: Path) -> None:
    strecha(folder)
    edited(folder / "0000.png.camera", "0.0 0 0", "0.1 0 0")


def panorama(folder: Path) -> None:
    miv(folder)
    edited(folder / "A.json", "Perspective", "Equirectangular")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "write", "sentence"),
    [
        (
            "ros",
            one_camera_info,
            r"expected two files of camera_info, left\.yaml and right\.yaml, found 1 \(\w+\.yaml\)",
        ),
        ("ros", no_baseline, "nothing tells the baseline; calibrate them as a stereo pair"),
        ("ros", unnamed, "four distortion numbers in a column, without a name"),
        ("kalibr", kalibr_omni, "the camera model is omni, expected pinhole"),
        ("kalibr", kalibr_fov, "the camera model is fov, expected one of"),
        ("kalibr", bombed, "is not readable as YAML"),
        ("matlab", matlab_object, r"holds no struct with CameraParameters1 and CameraParameters2; write it by"),
        ("matlab", no_matlab, "is not readable as a file of MATLAB"),
        ("matlab", crashing_matlab, "is not readable as a file of MATLAB, damaged or cut off"),
        ("matlab", too_new_matlab, "is of MATLAB's version 7.3, which is not read; write it by"),
        ("mvsnet", other_resolution, "the cameras are of another resolution"),
        ("strecha", distorted, "has distortion, whose model the format does not tell"),
        ("miv", panorama, "its projection is Equirectangular, expected Perspective"),
    ],
)
@pytest.mark.filterwarnings("ignore::recon.runtime.notices.Notice")
def test_what_cannot_be_read_is_refused_by_name(
    tmp_path: Path, name: str, write: Callable[[Path], None], sentence: str
) -> None:
    write(tmp_path / "source")
    options = ImportOptions(bounds=BOUNDS, unit_mm=1000.0, pairs=[(0, 1)])
    with pytest.raises(CaptureError, match=sentence):
        import_recording(name, tmp_path / "source", tmp_path / "out", options)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "write", "file", "old", "new", "sentence"),
    [
        (
            "kalibr",
            kalibr,
            "log-camchain.yaml",
            "[380.0,",
            "[380000.0,",
            r"focal lengths 380000 and 405 px, expected n",
        ),
        ("kalibr", kalibr, "log-camchain.yaml", "[320, 240]", "[320, x]", r"cam0: 'x' stands where a count is expect"),
        ("kalibr", kalibr, "log-camchain.yaml", "[380.0, 405.0,", "[380.0,", r"cam0: not enough values, expected 4$"),
        ("ros", ros, "left.yaml", "rows: 3", "rows: 3}, data: [1", "is not readable as YAML"),
        ("euroc", euroc, "mav0/cam1/sensor.yaml", "data: [", "data: [1, ", "17 numbers stand where 4,4 are expected"),
        ("matlab", matlab_json, "stereo.json", "380.0", "abc", r"stereo\.json: is not readable as JSON"),
        ("middlebury-pair", middlebury_pair, "calib.txt", "vmax=40", "vmax=x", r"calib\.txt: 'x' stands where a numb"),
        ("kitti", kitti_odometry, "calib.txt", "P0: 400.0 ", "P0: ", r"11 numbers stand where 3,4 are expected"),
        ("strecha", strecha, "0000.png.camera", "320 240", "0 240", r"image size \(0, 240\) is not positive"),
        ("mvsnet", mvsnet, "cams/00000000_cam.txt", "380.0", "nan", "K holds values that are not finite"),
        ("miv", miv, "A.json", '"Focal": [380', '"Focal": [-380', r"camera 0: K = .* is not a camera matrix"),
    ],
)
def test_absurd_numbers_are_refused_in_words(
    tmp_path: Path, name: str, write: Callable[[Path], object], file: str, old: str, new: str, sentence: str
) -> None:
    write(tmp_path / "source")
    assert old in (tmp_path / "source" / file).read_text()
    edited(tmp_path / "source" / file, old, new)
    options = ImportOptions(bounds=BOUNDS, unit_mm=1000.0, pairs=[(0, 1)])
    with pytest.raises(CaptureError, match=sentence):
        import_recording(name, tmp_path / "source", tmp_path / "out", options)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "158.5, 121.25]",
            "4026.0, 121.25]",
            r"the principal point of left, \(4026, 121\.25\), is far from the middle",
        ),
        ("[-0.1, 0.05,", "[-0.1, 50.0,", r"the distortion of left is larger at the pictures' edges"),
        (", -0.149", ", -149.", r"its cameras are 1\.49\d*e\+05 mm apart; is the unit right\?"),
    ],
)
def test_what_a_slip_looks_like_is_told(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    kalibr(tmp_path / "source")
    path = tmp_path / "source/log-camchain.yaml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.warns(Notice, match=f"sensor S1: {sentence}"):
        import_recording("kalibr", tmp_path / "source", tmp_path / "out", OPTIONS)


def test_views_whose_names_hold_the_same_digits_are_all_kept(tmp_path: Path) -> None:
    strecha(tmp_path)
    for suffix in (".png", ".png.camera"):
        (tmp_path / f"0001{suffix}").rename(tmp_path / f"right_0000{suffix}")
    assert [view.name for view in read_strecha(tmp_path, METRE).views.values()] == [
        "0000.png",
        "0002.png",
        "right_0000.png",
    ]


def test_absent_pictures_of_a_set_are_named_and_raw_video_is_told_how_to_convert(tmp_path: Path) -> None:
    strecha(tmp_path / "a")
    (tmp_path / "a/0002.png").unlink()
    options = ImportOptions(bounds=BOUNDS, pairs=[(0, 1)])
    with pytest.warns(match=r"pictures that .* 0002\.png"):
        capture: Capture = import_recording(AUTO, tmp_path / "a", tmp_path / "out", options)
    assert len(capture.sensors) == 1
    miv(tmp_path / "b")
    (tmp_path / "b/viewport_4096x2048_yuv420p10le.yuv").touch()
    with pytest.raises(CaptureError, match="ffmpeg -f rawvideo -pix_fmt yuv420p10le -s 320x240 -r 30 "):
        import_recording(AUTO, tmp_path / "b", tmp_path / "again", options)


@pytest.mark.parametrize(
    ("write", "file", "change"),
    [
        (kalibr, "log-camchain.yaml", lambda text: "\ufeff" + text),
        (kalibr, "log-camchain.yaml", lambda text: "%YAML:1.0\n" + text),  # as programs write it that read by OpenCV
        (kalibr, "log-camchain.yaml", lambda text: text + "imu0: {update_rate: 200.0}\n"),
        (kalibr, "log-camchain.yaml", lambda text: text.replace("\n", "\r\n")),
        (kitti_odometry, "calib.txt", lambda text: text.replace(": ", ":\t")),
        (kitti_odometry, "calib.txt", lambda text: "# of a drive\n" + text.replace("\n", "  # rectified\n", 1)),
        (middlebury_pair, "calib.txt", lambda text: text.replace("vmin=10\n", "")),
        (middlebury_pair, "calib.txt", lambda text: text.replace("vmax=40\n", "")),
    ],
)
def test_other_spellings_of_a_calibration_are_read_alike(
    tmp_path: Path, write: Callable[[Path], list[Camera]], file: str, change: Callable[[str], str]
) -> None:
    write(tmp_path / "source")
    path = tmp_path / "source" / file
    path.write_bytes(change(path.read_text()).encode())
    capture = import_recording(AUTO, tmp_path / "source", tmp_path / "out", OPTIONS)
    left, right = write(tmp_path / "again")
    relative = right.cam_from_world @ np.linalg.inv(left.cam_from_world)
    first, second = (stream.camera for stream in capture.sensors[0].cameras)
    np.testing.assert_allclose(second.cam_from_world @ np.linalg.inv(first.cam_from_world), relative, atol=1e-9)


def test_lengths_of_miv_that_are_not_metres_are_a_question(tmp_path: Path) -> None:
    miv(tmp_path / "source")
    edited(tmp_path / "source/A.json", '"Fps"', '"lengthsInMeters": false, "Fps"')
    options = ImportOptions(bounds=BOUNDS, pairs=[(0, 1)])
    with pytest.raises(CaptureError, match="its lengths are not in metres; give the unit's length by --units"):
        import_recording("miv", tmp_path / "source", tmp_path / "out", options)


def test_a_pair_of_kittis_stereo_benchmark_comes_with_its_truth(tmp_path: Path) -> None:
    (tmp_path / "training/calib_cam_to_cam").mkdir(parents=True)
    lines = [f"S_rect_0{n}: {SIZE[0]} {SIZE[1]}\nP_rect_0{n}: {kitti_projection(PAIR[n % 2])}" for n in (2, 3)]
    path = tmp_path / "training/calib_cam_to_cam/000010.txt"
    path.write_text("calib_time: x\n" + "\n".join(lines) + "\n")
    pictures(tmp_path / "training", "image_2/000010_10.png", "image_3/000010_10.png", "image_2/000010_11.png")
    truth = np.zeros(SIZE[::-1], np.uint16)
    truth[100:120] = 32 * 256
    (tmp_path / "training/disp_occ_0").mkdir()
    cv2.imwrite(str(tmp_path / "training/disp_occ_0/000010_10.png"), truth)
    assert find_format(path) == "kitti"
    capture = import_recording(AUTO, path, tmp_path / "out", OPTIONS)
    assert capture.n_frames == 1
    depth = np.load(tmp_path / "out/S1/depth/0000.npy")
    np.testing.assert_allclose(depth[100:120], 400 * 120 / 32, rtol=1e-6)
    assert np.isnan(depth[:100]).all()


def with_fisheye(path: Path, lens: list[float]) -> None:
    """Name the lenses of a file equidistant, wherever it has some."""

    def changed(entry: object) -> object:
        if not isinstance(entry, dict):
            return entry
        entry = {key: changed(value) for key, value in entry.items()}
        if "distortion_model" in entry:
            key = next(key for key in entry if key in ("distortion_coeffs", "distortion_coefficients", "d"))
            numbers = matrix(np.array(lens), 1) if isinstance(entry[key], dict) else lens
            entry |= {"distortion_model": "equidistant", key: numbers}
        return entry

    dump(path, changed(next(yaml.safe_load_all(path.read_text()))))


@pytest.mark.parametrize(
    ("read", "write"), [(read_ros, ros), (read_ros, ros_messages), (read_kalibr, kalibr), (read_euroc, euroc)]
)
def test_a_fisheye_of_robots_projects_as_opencvs_does(
    tmp_path: Path, read: Callable[[Path, float], Placed], write: Callable[[Path], list[Camera]]
) -> None:
    lens = [-0.03, 0.012, -0.004, 0.001]
    cameras = write(tmp_path)
    for path in tmp_path.rglob("*.yaml"):
        with_fisheye(path, lens)
    views = list(read(tmp_path, 1000.0).views.values())
    first = views[0].camera.cam_from_world
    for view, camera, pose in zip(views, cameras, (np.eye(4), RELATIVE), strict=True):
        assert isinstance(view.camera, FisheyeCamera)
        shown = [
            cv2.fisheye.projectPoints(AHEAD[:, None], cv2.Rodrigues(place[:3, :3])[0], place[:3, 3], K, np.array(dist))
            for place, K, dist in (
                (view.camera.cam_from_world @ np.linalg.inv(first), view.camera.K, view.camera.lens),
                (pose, camera.K, lens),
            )
        ]
        np.testing.assert_allclose(shown[0][0], shown[1][0], atol=1e-6)


def test_a_fisheye_of_kalibr_is_undistorted(tmp_path: Path) -> None:
    kalibr(tmp_path / "source")
    path = tmp_path / "source/log-camchain.yaml"
    chain, lens = yaml.safe_load(path.read_text()), [-0.3, 0.12, -0.04, 0.01]
    for camera in chain.values():
        camera |= {"distortion_model": "equidistant", "distortion_coeffs": lens}
    dump(path, chain)
    checks = np.kron(np.indices((24, 32)).sum(axis=0) % 2, np.ones((10, 10))).astype(np.uint8)[..., None] * [
        200,
        200,
        200,
    ]
    checks = checks.astype(np.uint8)
    cv2.imwrite(str(next((tmp_path / "source/cam0").iterdir())), checks)
    capture = import_recording(AUTO, tmp_path / "source", tmp_path / "out", OPTIONS)
    left = capture.sensors[0].left.camera
    assert not left.dist.any()
    np.testing.assert_allclose(left.K, LEFT.K)
    expected = cv2.fisheye.undistortImage(checks, LEFT.K, np.array(lens), Knew=LEFT.K)
    written = cv2.imread(str(tmp_path / "out/S1/left/0000.png"))
    assert np.median(np.abs(written.astype(int) - expected)) <= 5  # by another interpolation
    assert np.abs(written.astype(int) - checks).mean() > 20


def test_eth3d_is_a_model_of_colmap_in_metres(tmp_path: Path) -> None:
    model = colmap_model(tmp_path / "source/dslr_calibration_undistorted")
    (model / "images").rename(tmp_path / "source/images")
    assert find_format(tmp_path / "source") == "eth3d"
    options = replace(OPTIONS, pairs=[(11, 12)])
    capture = import_recording(AUTO, tmp_path / "source", tmp_path / "out", options)
    for stream, camera in zip(capture.sensors[0].cameras, (LEFT, RIGHT), strict=True):
        np.testing.assert_allclose(seen(stream.camera, POINTS), seen(camera, POINTS), atol=1e-6)
    assert len(capture.held_out) == 2


def test_a_camchain_may_have_any_name_beside_other_yaml(tmp_path: Path) -> None:
    kalibr(tmp_path / "source")
    next((tmp_path / "source").glob("*camchain*")).rename(tmp_path / "source/rig.yaml")
    (tmp_path / "source/april.yaml").write_text("target_type: aprilgrid\n")
    assert len(import_recording(AUTO, tmp_path / "source", tmp_path / "out", OPTIONS).sensors) == 1


@pytest.mark.parametrize("name", ["kalibr", "matlab", "miv", "middlebury-pair", "kitti"])
def test_a_folder_without_a_calibration_is_told_so(tmp_path: Path, name: str) -> None:
    (tmp_path / "source").mkdir()
    with pytest.raises(CaptureError, match="source: holds no "):
        import_recording(name, tmp_path / "source", tmp_path / "out", OPTIONS)


def test_which_of_two_calibrations_is_meant_is_asked(tmp_path: Path) -> None:
    matlab(tmp_path / "matlab")
    savemat(tmp_path / "matlab/earlier.mat", {"stereoParams": matlab_struct(True)})
    kalibr(tmp_path / "kalibr")
    text = (tmp_path / "kalibr/log-camchain.yaml").read_text()
    (tmp_path / "kalibr/camchain-imucam.yaml").write_text(text + "  timeshift_cam_imu: 0.002\n")
    assert len(import_recording(AUTO, tmp_path / "kalibr", tmp_path / "same", OPTIONS).sensors) == 1
    (tmp_path / "kalibr/later-camchain.yaml").write_text(text.replace("radtan", "equidistant"))
    (tmp_path / "meshroom").mkdir()
    for name in ("first.sfm", "second.sfm"):
        (tmp_path / "meshroom" / name).write_text("{}")
    for name, files in (
        ("matlab", "holds 2 calibrations that differ, earlier.mat, stereo.mat; name the one"),
        ("kalibr", "holds 3 calibrations that differ, camchain-imucam.yaml, later-camchain.yaml, log-camchain.yaml"),
        ("meshroom", "holds first.sfm, second.sfm; name the one to read"),
    ):
        with pytest.raises(CaptureError, match=files):
            import_recording(name, tmp_path / name, tmp_path / "out", replace(OPTIONS, unit_mm=1.0))
    assert import_recording("matlab", tmp_path / "matlab/stereo.mat", tmp_path / "out", OPTIONS).sensors


@pytest.mark.filterwarnings("ignore:.*viewport")
def test_other_json_beside_a_calibration_is_not_taken_for_it(tmp_path: Path) -> None:
    miv(tmp_path / "source")
    (tmp_path / "source/0_about.json").write_text('{"title": "a scene"}')
    options = replace(OPTIONS, bounds=None, pairs=[(0, 1)])
    assert import_recording(AUTO, tmp_path / "source", tmp_path / "out", options).sensors
