"""Sensors whose colours differ are made to agree where they see the same places."""

from __future__ import annotations

import numpy as np
import pytest

from recon.geometry.mesh import Cloud
from recon.surface.colours import balance_colours, estimate_colours


def ball(direction: tuple[float, float, float], *, seed: int) -> Cloud:
    """The side of a ball of 60 mm that is seen from one direction."""
    normals = np.random.default_rng(seed).normal(size=(40000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals[normals @ np.array(direction) > 0.2 * np.linalg.norm(direction)]
    return Cloud(60 * normals, normals, np.full((len(normals), 3), 90, np.uint8))


def painted_views(gains: np.ndarray, offsets: np.ndarray, *, odd: float = 0.0) -> list[Cloud]:
    """The three views of one painted ball through sensors with these gains and offsets (3, 3)."""
    views = []
    for number, direction in enumerate(((-1.0, 0, 1), (0.0, 0, 1), (1.0, 0, 1))):
        cloud = ball(direction, seed=number)
        paint = 120 + 60 * np.sin(4 * cloud.normals + (0, 1, 2))
        rng = np.random.default_rng(number)
        seen = gains[number] * paint + offsets[number] + rng.normal(0, 2, paint.shape)
        seen[rng.random(len(seen)) < odd] = 200  # a highlight that moves with the viewer
        views.append(Cloud(cloud.points, cloud.normals, np.clip(np.rint(seen), 0, 255).astype(np.uint8)))
    return views


def test_gains_and_offsets_are_recovered_from_overlaps() -> None:
    gains = np.array([[0.9, 1.0, 1.05], [1.0, 1.0, 1.0], [1.1, 1.0, 0.95]])
    offsets = np.array([[5.0, 0, -3], [0, 0, 0], [-5, 0, 3]])
    views = painted_views(gains, offsets, odd=0.03)
    balanced = balance_colours(views, estimate_colours(views, 4.0))
    before, after = (estimate_colours(clouds, 4.0) for clouds in (views, balanced))
    assert np.abs(before.gain - 1).max() > 0.08
    for byte in (60, 120, 180):  # where the paint is
        assert np.abs(after.gain * byte + after.offset - byte).max() < 1.0
    assert np.allclose(before.gain.mean(axis=0), 1)
    assert np.allclose(before.offset.mean(axis=0), 0)


def test_sensors_that_agree_are_left_alone() -> None:
    views = painted_views(np.ones((3, 3)), np.zeros((3, 3)))
    colours = estimate_colours(views, 4.0)
    assert np.abs(colours.gain - 1).max() < 0.01
    assert np.abs(colours.offset).max() < 1.0


def test_colours_cannot_be_compared_without_an_overlap() -> None:
    left, right = ball((-1.0, 0, 0), seed=1), ball((1.0, 0, 0), seed=2)
    with pytest.raises(ValueError, match="share 0 places of 4 mm"):
        estimate_colours([left, right], 4.0)
