"""Matching on a GPU: the disparities of the processor, to the bit."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from recon.depth import MATCHERS, StereoPair, check_device
from recon.depth.cvf import DrParameters, IdParameters
from recon.depth.gpu import Gpu, GpuError, open_gpu
from recon.depth.patchmatch import PmParameters
from recon.studio import SynthParameters, synthesise
from tests.command_line import Command
from tests.recon.depth.emulated_gpu import COMPILER, emulated

HEIGHT, WIDTH = 30, 61
FEW_SWEEPS = PmParameters(sweeps=1)


def slanted_pair(*, n_disparities: int = 40, min_disparity: int = 0) -> StereoPair:
    """A textured surface that rises to the right in front of another, in both views."""
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.uniform(0, 255, (HEIGHT, 2 * WIDTH, 3)).astype(np.float32), (0, 0), 1)
    y, x = np.indices((HEIGHT, WIDTH)).astype(np.float32)
    disparity = np.where((x > 25) & (y > 8), 14 + 0.2 * (x - 25) + 0.1 * y, 4) + np.float32(min_disparity)
    left = cv2.remap(texture, x + WIDTH / 2, y, cv2.INTER_LINEAR)
    right = cv2.remap(texture, x + WIDTH / 2 + disparity, y, cv2.INTER_LINEAR)
    noisy = [np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8) for image in (left, right)]
    return StereoPair(noisy[0], noisy[1], n_disparities, min_disparity)


def masked_pair() -> StereoPair:
    y, x = np.indices((HEIGHT, WIDTH))
    masks = [((x - centre) / 20) ** 2 + ((y - 15) / 13) ** 2 < 1 for centre in (40, 24)]
    return replace(slanted_pair(), left_mask=masks[0], right_mask=masks[1])


@pytest.fixture(autouse=True)
def _newly_opened() -> Iterator[None]:
    """Look for the GPU again in each test."""
    open_gpu.cache_clear()
    yield
    open_gpu.cache_clear()


@pytest.fixture(scope="module")
def gpus(tmp_path_factory: pytest.TempPathFactory) -> list[Gpu]:
    """The GPUs to try: a real one, and one that g++ stands in for."""
    found = []
    try:
        found.append(open_gpu())
    except GpuError as error:
        reason = str(error)
    if COMPILER:
        found.append(Gpu(emulated(tmp_path_factory.mktemp("gpu"))))
    if not found:
        pytest.skip(f"neither a GPU nor a compiler to stand in for it: {reason}; g++ is not installed")
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "pair", "parameters"),
    [
        pytest.param("id", slanted_pair(), IdParameters(), id="id"),
        pytest.param("id", slanted_pair(n_disparities=11, min_disparity=-3), IdParameters(), id="few disparities"),
        pytest.param("id", slanted_pair(), IdParameters(levels=0, window=3), id="full search"),
        pytest.param("dr", slanted_pair(min_disparity=2), DrParameters(), id="dr"),
        pytest.param("dr", masked_pair(), DrParameters(), id="dr masked"),
        pytest.param("pm", slanted_pair(), FEW_SWEEPS, id="pm"),
        pytest.param("pm", masked_pair(), FEW_SWEEPS, id="pm masked"),
        pytest.param("pm", masked_pair(), replace(FEW_SWEEPS, is_seeded=False, sweeps=2), id="pm at random"),
    ],
)
def test_a_gpu_finds_the_disparities_of_the_processor(
    gpus: list[Gpu], method: str, pair: StereoPair, parameters: Any
) -> None:
    expected = MATCHERS[method](pair, parameters)
    assert np.isfinite(expected).mean() > 0.05
    for gpu in gpus:
        np.testing.assert_array_equal(MATCHERS[method](pair, parameters, gpu=gpu), expected)


def match_black(command: Command, folder: Path) -> str:
    """Match a pair on a GPU, and return the error."""
    for side in ("left", "right"):
        cv2.imwrite(str(folder / f"{side}.png"), np.zeros((40, 60), np.uint8))
    pair = (folder / "left.png", folder / "right.png")
    told = command("match", *pair, "--disparities", 8, "-o", folder / "d.npy", "--device", "gpu")
    assert told.code == 1
    assert not (folder / "d.npy").exists()
    return told.err


def test_who_lacks_the_package_is_told_what_to_install(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "cupy", None)
    error = match_black(command, tmp_path)
    assert "matching on a GPU needs CuPy" in error
    assert "pip install 'reconstudy[gpu]', or of that only 'cupy-cuda13x[ctk]'" in error
    assert "--device cpu" in error


def test_a_machine_without_a_gpu_is_named(command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def device() -> None:
        raise RuntimeError("cudaErrorNoDevice: no CUDA-capable device is detected")

    monkeypatch.setitem(sys.modules, "cupy", SimpleNamespace(cuda=SimpleNamespace(Device=device)))
    assert "no GPU to match on: cudaErrorNoDevice" in match_black(command, tmp_path)


def test_an_unknown_device_is_named() -> None:
    with pytest.raises(ValueError, match="device is 'cuda', expected one of cpu, gpu"):
        check_device("cuda")


@pytest.mark.slow
def test_a_full_memory_is_named(gpus: list[Gpu], monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise MemoryError("Out of memory allocating 132,710,400 bytes")

    gpu = gpus[-1]
    monkeypatch.setattr(gpu._cupy, "empty", full)
    with pytest.raises(GpuError, match=r"memory is full: Out of memory allocating .* fewer workers"):
        MATCHERS["id"](slanted_pair(), gpu=gpu)


@pytest.mark.slow
def test_a_run_on_a_gpu_is_the_run_on_the_processor(
    command: Command, gpus: list[Gpu], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    synthesise(tmp_path / "ball", SynthParameters(scene="ball", n_sensors=2, n_frames=1, size=(64, 48)))
    monkeypatch.setattr("recon.depth.open_gpu", lambda: gpus[-1])
    calls: list[str] = []
    run_kernel = Gpu._run
    monkeypatch.setattr(Gpu, "_run", lambda gpu, kernel, *rest: (calls.append(kernel), run_kernel(gpu, kernel, *rest)))
    arguments = ("reconstruct", tmp_path / "ball", "--depth", "dr,sgm", "--fusion", "fb")
    for device in ("gpu", "cpu"):
        told = command(*arguments, "-o", tmp_path / device, "--device", device)
        assert told.code == 0, told.err
    assert {"census", "flow_along_rows", "choose_along_columns", "surface_along_columns"} <= set(calls)
    files = sorted(file.relative_to(tmp_path / "gpu") for file in (tmp_path / "gpu").rglob("*.ply"))
    assert len(files) == 6
    for file in files:
        assert (tmp_path / "gpu" / file).read_bytes() == (tmp_path / "cpu" / file).read_bytes()
    n_calls = len(calls)
    assert command(*arguments, "-o", tmp_path / "cpu", "--device", "gpu").code == 0
    assert len(calls) == n_calls, "what a processor matched is not matched again"
