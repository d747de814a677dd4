"""Recordings that stand in COLMAP's world."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recon.capture.format import CaptureError, read_frame, read_held_out
from recon.capture.importing.colmap import import_colmap
from recon.capture.importing.colmap_model import read_model
from recon.capture.importing.lenses import FisheyeCamera
from recon.capture.importing.sources import ImportOptions
from recon.runtime.notices import Notice
from tests.recon.capture.importing.labelled_recording import BOUNDS, POINTS, RIG, colmap_model, seen, write_picture


def test_colmap_bounds_hold_its_points_and_unused_images_are_held_out(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source", unit_mm=250.0)
    capture = import_colmap(source, tmp_path / "out", [(11, 12)], ImportOptions(unit_mm=250.0))
    assert (capture.bounds[0] <= POINTS.min(axis=0)).all()
    assert (capture.bounds[1] >= POINTS.max(axis=0)).all()
    assert [shot.image for shot in capture.held_out] == ["held_out/S2_left.png", "held_out/S2_right.png"]
    np.testing.assert_allclose(seen(capture.held_out[0].camera, POINTS), seen(RIG.sensors[1].left, POINTS), atol=1e-6)


def test_the_axis_that_points_upwards_becomes_y(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    for up, turned in (("z", POINTS[:, [0, 2, 1]] * (1, 1, -1)), ("-y", POINTS * (1, -1, -1))):
        out = tmp_path / up
        capture = import_colmap(source, out, [(11, 12)], ImportOptions(unit_mm=1000.0, up=up))
        np.testing.assert_allclose(
            seen(capture.sensors[0].left.camera, turned), seen(RIG.sensors[0].left, POINTS), atol=1e-6
        )
        assert (capture.bounds[0] <= turned.min(axis=0)).all()


def test_what_is_wrong_in_a_colmap_model_is_named(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    with pytest.raises(CaptureError, match="scale is arbitrary"):
        import_colmap(source, tmp_path / "out", [(11, 12)])
    with pytest.raises(CaptureError, match=r": no pairs are given, expected LEFT-RIGHT .* out of: 11 S1_left\.png"):
        import_colmap(source, tmp_path / "out", None, ImportOptions(unit_mm=1.0))
    colmap_model(source, model="THIN_PRISM_FISHEYE")
    with pytest.raises(CaptureError, match=r"cameras.txt, line 2: camera model THIN_PRISM_FISHEYE"):
        import_colmap(source, tmp_path / "out", [(11, 12)], ImportOptions(unit_mm=1.0))


def test_empty_lines_around_the_images_of_a_text_model_say_nothing(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    expected = read_model(source).images.keys()
    table = source / "images.txt"
    table.write_text("\n" + table.read_text() + "\n\n")
    assert read_model(source).images.keys() == expected


def test_images_of_a_text_model_whose_points_were_left_out_are_all_kept(tmp_path: Path) -> None:
    source = colmap_model(tmp_path)
    path = source / "images.txt"
    path.write_text(path.read_text().replace("1.0 2.0 -1\n", ""))
    assert [image.name for image in read_model(source).images.values()] == [
        f"{sensor}_{side}.png" for sensor in ("S1", "S2") for side in ("left", "right")
    ]


def test_held_out_photographs_of_one_name_in_several_folders_stay_apart(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    table = (source / "images.txt").read_text()
    for name in ("S2_left", "S2_right"):
        (source / "images" / name).mkdir()
        (source / "images" / f"{name}.png").rename(source / "images" / name / "0001.png")
        table = table.replace(f"{name}.png", f"{name}/0001.png")
    (source / "images.txt").write_text(table)
    made = import_colmap(source, tmp_path / "out", [(11, 12)], ImportOptions(unit_mm=1000.0, bounds=BOUNDS))
    photographs = [read_held_out(made, photograph) for photograph in made.held_out]
    assert [picture[0, 0, 0] for picture in photographs] == [150, 200]  # as colmap_model paints S2's


def test_frames_beside_the_photograph_that_placed_a_camera_are_taken_instead_of_it(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "colmap")
    for image in list((source / "images").iterdir()):
        for frame in range(3):
            write_picture(image.with_suffix("") / f"{frame}.png", 10 + frame)
    options = ImportOptions(unit_mm=1000.0, bounds=BOUNDS)
    capture = import_colmap(source, tmp_path / "out", [(11, 12), (13, 14)], options)
    assert capture.n_frames == 3
    assert read_frame(capture, "S2", 2)[0][0, 0, 0] == 12


def test_an_equidistant_fisheye_without_distortion_is_undistorted(tmp_path: Path) -> None:
    """The models of COLMAP 4: (f, cx, cy) and (fx, fy, cx, cy), r = f theta."""
    source = colmap_model(tmp_path / "source")
    (source / "cameras.txt").write_text(
        "".join(f"{n} SIMPLE_FISHEYE 320 240 210 160 120\n" for n in (1, 2)) + "3 FISHEYE 320 240 210 208 160 120\n"
        "4 FISHEYE 320 240 210 208 160 120\n"
    )
    model = read_model(source)
    for number, fy in ((1, 210.0), (3, 208.0)):
        camera = model.cameras[number]
        assert isinstance(camera, FisheyeCamera)
        assert not camera.lens.any()
        np.testing.assert_array_equal(camera.K, [[210, 0, 159.5], [0, fy, 119.5], [0, 0, 1]])


def test_masks_that_are_left_out_are_told_and_either_name_is_taken(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    options = ImportOptions(unit_mm=1000.0)
    write_picture(source / "masks/other.png", 255)
    with pytest.warns(Notice, match="masks: holds no mask of an image's name, such as NAME.jpg.png"):
        import_colmap(source, tmp_path / "none", [(11, 12)], options)
    write_picture(source / "masks/S1_left.png", 255)
    with pytest.warns(Notice, match="sensor S1: its masks are left out, as not each camera has one picture and its"):
        import_colmap(source, tmp_path / "one", [(11, 12)], options)
    write_picture(source / "masks/S1_right.png.png", 255)
    assert import_colmap(source, tmp_path / "both", [(11, 12)], options).sensors[0].mask is not None


def test_of_several_models_the_others_are_named(tmp_path: Path) -> None:
    options = ImportOptions(unit_mm=1000.0)
    for number in (0, 1):
        colmap_model(tmp_path / f"source/sparse/{number}")
    (tmp_path / "source/sparse/0/images").rename(tmp_path / "source/images")
    with pytest.warns(Notice, match="sparse/0: is one of several models, and read alone; what only sparse/1 shows"):
        import_colmap(tmp_path / "source", tmp_path / "out", [(11, 12)], options)
    import_colmap(tmp_path / "source/sparse/1", tmp_path / "second", [(11, 12)], options)  # which warns of nothing
