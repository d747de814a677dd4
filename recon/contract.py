"""What every method keeps to, ours and those of others: authors of plug-ins call these checks in their own tests.

Each check raises an AssertionError that says what is wrong. They need numpy alone, and a few seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.depth import Matcher, StereoPair
from recon.fusion import DepthView, Fusion, fused, view_of_cloud
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.normals import area_vectors
from recon.geometry.rig import Camera
from recon.methods.plugins import default_parameters
from recon.surface import NoSurfaceError
from recon.validation.cloud_quality import PointSet, Value
from recon.validation.cloud_quality.plugin import PluginMeasure, checked_values
from recon.validation.sampling import fibonacci_sphere

__all__ = ["check_fusion", "check_matcher", "check_measure"]

HEIGHT, WIDTH = 40, 80  # pixels, of the pictures that are matched
SHIFTS = ((0, 0), (5, 0), (-3, -6), (7, 4))  # pixels: a disparity, and the smallest one to search
N_DISPARITIES = 12
SHIFT_ERROR, SHIFT_SHARE = 0.3, 0.95  # pixels that a match may be off, and the share that must not be more
BALL_MM, BALL_PX = 60.0, 120  # radius of the ball that is fused, and side of the pictures of it
DISTANCE_MM, FOCAL_PX = 400.0, 300.0
ANGLES = (-0.7, 0.0, 0.7)  # radians, of the sensors around the ball
LEAST_COSINE = 0.3  # between the line of sight and the normal of a point that is seen
MEAN_ERROR_MM = 0.5  # a quarter of the points' spacing
LEAST_AREA, MOST_AREA = 0.8, 2.2  # of what the sensors see: twice where each has a layer of its own
COLOUR_ERROR = 8.0  # grey levels, on average
N_MEASURED, MEASURED_NOISE = 500, 0.05  # points of the ball that is measured, and noise in radii


def check_matcher(matcher: Matcher) -> None:
    """Check that a matcher keeps its promises, called with its default parameters.

    It gives float32 (H, W) with the shift of a shifted picture, in colour or grey, in the pair's range and on its
    foreground alone, the same bits every time, and does not change the pair.

    Raises
    ------
    AssertionError
        If it does not; it says what was seen and what was expected.
    """
    _check_signature(matcher)
    for shift, smallest in SHIFTS:
        _check_shift(matcher(_shifted(shift, smallest)), shift)
    _check_grey(matcher)
    noise = StereoPair(_texture(1), _texture(2), N_DISPARITIES, 3)
    disparity = matcher(noise)
    outside = disparity[np.isfinite(disparity) & ((disparity < 2.5) | (disparity > 3 + N_DISPARITIES - 0.5))]
    _expect(not outside.size, f"{outside.size} disparities lie outside the pair's range, for example {outside[:1]}")
    _expect(not np.isinf(disparity).any(), "unmatched pixels are infinite, expected NaN")
    pair = _masked(_shifted(4, 0))
    before = (pair.left.copy(), pair.right.copy())
    disparity = matcher(pair)
    assert pair.left_mask is not None
    behind = int(np.isfinite(disparity[~pair.left_mask]).sum())
    _expect(behind == 0, f"{behind} pixels of the background are matched, expected NaN where left_mask is False")
    _check_near(disparity[pair.left_mask], 4)
    _expect(np.array_equal(disparity, matcher(pair), equal_nan=True), "the same pair gives other disparities again")
    unchanged = np.array_equal(before[0], pair.left) and np.array_equal(before[1], pair.right)
    _expect(unchanged, "it changed the pictures of the pair")


def check_fusion(fusion: Fusion) -> None:
    """Check that a fusion keeps its promises, called with its default parameters.

    From three sensors' points of a ball it makes a mesh near the ball, with faces and normals outwards and the points'
    colours, the same bits every time. A sensor that saw nothing changes nothing; no sensor, or points of none, is an
    error; and the clouds stay as they are.

    Raises
    ------
    AssertionError
        If it does not; it says what was seen and what was expected.
    """
    _check_signature(fusion)
    clouds, views = _ball(ANGLES)
    before = [cloud.points.copy() for cloud in clouds]
    mesh = _mesh(fusion, clouds, views)
    _check_ball(mesh, clouds)
    again = _mesh(fusion, clouds, views)
    same = np.array_equal(mesh.vertices, again.vertices) and np.array_equal(mesh.faces, again.faces)
    _expect(same and np.array_equal(mesh.colours, again.colours), "the same clouds give another mesh again")
    unchanged = all(np.array_equal(points, cloud.points) for points, cloud in zip(before, clouds, strict=True))
    _expect(unchanged, "it changed the clouds")
    nothing = clouds[0].select(np.zeros(len(clouds[0]), np.bool_))
    empty = view_of_cloud(nothing, views[0].camera)
    with_nothing = _mesh(fusion, [*clouds, nothing], [*views, empty])
    _expect(np.array_equal(mesh.vertices, with_nothing.vertices), "a sensor that saw nothing changes the mesh")
    single = _mesh(fusion, clouds[:1], views[:1])
    _expect(len(single.faces) > 0, "a single sensor has no surface")
    _expect_error(lambda: _mesh(fusion, [], []), ValueError, "no cloud at all")
    _expect_error(lambda: _mesh(fusion, [nothing], [empty]), NoSurfaceError, "clouds without points")


def check_measure(measure: PluginMeasure) -> None:
    """Check that a measure of the quality of clouds keeps its promises.

    It returns a list of `Value` for clouds with and without colours and normals, or raises a ValueError that says what
    is missing; the same for the same clouds; leaves the clouds as they are; and rates no noisy cloud better than the
    reference itself.

    Raises
    ------
    AssertionError
        If it does not; it says what was seen and what was expected.
    """
    whole, noisy = _measured_ball(0.0), _measured_ball(MEASURED_NOISE)
    bare = PointSet("bare", whole.points)
    before = noisy.points.copy()
    best, worse = _values(measure, whole, whole), _values(measure, whole, noisy)
    _expect(len(best) > 0, "it returned no value for two equal clouds with colours and normals")
    _expect(_values(measure, whole, noisy) == worse, "it gave other values for the same clouds")
    _expect(np.array_equal(noisy.points, before), "it changed the points that it was given")
    perfect = {(value.measure, value.direction): value.value for value in best}
    for value in worse:
        place = value.measure, value.direction
        _expect(place in perfect, f"it gave {value.measure} for a noisy cloud, but not for two equal ones")
        sign = 1 if value.better == "higher" else -1
        _expect(
            sign * value.value <= sign * perfect[place],
            f"{value.measure} is {value.value:g} for a noisy cloud and {perfect[place]:g} for the reference itself, "
            f"where {value.better} is better",
        )
    _values(measure, bare, bare)


def _check_signature(method: Callable[..., Any]) -> None:
    try:
        default_parameters(method)
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{error}") from error


def _check_shift(disparity: Any, shift: int) -> None:
    is_map = isinstance(disparity, np.ndarray) and disparity.shape == (HEIGHT, WIDTH) and disparity.dtype == np.float32
    shown = f"{disparity.dtype} {disparity.shape}" if isinstance(disparity, np.ndarray) else type(disparity).__name__
    _expect(is_map, f"it returned {shown}, expected float32 {(HEIGHT, WIDTH)}")
    _check_near(disparity[:, max(shift, 0) : WIDTH + min(shift, 0)], shift)


def _check_grey(matcher: Matcher) -> None:
    shift, smallest = SHIFTS[-1]
    pair = _shifted(shift, smallest)
    left, right = (np.ascontiguousarray(image[..., 1]) for image in (pair.left, pair.right))
    try:
        disparity = matcher(StereoPair(left, right, pair.n_disparities, pair.min_disparity))
    except Exception as error:
        raise AssertionError(f"it raised {error!r} for grey pictures, uint8 (H, W)") from error
    _check_shift(disparity, shift)


def _check_near(disparity: NDArray[np.float32], shift: int) -> None:
    share = float(np.mean(np.abs(disparity - shift) <= SHIFT_ERROR))
    _expect(
        share > SHIFT_SHARE,
        f"{share:.0%} of a picture shifted by {shift} pixels has that disparity, expected more than {SHIFT_SHARE:.0%}",
    )


def _check_ball(mesh: Mesh, clouds: Sequence[Cloud]) -> None:
    error = float(np.abs(np.linalg.norm(mesh.vertices, axis=1) - BALL_MM).mean())
    _expect(error < MEAN_ERROR_MM, f"the mesh is {error:.2f} mm from the ball on average, expected {MEAN_ERROR_MM} mm")
    areas = area_vectors(mesh.vertices, mesh.faces)
    share = float(np.linalg.norm(areas, axis=1).sum()) / _seen_area()
    _expect(
        LEAST_AREA < share < MOST_AREA,
        f"the mesh has {share:.2f} times the area that the sensors see, expected {LEAST_AREA} to {MOST_AREA}",
    )
    outwards = float(np.mean((areas * mesh.vertices[mesh.faces].sum(axis=1)).sum(axis=1) > 0))
    _expect(outwards > 0.98, f"{outwards:.0%} of the faces are counter-clockwise seen from outside, expected all")
    agree = float(np.mean((mesh.normals * mesh.vertices).sum(axis=1) > 0))
    _expect(agree > 0.98, f"{agree:.0%} of the normals point outwards, expected all")
    lengths = np.linalg.norm(mesh.normals, axis=1)
    _expect(bool(np.allclose(lengths, 1, atol=1e-3)), f"normals are {lengths.min():.3g} long, expected 1")
    expected = _ball_colours(mesh.vertices)
    off = float(np.abs(mesh.colours.astype(np.float64) - expected).mean())
    _expect(off < COLOUR_ERROR, f"colours are {off:.1f} grey levels off on average, expected the points' colours")
    _expect(len(mesh.vertices) < 4 * sum(map(len, clouds)), "the mesh has more than four vertices for each point")


def _mesh(fusion: Fusion, clouds: Sequence[Cloud], views: Sequence[DepthView]) -> Mesh:
    mesh, _ = fused(fusion, clouds, default_parameters(fusion), views)
    _expect(isinstance(mesh, Mesh), f"it returned a {type(mesh).__name__}, expected a recon.geometry.mesh.Mesh")
    return mesh


def _values(measure: PluginMeasure, reference: PointSet, distorted: PointSet) -> list[Value]:
    try:
        returned = measure(reference, distorted)
    except ValueError:
        return []
    except Exception as error:
        raise AssertionError(f"it raised {error!r}, expected a ValueError that says what is missing") from error
    try:
        return checked_values(returned)
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{error}") from error


def _measured_ball(noise: float) -> PointSet:
    """Make a ball's points with normals and colours; noise in radii."""
    normals = fibonacci_sphere(N_MEASURED)
    points = normals + noise * np.random.default_rng(1).normal(size=normals.shape)
    colours = np.rint(127 * (1 + normals)).astype(np.uint8)
    return PointSet("ball", points.astype(np.float32), normals.astype(np.float32), colours)


def _expect(is_so: bool, sentence: str) -> None:
    if not is_so:
        raise AssertionError(sentence)


def _expect_error(call: Callable[[], object], kind: type[Exception], reason: str) -> None:
    try:
        call()
    except kind:
        return
    except Exception as error:
        raise AssertionError(f"{reason}: it raised {error!r}, expected a {kind.__name__}") from error
    raise AssertionError(f"{reason}: it raised nothing, expected a {kind.__name__}")


def _texture(seed: int) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)


def _shifted(shift: int, smallest: int) -> StereoPair:
    """Make a pair whose disparity is the same everywhere."""
    scene = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH + 40, 3)).astype(np.uint8)
    left, right = scene[:, 20 : 20 + WIDTH], scene[:, 20 + shift : 20 + shift + WIDTH]
    return StereoPair(np.ascontiguousarray(left), np.ascontiguousarray(right), N_DISPARITIES, smallest)


def _masked(pair: StereoPair) -> StereoPair:
    """Add masks of a foreground with disparity 4."""
    left, right = np.zeros((2, HEIGHT, WIDTH), np.bool_)
    left[8:30, 20:60] = True
    right[8:30, 16:56] = True
    return StereoPair(pair.left, pair.right, pair.n_disparities, left_mask=left, right_mask=right)


def _ball(angles: Sequence[float]) -> tuple[list[Cloud], list[DepthView]]:
    """Make the points of a ball that sensors around it see, and their depth maps."""
    clouds, views = [], []
    for angle in angles:
        camera = _camera(angle)
        cloud = _seen(camera)
        clouds.append(cloud)
        views.append(view_of_cloud(cloud, camera))
    return clouds, views


def _camera(angle: float) -> Camera:
    sine, cosine = np.sin(angle), np.cos(angle)
    cam_from_world = np.eye(4)
    cam_from_world[:3, :3] = [[cosine, 0, -sine], [0, -1, 0], [-sine, 0, -cosine]]
    cam_from_world[2, 3] = DISTANCE_MM
    middle = (BALL_PX - 1) / 2
    K = np.array([[FOCAL_PX, 0, middle], [0, FOCAL_PX, middle], [0, 0, 1]])
    return Camera(K, (BALL_PX, BALL_PX), cam_from_world)


def _seen(camera: Camera) -> Cloud:
    rows, columns = np.mgrid[:BALL_PX, :BALL_PX]
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3)
    rays = pixels @ np.linalg.inv(camera.K).T @ camera.rotation
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    nearest = -rays @ camera.centre
    inside = nearest**2 - DISTANCE_MM**2 + BALL_MM**2
    points = camera.centre + rays * (nearest - np.sqrt(np.maximum(inside, 0)))[:, None]
    is_seen = (inside > 0) & (-(points * rays).sum(axis=1) > LEAST_COSINE * BALL_MM)
    points = points[is_seen]
    normals = points / BALL_MM
    return Cloud(points.astype(np.float32), normals.astype(np.float32), _ball_colours(points).astype(np.uint8))


def _ball_colours(points: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.clip(128 + points.astype(np.float64), 0, 255)


def _seen_area() -> float:
    """Estimate the area of the ball that a sensor sees, mm^2, by counting directions."""
    directions = np.random.default_rng(0).normal(size=(20000, 3))
    points = BALL_MM * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    is_seen = np.zeros(len(points), np.bool_)
    for centre in (_camera(angle).centre for angle in ANGLES):
        towards = centre - points
        cosine = (points * towards).sum(axis=1) / (BALL_MM * np.linalg.norm(towards, axis=1))
        is_seen |= cosine > LEAST_COSINE
    return float(is_seen.mean() * 4 * np.pi * BALL_MM**2)
