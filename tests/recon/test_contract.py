"""One contract for all methods: ours, and those of the packages that are installed here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.contract import check_fusion, check_matcher
from recon.depth import MATCHERS, StereoPair, match_sgm
from recon.fusion import FUSIONS, fuse_before
from recon.geometry.mesh import Cloud, Mesh
from recon.methods.plugins import DEPTH_GROUP, FUSION_GROUP, registered


def every(ours: dict[str, Callable[..., Any]], group: str) -> Any:
    """Parametrise over our methods and the plug-ins of a group."""
    plugins = registered(group, ours)
    loaders = [lambda method=method: method for method in ours.values()] + [each.load for each in plugins.values()]
    return pytest.mark.parametrize("load", loaders, ids=[*ours, *plugins])


@pytest.mark.slow
@every(MATCHERS, DEPTH_GROUP)
def test_every_matcher_keeps_the_contract(load: Callable[[], Callable[..., Any]]) -> None:
    check_matcher(load())


@pytest.mark.slow
@every(FUSIONS, FUSION_GROUP)
def test_every_fusion_keeps_the_contract(load: Callable[[], Callable[..., Any]]) -> None:
    check_fusion(load())


def as_double(pair: StereoPair) -> Any:
    return match_sgm(pair).astype(np.float64)


def shifted_by_a_pixel(pair: StereoPair) -> NDArray[np.float32]:
    return match_sgm(pair) + np.float32(1)


def without_masks(pair: StereoPair) -> NDArray[np.float32]:
    return match_sgm(StereoPair(pair.left, pair.right, pair.n_disparities, pair.min_disparity))


def beyond_the_range(pair: StereoPair) -> NDArray[np.float32]:
    disparity = match_sgm(pair)
    disparity[0, 0] = 99
    return disparity


def random(pair: StereoPair) -> NDArray[np.float32]:
    disparity = match_sgm(pair)
    disparity[20, 30] = np.random.default_rng().uniform(3.9, 4.1)
    return disparity


def blackening(pair: StereoPair) -> NDArray[np.float32]:
    disparity = match_sgm(pair)
    pair.left[0] = 0
    return disparity


def in_colour_alone(pair: StereoPair) -> NDArray[np.float32]:
    assert pair.left.shape[2] == 3
    return match_sgm(pair)


def with_three_parameters(pair: StereoPair, _a: int, _b: int) -> NDArray[np.float32]:
    return match_sgm(pair)


@pytest.mark.parametrize(
    ("matcher", "sentence"),
    [
        (as_double, r"returned float64 \(40, 80\), expected float32"),
        (shifted_by_a_pixel, "0% of a picture shifted by 0 pixels has that disparity"),
        (without_masks, "pixels of the background are matched"),
        (beyond_the_range, "lie outside the pair's range"),
        (random, "gives other disparities again"),
        (blackening, "changed the pictures"),
        (in_colour_alone, r"it raised IndexError.* for grey pictures, uint8 \(H, W\)"),
        (with_three_parameters, r"takes \(pair, _a, _b\)"),
    ],
)
def test_a_matcher_that_breaks_the_contract_is_told_how(matcher: Callable[..., Any], sentence: str) -> None:
    with pytest.raises(AssertionError, match=sentence):
        check_matcher(matcher)


def inside_out(clouds: Sequence[Cloud]) -> Mesh:
    mesh = fuse_before(clouds)
    return replace(mesh, faces=mesh.faces[:, ::-1])


def too_large(clouds: Sequence[Cloud]) -> Mesh:
    mesh = fuse_before(clouds)
    return replace(mesh, vertices=mesh.vertices * np.float32(1.02))


def grey(clouds: Sequence[Cloud]) -> Mesh:
    mesh = fuse_before(clouds)
    return replace(mesh, colours=np.full_like(mesh.colours, 128))


def of_the_first_sensor(clouds: Sequence[Cloud]) -> Mesh:
    return fuse_before(clouds[:1])


def forgiving(clouds: Sequence[Cloud]) -> Mesh:
    if not clouds:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    return fuse_before(clouds)


def points_alone(clouds: Sequence[Cloud]) -> Any:
    return clouds[0]


@pytest.mark.parametrize(
    ("fusion", "sentence"),
    [
        (inside_out, "0% of the faces are counter-clockwise"),
        (too_large, r"1\.20 mm from the ball on average"),
        (grey, "grey levels off on average"),
        (of_the_first_sensor, "times the area that the sensors see"),
        (forgiving, "no cloud at all: it raised nothing, expected a ValueError"),
        (points_alone, r"returned a Cloud, expected a recon\.geometry\.mesh\.Mesh"),
    ],
)
def test_a_fusion_that_breaks_the_contract_is_told_how(fusion: Callable[..., Any], sentence: str) -> None:
    with pytest.raises(AssertionError, match=sentence):
        check_fusion(fusion)
