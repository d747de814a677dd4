"""Splats are handed to gsplat in its own conventions, and drawn there as here."""

from __future__ import annotations

import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.geometry.rig import Camera, look_at
from recon.geometry.splats import Splats
from recon.render.frames import choose_renderer
from recon.render.gaussians.draw import render_splats, splat_layer
from recon.render.gaussians.gpu import draw_splats_by_gsplat, gsplat_device, gsplat_layer
from recon.render.offscreen import NoRendererError

SIZE = (75, 50)
SEEN_BY = Camera(np.array([[60.0, 0, 37], [0, 62, 24.5], [0, 0, 1]]), SIZE, look_at((300, 200, 2500), [0, 0, 0]))


def turned_splats(*, antialiased: bool) -> Splats:
    """Scatter splats that were turned after their training, so that their harmonics have axes of their own."""
    rng = np.random.default_rng(0)
    turns = rng.normal(size=(200, 4))
    splats = Splats(
        rng.normal(size=(200, 3)) * 7,
        np.exp(rng.normal(-1.4, 0.9, (200, 3))),
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        rng.uniform(0, 1, 200),
        rng.normal(size=(200, 9, 3)) * 0.3,
        antialiased=antialiased,
    )
    transform = np.eye(4)
    transform[:3, :3] = 100 * Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    return splats.moved(transform)


class Tensor(np.ndarray):
    """An array with the few words of PyTorch's that are used."""

    def float(self) -> NDArray[Any]:
        return self.astype(np.float32)

    def to(self, _device: str) -> Tensor:
        return self

    def cpu(self) -> Tensor:
        return self

    def numpy(self) -> NDArray[Any]:
        return np.asarray(self)


def rasterization(**given: Any) -> tuple[Any, Any, None]:
    """Draw what gsplat is given as its documentation describes it, by this package's own drawing."""
    assert given["eps2d"] == 0.3
    assert given["near_plane"] == pytest.approx(1)  # a hundredth of the unit of 100 mm
    arrays = [np.asarray(given[name]) for name in ("means", "scales", "quats", "opacities", "colors")]
    assert arrays[4].shape[1] == (given["sh_degree"] + 1) ** 2
    K = np.asarray(given["Ks"][0], np.float64).copy()
    K[:2, 2] -= 0.5
    size = (given["width"], given["height"])
    splats = Splats(*arrays, antialiased=given["rasterize_mode"] == "antialiased")
    layer = splat_layer(splats, Camera(K, size, np.asarray(given["viewmats"][0], np.float64)), size)
    return layer[None, ..., :3].view(Tensor), (1 - layer[None, ..., 3:]).view(Tensor), None


@pytest.mark.parametrize("antialiased", [False, True])
def test_gsplat_is_given_the_model_in_the_axes_of_its_harmonics(
    antialiased: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(from_numpy=lambda array: array.view(Tensor)))
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(rasterization=rasterization))
    splats = turned_splats(antialiased=antialiased)
    assert np.allclose(gsplat_layer(splats, SEEN_BY, SIZE), splat_layer(splats, SEEN_BY, SIZE), atol=1e-3)
    other = replace(splats, antialiased=not antialiased)
    assert not np.allclose(gsplat_layer(other, SEEN_BY, SIZE), splat_layer(splats, SEEN_BY, SIZE), atol=1e-3)


def test_gsplat_is_refused_where_it_cannot_draw(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recon.render.frames.gsplat_device", lambda: "")
    with pytest.raises(NoRendererError, match=r"expected the packages torch and gsplat .* and an NVIDIA GPU"):
        choose_renderer("gsplat")


def test_gsplat_draws_the_same_pictures() -> None:
    if not gsplat_device():
        pytest.skip("gsplat, or an NVIDIA GPU, is missing: its pictures are not compared")
    splats = turned_splats(antialiased=False)
    picture = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    draw_splats_by_gsplat(picture, splats, SEEN_BY)
    assert np.abs(picture.astype(int) - render_splats(splats, SEEN_BY)).max() <= 1
