"""How surfaces rise, measured on planes and steps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.depth import StereoPair
from recon.depth.cvf import IdParameters, match_id
from recon.depth.matching.slopes import tile_slopes
from tests.recon.depth.test_patchmatch import slanted_pair


def slopes_of(disparity: NDArray[np.floating]) -> tuple[NDArray[np.float32], ...]:
    return tile_slopes(disparity.astype(np.float32), np.isfinite(disparity))


@pytest.mark.parametrize(("height", "width"), [(61, 90), (64, 93)])
def test_a_plane_rises_alike_in_every_tile(height: int, width: int) -> None:
    y, x = np.indices((height, width))
    across, down = slopes_of(0.2 * x - 0.1 * y)
    assert across.shape == down.shape == (-(-height // 4), -(-width // 4))
    np.testing.assert_allclose(across, 0.2, atol=0.04)  # a little less, because some pixels count as level
    np.testing.assert_allclose(down, -0.1, atol=0.02)


def test_a_step_is_no_slope_and_parts_two_surfaces() -> None:
    x = np.indices((60, 120))[1]
    right = x >= 60
    assert (slopes_of(np.where(right, 9, 2))[0] == 0).all()
    across, _ = slopes_of(np.where(right, 9 + 0.3 * (x - 60), 2))
    assert (across[:, :15] < 1e-6).all()
    assert (across[:, 16:] > 0.2).all()


def test_where_nothing_is_known_surfaces_are_level() -> None:
    across, down = slopes_of(np.full((20, 30), np.nan))
    assert not across.any()
    assert not down.any()


def test_a_slanted_wall_of_weak_texture_becomes_fewer_steps_than_without_slopes() -> None:
    pair, truth = slanted_pair()
    noise = np.random.default_rng(0).normal(128, 0.7, (2, *pair.left.shape))
    left, right = ((0.05 * (image - 128.0) + noise[side]).round() for side, image in enumerate((pair.left, pair.right)))
    weak = StereoPair(left.astype(np.uint8), right.astype(np.uint8), 24)
    wrong = [
        np.mean(~(np.abs(match_id(weak, IdParameters(levels=levels)) - truth)[4:-4, 26:-4] <= 1)) for levels in (2, 0)
    ]
    assert wrong[0] < 0.7 * wrong[1]


def mosaic_wall(slope: float) -> tuple[StereoPair, NDArray[np.float64]]:
    """A wall that recedes to the left, of plain fields with sharp edges, and its truth."""
    rng = np.random.default_rng(0)
    texture = np.kron(rng.integers(30, 220, (10, 25)), np.ones((12, 12)))
    y, x = np.indices((120, 200))
    views = [texture[y, np.rint(columns).astype(int).clip(0, 299)] for columns in (x, (x + 4) / (1 - slope))]
    left, right = (np.clip(view + rng.normal(0, 1, view.shape), 0, 255).astype(np.uint8) for view in views)
    return StereoPair(left, right, 40), 4 + slope * x


def test_edges_of_the_picture_do_not_end_a_surface() -> None:
    pair, truth = mosaic_wall(0.15)
    wrong = [np.mean(~(np.abs(match_id(pair, IdParameters(levels=n)) - truth)[4:-4, 44:-4] <= 1)) for n in (2, 0)]
    assert wrong[0] < 0.5 * wrong[1]
