"""Outlines follow the masks: what lies beside one goes, what several sensors measured stays, and rims are smooth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from recon.geometry.mesh import Cloud, Mesh, merge_meshes
from recon.geometry.rig import Camera, look_at
from recon.surface.components import component_labels
from recon.surface.holes import rim_edges
from recon.surface.outlines import (
    Sight,
    believed,
    drop_flaps,
    drop_outside,
    follow_masks,
    silhouette_of,
    with_outlines,
)
from recon.surface.rims import cut, smooth_rims

SIZE = (200, 160)
K = np.array([[400.0, 0, 100], [0, 400.0, 80], [0, 0, 1]])
REACH = 10.0  # mm; five pixels, as a pixel is 2.5 mm wide where the object is
CENTRES = {"S1": (-400, 0, 900), "S2": (0, 0, 1000), "S3": (400, 0, 900)}


def camera_of(sensor_id: str, dist: list[float] | None = None) -> Camera:
    return Camera(K, SIZE, look_at(CENTRES[sensor_id], (0, 0, 0)), np.array(dist or []))


def grid(half: float = 150.0, step: float = 5.0) -> Mesh:
    """A flat square in the plane z = 0, its normals towards the sensors."""
    ticks = np.arange(-half, half + step / 2, step)
    x, y = np.meshgrid(ticks, ticks)
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = (np.arange(len(ticks) - 1)[:, None] * len(ticks) + np.arange(len(ticks) - 1)).ravel()
    up = corner + len(ticks)
    faces = np.concatenate([np.column_stack([corner, corner + 1, up + 1]), np.column_stack([corner, up + 1, up])])
    return Mesh(vertices, faces, np.tile([0.0, 0, 1], (x.size, 1)), np.full((x.size, 3), 128, np.uint8))


def disc(points: np.ndarray, radius: float = 100.0) -> np.ndarray:
    return np.hypot(points[:, 0], points[:, 1]) <= radius


def cloud_of(points: np.ndarray) -> Cloud:
    return Cloud(points, np.tile([0.0, 0, 1], (len(points), 1)), np.full((len(points), 3), 128, np.uint8))


def mask_of(camera: Camera, radius: float = 100.0) -> np.ndarray:
    """What a camera without distortion sees of the disc around the origin in the plane z = 0."""
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(K).T @ camera.rotation
    places = camera.centre - rays * (camera.centre[2] / rays[..., 2])[..., None]
    return np.hypot(places[..., 0], places[..., 1]) <= radius


def sights(*names: str, without: dict[str, np.ndarray] | None = None) -> list[Sight]:
    """Sensors that measured the disc and have its masks, but for the parts `without`."""
    seen = grid(step=4.0).vertices
    made = []
    for name in names:
        mask = mask_of(camera_of(name))
        if without and name in without:
            mask &= ~without[name]
        made.append(Sight(name, (silhouette_of(mask, camera_of(name)),), cloud_of(seen[disc(seen)])))
    return made


def area(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(np.float64) for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def rim_length(mesh: Mesh) -> float:
    ends = mesh.vertices[rim_edges(mesh.faces)].astype(np.float64)
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).sum())


def ragged(radius: float) -> Mesh:
    """A disc of whole triangles, with the teeth that marching cubes leaves at an open rim."""
    mesh = grid()
    return drop_flaps(
        Mesh(
            mesh.vertices, mesh.faces[disc(mesh.vertices, radius)[mesh.faces].all(axis=1)], mesh.normals, mesh.colours
        ),
        [],
        REACH,
    )


def test_margins_are_distances_to_the_mask_in_mm() -> None:
    (front,) = sights("S2")
    along = np.column_stack([np.arange(-140.0, 141, 20), np.zeros(15), np.zeros(15)])
    assert front.margins(along) == pytest.approx(100 - np.abs(along[:, 0]), abs=3.5)  # a pixel is 2.5 mm
    behind = np.array([[0.0, 0, 2000], [5000.0, 0, 0]])  # beyond the picture nothing is known
    assert (front.margins(behind) > 1000).all()


@pytest.mark.parametrize("stretch", [0.5, 2.0])
def test_margins_are_the_same_for_pixels_that_are_not_square(stretch: float) -> None:
    width, height = SIZE[0], round(stretch * SIZE[1])
    stretched = Camera(K * [[1], [stretch], [1]], (width, height), camera_of("S2").cam_from_world)
    rows, columns = np.mgrid[:height, :width]
    x, y = (columns - 100) / 400, (rows - 80 * stretch) / (400 * stretch)
    silhouette = silhouette_of(np.hypot(x, y) <= 0.1, stretched)  # 100 mm in the plane z = 0
    for direction in ([1.0, 0, 0], [0, 1.0, 0], [0.6, 0.8, 0]):
        radii = np.array([60.0, 90, 110, 140])
        places = radii[:, None] * direction
        assert silhouette.margins(places) == pytest.approx(100 - radii, abs=5)
        assert silhouette.slopes(places) == pytest.approx(np.tile(-np.array(direction), (4, 1)), abs=0.25)


def test_a_mask_of_a_distorted_picture_is_straightened() -> None:
    bent, straight = camera_of("S2", [-0.3, 0, 0, 0]), camera_of("S2")
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    x, y = (columns - 100) / 400, (rows - 80) / 400
    recorded = np.hypot(x, y) <= 0.16 * (1 - 0.3 * 0.16**2)  # where the lens puts a disc of radius 0.16
    distance = silhouette_of(recorded, bent).distance
    assert distance[80, 100] == pytest.approx(silhouette_of(np.hypot(x, y) <= 0.16, straight).distance[80, 100], abs=1)


def test_a_cut_lies_where_the_field_is_zero_and_keeps_the_rest() -> None:
    mesh = grid()
    half = cut(mesh, mesh.vertices[:, 0] + 1.7)
    assert half.vertices[half.faces][..., 0].min() == pytest.approx(-1.7, abs=1e-4)
    assert area(half) == pytest.approx(300 * 151.7, rel=1e-5)
    turned = np.cross(*(half.vertices[half.faces[:, c]] - half.vertices[half.faces[:, 0]] for c in (1, 2)))
    assert (turned[:, 2] >= 0).all()
    assert len(np.unique(component_labels(half.faces, len(half.vertices))[half.faces])) == 1


def test_a_wide_surface_ends_at_the_masks_to_a_fraction_of_a_voxel() -> None:
    everyone = sights("S1", "S2", "S3")
    made = follow_masks(ragged(125), everyone, REACH)
    radius = np.hypot(*made.vertices[np.unique(rim_edges(made.faces)), :2].T)
    assert np.percentile(np.abs(radius - 100), 95) < 2.5  # a pixel
    assert area(made) == pytest.approx(np.pi * 100**2, rel=0.02)
    assert rim_length(made) < 1.05 * 2 * np.pi * 100


def test_a_surface_rough_in_depth_is_not_cut_into_teeth() -> None:
    wide = ragged(125)
    x, y = wide.vertices[:, :2].T
    rough = replace(wide, vertices=np.column_stack([x, y, 15 * np.sin(x / 6) * np.sin(y / 6)]).astype(np.float32))
    everyone = sights("S1", "S3")
    made = follow_masks(rough, everyone, REACH)
    flat = replace(made, vertices=made.vertices * np.float32([1, 1, 0]))
    assert rim_length(flat) < 1.03 * 2 * np.pi * 100
    assert area(flat) == pytest.approx(np.pi * 100**2, rel=0.03)
    for sight in everyone:
        assert sight.margins(made.vertices).min() > -0.5 * REACH


def test_rims_become_smooth_without_shrinking() -> None:
    before = ragged(100)
    after = smooth_rims(before)
    assert rim_length(after) < 0.9 * rim_length(before)
    assert area(after) == pytest.approx(area(before), rel=0.01)
    assert np.abs(after.vertices[:, 2]).max() == 0


def test_a_thin_part_inside_the_masks_survives() -> None:
    mesh = grid()
    finger = mesh.faces[(np.abs(mesh.vertices[:, 0]) <= 2.5 + 5)[mesh.faces].all(axis=1)]
    thin = drop_flaps(Mesh(mesh.vertices, finger, mesh.normals, mesh.colours), [], REACH)
    made = follow_masks(thin, sights("S1", "S2", "S3"), REACH)
    assert made.vertices[:, 1].max() > 95
    assert made.vertices[:, 1].min() < -95
    assert np.ptp(made.vertices[:, 0]) > 8


def test_points_beside_a_mask_are_left_out() -> None:
    front, side = sights("S2", "S1")
    stray = np.array([[0.0, 150, 0], [0, 0, 300], [0, 0, 20]])  # beside both masks, beside one of them, inside
    everyone = [Sight("S2", front.silhouettes, cloud_of(np.concatenate([front.cloud.points, stray]))), side]
    kept = drop_outside(everyone, REACH)[0].points
    assert len(kept) == len(front.cloud) + 1
    assert kept[-1].tolist() == [0, 0, 20]


def test_a_mask_that_cuts_a_hand_does_not_cut_what_two_others_measured() -> None:
    hand = np.zeros(SIZE[::-1], dtype=bool)
    hand[:, 125:] = True
    broken = sights("S1", "S2", "S3", without={"S2": hand})
    made = follow_masks(ragged(125), broken, REACH)
    assert made.vertices[:, 0].max() > 95
    alone = follow_masks(ragged(125), sights("S1", "S2", without={"S2": hand}), REACH)
    assert alone.vertices[:, 0].max() < 70  # one sensor against another: the mask decides


def test_masks_that_refuse_what_all_others_measured_cut_nothing_and_are_named() -> None:
    turned = np.zeros(SIZE[::-1], dtype=bool)
    turned[:, 85:] = True  # as by a camera that stands elsewhere
    kept, reasons = believed(sights("S1", "S2", without={"S2": turned}), REACH)
    assert [sight.silhouettes == () for sight in kept] == [False, True]
    assert len(reasons) == 1
    assert "sensor S2 leave out 6" in reasons[0]
    assert "capture check" in reasons[0]
    assert believed(sights("S1", "S2", "S3"), REACH)[1] == []


def test_what_a_sensor_without_masks_measured_speaks_against_no_mask() -> None:
    wall = Sight("S3", (), cloud_of(grid(half=400).vertices))
    kept, reasons = believed([*sights("S1", "S2"), wall], REACH)
    assert all(sight.silhouettes for sight in kept[:2])
    assert reasons == []


def test_a_flap_goes_and_a_hand_stays() -> None:
    body, hand = grid(half=150), grid(half=15)
    place = np.float32([0, 0, 60])
    part = Mesh(hand.vertices + place, hand.faces, hand.normals, hand.colours)
    points = np.concatenate([body.vertices, part.vertices])
    both = [Sight(name, (), cloud_of(points)) for name in ("S1", "S2")]
    single = [both[0], Sight("S2", (), cloud_of(body.vertices))]
    whole = merge_meshes([body, part])
    assert len(drop_flaps(whole, both, 5.0).faces) == len(whole.faces)
    assert len(drop_flaps(whole, single, 5.0).faces) == len(body.faces)


def test_sensors_without_masks_change_no_place_of_the_surface() -> None:
    mesh = grid()
    blind = [Sight("S1", (), cloud_of(mesh.vertices)), Sight("S2", (), cloud_of(mesh.vertices))]
    made, reasons = with_outlines(blind, REACH, lambda clouds: (mesh, [f"{len(clouds[0])} points"]))
    assert area(made) == pytest.approx(area(mesh), rel=0.01)
    assert reasons == [f"{len(mesh.vertices)} points"]
