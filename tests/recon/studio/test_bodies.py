"""The studio's bodies: closed meshes on their surface, bones that reach where they are asked to, scenes that loop."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from recon.studio.actors.anatomy import Build, person_parts
from recon.studio.actors.implicit import Part, body_mesh, distance, part_table, split_long_edges
from recon.studio.actors.person import RestBody, fold_depths, rest_body
from recon.studio.actors.skeleton import (
    BONES,
    MAX_WRIST_BEND,
    PALM,
    REST,
    Controls,
    pose,
    rotation,
    skin,
    vertex_normals,
)
from recon.studio.light.appearance import NAILS
from recon.studio.light.looks import look_row, noise_volume
from recon.studio.objects import ball, box
from recon.studio.scenes import SCENES
from recon.studio.stage import Stage

Faces = NDArray[np.int32]


@pytest.fixture(scope="module")
def person() -> RestBody:
    look = look_row(SCENES["standing"](np.zeros(3)).actors[0].look)
    return rest_body(person_parts(Build()), look, cell=13.0, noise=noise_volume(np.random.default_rng(0)))


def is_closed(faces: Faces) -> bool:
    """Every edge is walked once in each direction."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    forth, back = edges[:, 0] * 10**7 + edges[:, 1], edges[:, 1] * 10**7 + edges[:, 0]
    return len(np.unique(forth)) == len(forth) and np.array_equal(np.sort(forth), np.sort(back))


def volume(vertices: NDArray[np.float64], faces: Faces) -> float:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def test_a_person_is_closed_and_faces_outwards(person: RestBody) -> None:
    assert is_closed(person.faces)
    litres = volume(person.vertices, person.faces) / 1e6
    assert 60 < litres < 110  # with clothes


@pytest.mark.slow
def test_nothing_of_a_person_is_webbed_or_loose(person: RestBody) -> None:
    edges = np.sort(np.concatenate([person.faces[:, [0, 1]], person.faces[:, [1, 2]], person.faces[:, [2, 0]]]), axis=1)
    n_edges = len(np.unique(edges, axis=0))
    assert len(person.vertices) - n_edges + len(person.faces) == 2  # one piece without a handle: fingers, ears, chin
    links = coo_array((np.ones(len(edges)), edges.T), shape=(len(person.vertices),) * 2)
    assert connected_components(links)[0] == 1


def test_nails_lie_on_the_fingers() -> None:
    table = part_table(person_parts(Build()))
    assert np.abs(distance(table, np.array(NAILS))).max() < 0.3
    assert np.abs(distance(table, np.array(NAILS) * (-1, 1, 1))).max() < 0.3


def test_a_bent_elbow_folds_its_sleeve_and_nothing_else(person: RestBody) -> None:
    straight = np.tile(np.eye(4)[:3], (len(BONES), 1, 1))
    bent = straight.copy()
    bent[[BONES.index(bone) for bone in ("forearm_l", "hand_l", "fingers_l", "tips_l")], :, :3] = rotation((0, 0, 80))
    moved = np.abs(fold_depths(person, bent) - fold_depths(person, straight))
    assert moved.max() > 4.0
    from_elbow = np.linalg.norm(person.places - REST["forearm_l"], axis=1)
    assert moved[from_elbow < 90].mean() > 1.0
    assert moved[from_elbow > 240].max() < 0.1


def test_curled_fingers_approach_the_palm() -> None:
    hand = BONES.index("hand_l")
    heights = []
    for curl in (0.0, 15.0, 30.0):
        transforms = pose(Controls(curl={"l": curl}))
        tip = transforms[BONES.index("tips_l")] @ (655.0, 866.0, 0.0, 1.0)
        heights.append(PALM["l"] @ transforms[hand, :, :3].T @ (tip - transforms[hand, :, 3]))
    assert heights[0] + 15 < heights[1] < heights[2] - 15


@pytest.mark.parametrize(("asked", "is_reached"), [((0.0, 0.0, 1.0), True), ((0.0, 1.0, 0.0), False)])
def test_a_hand_points_where_it_is_asked_to_as_far_as_a_wrist_bends(
    asked: tuple[float, float, float], *, is_reached: bool
) -> None:
    turns = pose(Controls(hands={"l": (150.0, 1150.0, 320.0)}, pointing={"l": asked}))[:, :, :3]
    forearm, hand = (
        turns[BONES.index(bone)] @ (REST["hand_l"] - REST["forearm_l"]) for bone in ("forearm_l", "hand_l")
    )
    off, bent = (np.arccos(hand @ b / np.linalg.norm(hand) / np.linalg.norm(b)) for b in (asked, forearm))
    assert off == pytest.approx(0.0, abs=1e-6) if is_reached else bent == pytest.approx(MAX_WRIST_BEND)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "phases"), [("ball", np.arange(0.0, 0.56, 0.05)), ("box", np.arange(0.0, 1.0, 0.1))])
def test_hands_hold_what_they_carry_and_do_not_enter_it(name: str, phases: NDArray[np.float64]) -> None:
    scene = SCENES[name](np.zeros(3))
    noise = noise_volume(np.random.default_rng(0))
    stage = Stage(scene, cell=13.0, noise=noise, towards_key=np.array([0.0, 1.0, 1.0]))
    (actor,), (prop,) = scene.actors, scene.props
    look = look_row(actor.look)
    bones = rest_body(person_parts(actor.build), look, cell=13.0, noise=noise).bones[:, 0]
    for phase in phases:
        (placed,) = scene.moment(phase).poses
        seen = (stage.at(phase).vertices[: len(bones)] - placed[:3, 3]) @ placed[:3, :3]
        if name == "ball":
            outside = np.linalg.norm(seen, axis=1) - prop.size[0]
        else:
            beside = np.abs(seen) - np.array(prop.size) / 2
            outside = np.linalg.norm(np.maximum(beside, 0.0), axis=1) + np.minimum(beside.max(axis=1), 0.0)
        assert outside.min() > -6.0, phase  # mm, as skin gives way
        for side in "lr":
            hand = np.isin(bones, [BONES.index(f"{part}_{side}") for part in ("hand", "fingers", "tips")])
            assert outside[hand].min() < 3.0, (phase, side)


def test_a_person_is_as_tall_as_the_rest_pose_says(person: RestBody) -> None:
    assert np.ptp(person.vertices[:, 1]) == pytest.approx(1790, abs=25)


def test_vertices_lie_on_the_level_set() -> None:
    table = part_table(
        [Part("head", (0, 0, 0), None, (60, 80, 50)), Part("head", (40, 30, 0), (120, 60, 10), (30, 20))]
    )
    vertices, faces = body_mesh(table, 9.0, lambda places: np.full(len(places), 8.0))
    assert is_closed(faces)
    assert np.abs(distance(table, vertices)).max() < 0.02


def test_one_round_part_becomes_a_ball() -> None:
    table = part_table([Part("head", (5, -3, 8), None, (70, 70, 70))])
    vertices, faces = body_mesh(table, 10.0, lambda places: np.full(len(places), 99.0))
    np.testing.assert_allclose(np.linalg.norm(vertices - (5, -3, 8), axis=1), 70, atol=0.01)
    assert volume(vertices, faces) == pytest.approx(4 / 3 * np.pi * 70**3, rel=0.02)


def test_a_carved_part_is_taken_away() -> None:
    table = part_table(
        [Part("head", (0, 0, 0), None, (50, 50, 50)), Part("head", (0, 0, 50), None, (20,) * 3, 5, carve=True)]
    )
    inside, carved = distance(table, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 40.0]]))
    assert inside < 0 < carved


@given(seed=st.integers(0, 1000), longest=st.floats(0.2, 2.0))
@settings(max_examples=25, deadline=None)
def test_splitting_edges_keeps_a_mesh_closed_and_its_volume(seed: int, longest: float) -> None:
    vertices, faces = box((3.0, 2.0, 1.0), 5.0)
    merged, index = np.unique(vertices, axis=0, return_inverse=True)
    limits = np.random.default_rng(seed)
    split, pieces = split_long_edges(
        merged, index[faces].astype(np.int32), lambda p: longest * (1 + limits.random(len(p)))
    )
    assert is_closed(pieces)
    assert volume(split, pieces) == pytest.approx(6.0)


def test_a_ball_is_closed_and_round() -> None:
    vertices, faces = ball(150.0, 6.0)
    assert is_closed(faces)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 150.0)
    edges = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1)
    assert edges.max() <= 6.0 + 1e-9
    middles = vertices[faces].mean(axis=1)
    assert np.linalg.norm(middles, axis=1).min() > 150 - 0.05


def test_a_box_has_its_edges_and_its_volume() -> None:
    vertices, faces = box((220.0, 320.0, 160.0), 30.0)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), (220, 320, 160))
    assert volume(vertices, faces) == pytest.approx(220 * 320 * 160)
    normals = vertex_normals(vertices, faces)
    assert (np.sort(np.abs(normals), axis=1)[:, :2] < 1e-9).all()


def test_weights_are_shares(person: RestBody) -> None:
    assert (person.weights >= 0).all()
    np.testing.assert_allclose(person.weights.sum(axis=1), 1.0)


def test_the_identity_at_every_bone_leaves_the_body_where_it_is(person: RestBody) -> None:
    still = np.tile(np.eye(4)[:3], (len(BONES), 1, 1))
    np.testing.assert_allclose(skin(person.vertices, person.bones, person.weights, still), person.vertices, atol=1e-9)


@given(
    x=st.floats(120, 300),
    y=st.floats(1150, 1400),
    z=st.floats(200, 300),
    twist=st.floats(-10, 10),
    sink=st.floats(0, 60),
)
@settings(max_examples=50, deadline=None)
def test_hands_reach_and_feet_stay(x: float, y: float, z: float, twist: float, sink: float) -> None:
    target = np.array([x, y, z])
    transforms = pose(
        Controls(pelvis=(0, -sink, 0), spine_turn=(4, twist, 0), hands={"l": target}, palms={"l": (0, y, z)})
    )
    assert np.allclose(transforms[:, :, :3] @ transforms[:, :, :3].transpose(0, 2, 1), np.eye(3), atol=1e-9)
    placed = dict(zip(BONES, _joints(transforms), strict=True))
    np.testing.assert_allclose(placed["hand_l"], target, atol=1e-6)
    np.testing.assert_allclose(placed["foot_r"], REST["foot_r"], atol=20)
    for joint, parent in (
        ("forearm_l", "upper_arm_l"),
        ("hand_l", "forearm_l"),
        ("shin_l", "thigh_l"),
        ("foot_l", "shin_l"),
    ):
        length = np.linalg.norm(REST[joint] - REST[parent])
        assert np.linalg.norm(placed[joint] - placed[parent]) == pytest.approx(length, abs=1e-6)


def test_turns_are_rotations() -> None:
    turn = rotation((20, -35, 50))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation((0, 90, 0)) @ (0, 0, 1), (1, 0, 0), atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_returns_to_its_start_without_a_jump(name: str) -> None:
    scene = SCENES[name](np.zeros(3))
    start, end = scene.moment(0.0), scene.moment(1.0 - 1e-6)
    for a, b in zip(start.controls, end.controls, strict=True):
        np.testing.assert_allclose(pose(a), pose(b), atol=0.2)
    for p, q in zip(start.poses, end.poses, strict=True):
        np.testing.assert_allclose(p, q, atol=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ball", "box", "people", "standing", "face"])
def test_nothing_in_a_scene_jumps_between_frames(name: str) -> None:
    moments = [SCENES[name](np.zeros(3)).moment(i / 400) for i in range(401)]
    turns = np.array([[pose(c)[..., :3] for c in moment.controls] for moment in moments])
    cosines = (np.einsum("fabij,fabij->fab", turns[1:], turns[:-1]) - 1) / 2
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).max() < 6  # in a 400th of the period
    joints = np.array([[_joints(pose(c)) for c in moment.controls] for moment in moments])
    assert np.abs(np.diff(joints, axis=0)).max() < 20  # mm


def _joints(transforms: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    return [transform[:, :3] @ REST[bone] + transform[:, 3] for bone, transform in zip(BONES, transforms, strict=True)]
