"""Matching on a GPU: the heavy steps of ID, DR and PM, with the disparities that the processor finds.

`gpu.cu` holds the kernels, which CuPy compiles for the GPU at hand when they are first used. What is not here, such
as guides and where a finer level searches, stays on the processor.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.depth.matching import lanes, plane_search, slanted, subpixel, texture
from recon.depth.matching.census import BEHIND, blurred
from recon.depth.matching.lanes import N_LANES
from recon.depth.matching.permeability import WORST
from recon.depth.matching.plane_search import Settings
from recon.depth.matching.texture import Texture
from recon.depth.matching.views import View

SOURCE = Path(__file__).with_suffix(".cu")
KERNELS = (
    "census",
    "flow_along_rows",
    "choose_along_columns",
    "surface_along_rows",
    "surface_along_columns",
    "sweep",
)
OPTIONS = ("--std=c++17", "--fmad=false")  # each number is rounded as on the processor
CONSTANTS = {
    subpixel: ("MAX_OFFSET",),
    slanted: ("SURFACE_STEP", "CENTRE", "MOST_MOVED"),
    texture: ("WINDOW_REACH", "PAD", "FINE"),
    lanes: ("ONE_BITS",),
    plane_search: (
        *("MAX_SLOPE", "SLOPE_SHARE", "LAST_STEP", "SAME_PLANE", "SAME_WITHIN", "NEIGHBOURS", "N_NEIGHBOURS"),
        *("N_TRIALS", "ROUND", "NEWS"),
    ),
}
INSTALL = "pip install 'reconstudy[gpu]', or of that only 'cupy-cuda13x[ctk]'"
ON_CPU = "--device cpu"
THREADS = 128  # of a block in which threads work for themselves, or each group for a pixel
FEW_THREADS = 32  # of a block whose groups take a row or a column each, so that all of the GPU has some

# As the structures of the same names in `gpu.cu`; a pointer is a uint64. An array with one of them is passed by value.
VIEW = np.dtype(
    [
        *((name, "u8") for name in ("sharp", "blurred", "facing_sharp", "facing_blurred")),
        *((name, "i4") for name in ("pitch", "facing_pitch", "before", "origin")),
        *((name, "u8") for name in ("across", "down", "passage")),
        *((name, "i4") for name in ("height", "width")),
    ],
    align=True,
)
TILES = np.dtype([("start", "u8"), ("rise", "u8"), ("fall", "u8"), ("bits", "i4"), ("n_columns", "i4")], align=True)
SEEN = np.dtype(
    [
        *((name, "u8") for name in ("colours", "words", "target")),
        ("half", "i4"),
        *((name, "u8") for name in ("across", "down", "passage")),
        *((name, "i4") for name in ("height", "width")),
    ],
    align=True,
)


class GpuError(ValueError):
    """There is no GPU to match on, or it cannot do it."""


@dataclass(frozen=True, eq=False)
class Held:
    """What both searches read of a view, in the GPU's memory.

    codes : uint32 (2, H, before + W + after), see `View.framed_codes`
    passages : see `Passages`
    """

    codes: Any
    passages: tuple[Any, ...]


@dataclass(frozen=True, eq=False)
class GpuView(View):
    """A view that a GPU searches."""

    gpu: Gpu

    def prepare(self) -> None:
        """Compute what the searches of both views read, and keep it in the GPU's memory."""
        _ = self.held

    @cached_property
    def held(self) -> Held:
        """Codes and passages in the GPU's memory."""
        return self.gpu.hold(self)


class Gpu:
    """A GPU that matches; threads may share it.

    Parameters
    ----------
    cupy : the module, or one that does the same
    """

    def __init__(self, cupy: ModuleType) -> None:
        self._cupy = cupy
        constants = "".join(_declared(module, name) for module, names in CONSTANTS.items() for name in names)
        module = cupy.RawModule(code=constants + SOURCE.read_text(encoding="utf-8"), options=OPTIONS)
        self._kernels = {name: module.get_function(name) for name in KERNELS}

    def take(self, views: tuple[View, View]) -> tuple[GpuView, GpuView]:
        """Return the same views, to be searched on this GPU."""
        left, right = (
            GpuView(**{entry.name: getattr(view, entry.name) for entry in fields(view)}, gpu=self) for view in views
        )
        return left, right

    def hold(self, view: View) -> Held:
        """Compute a view's census codes, and take its passages."""
        (height, width), level = view.shape, view.level
        pitch = level.before + width + level.after
        mask = np.ones(view.shape, np.bool_) if view.mask is None else view.mask
        with self._working():
            codes, on_gpu = self._cupy.empty((2, height, pitch), np.uint32), self._cupy.asarray
            numbers = map(np.int32, (height, width, view.window // 2, view.is_right, level.before, pitch))
            rest = (on_gpu(mask), *numbers, BEHIND)
            for grey, plane in zip((view.grey, blurred(view.grey)), codes, strict=True):
                self._run("census", (-(-pitch // THREADS), height), THREADS, (on_gpu(grey), *rest, plane))
            return Held(codes, (*map(on_gpu, view.passages),))

    def search(
        self,
        view: GpuView,
        other: GpuView,
        starts: list[NDArray[np.int32]],
        slopes: tuple[NDArray[np.float32], NDArray[np.float32]],
        tile_bits: int,
        flip: int,
    ) -> NDArray[np.float32]:
        """Search every pixel's cheapest disparity index; return its parabola's vertex, float32 (H, W).

        Parameters
        ----------
        view, other : whose pixels search, and where
        starts : of the windows that are searched one after another, as `start` of `Searched`
        slopes, tile_bits, flip : as in `permeability`
        """
        (height, width), n_disparities = view.shape, np.int32(view.level.n_disparities)
        with self._working():
            seen, on_gpu = self._facing(view, other), self._cupy.asarray
            rise, fall = map(on_gpu, slopes)
            flows = self._cupy.empty((height, width, N_LANES), np.float32)
            best = self._cupy.full(view.shape, WORST, np.int32)
            chosen = self._cupy.zeros(view.shape, np.float32)
            for start in map(on_gpu, starts):
                tiles = np.array([(*map(_pointer, (start, rise, fall)), tile_bits, start.shape[1])], TILES)
                self._run_groups("flow_along_rows", height, (seen, tiles, flows))
                last = (seen, tiles, n_disparities, np.int32(flip), flows, best, chosen)
                self._run_groups("choose_along_columns", width, last)
            return self._fetched(chosen)

    def aggregate_along_surface(
        self, view: GpuView, other: GpuView, surface: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Do as `slanted.aggregate_along_surface` does.

        Parameters
        ----------
        view, other : whose surface it is, and where costs come from
        surface : float32 (H, W), disparity indices
        """
        (height, width), n_disparities = view.shape, np.int32(view.level.n_disparities)
        with self._working():
            seen, there = self._facing(view, other), self._cupy.asarray(surface)
            flows = self._cupy.empty((height, width, N_LANES), np.float32)
            refined = self._cupy.empty(view.shape, np.float32)
            self._run_groups("surface_along_rows", height, (seen, there, flows))
            self._run_groups("surface_along_columns", width, (seen, there, n_disparities, flows, refined))
            return self._fetched(refined)

    def sweep(
        self,
        views: tuple[GpuView, GpuView],
        textures: tuple[Texture, Texture],
        settings: Settings,
        turns: list[tuple[int, int, int]],
        planes: tuple[NDArray[np.float32], NDArray[np.float32]],
        costs: list[NDArray[np.float32]],
        moved: tuple[NDArray[np.int16], NDArray[np.int16]],
    ) -> None:
        """Let both views' pixels look for better planes.

        Parameters
        ----------
        views, textures : left and right
        settings : as in `plane_search.sweep`
        turns : for each turn the side, left (0) or right, its number and its seed
        planes, costs, moved : of both, float32 (H, W, 3), float32 (H, W) and int16 (H, W), as in `plane_search.sweep`;
            planes and moved are updated
        """
        on_gpu, (height, width) = self._cupy.asarray, views[0].shape
        with self._working():
            held = [(*map(on_gpu, (texture.colours, texture.words, texture.fine)),) for texture in textures]
            states = [[*map(on_gpu, of_view)] for of_view in zip(planes, costs, moved, strict=True)]
            numbers = np.array([settings], [(name, "f4") for name in settings._fields])
            for side, turn, seed in turns:
                colours, words, _ = held[side]
                pictures = map(_pointer, (colours, words, held[1 - side][2]))
                passages = map(_pointer, views[side].held.passages)
                seen = np.array([(*pictures, colours.shape[2], *passages, *views[side].shape)], SEEN)
                facing, _, facing_moved = states[1 - side]
                arguments = (seen, numbers, facing, facing_moved, np.int32(turn), np.uint32(seed), *states[side])
                self._run_groups("sweep", height * ((width + 1) // 2), arguments, THREADS)
            for side, (changed, _, when) in enumerate(states):
                planes[side][:], moved[side][:] = self._cupy.asnumpy(changed), self._cupy.asnumpy(when)

    def _facing(self, view: GpuView, other: GpuView) -> Any:
        """Describe what a search of a view in the other reads: a `VIEW`."""
        here, there = view.held, other.held
        pointers = map(_pointer, (*here.codes, *there.codes))
        places = (here.codes.shape[2], there.codes.shape[2], view.level.before, other.origin)
        return np.array([(*pointers, *places, *map(_pointer, here.passages), *view.shape)], VIEW)

    def _run_groups(self, kernel: str, n_groups: int, arguments: tuple[Any, ...], threads: int = FEW_THREADS) -> None:
        self._run(kernel, (-(-n_groups * N_LANES // threads),), threads, arguments)

    def _run(self, kernel: str, blocks: tuple[int, ...], threads: int, arguments: tuple[Any, ...]) -> None:
        self._kernels[kernel](blocks, (threads,), arguments)

    def _fetched(self, array: Any) -> NDArray[np.float32]:
        return np.asarray(self._cupy.asnumpy(array))

    @contextmanager
    def _working(self) -> Iterator[None]:
        """Say in words what stops the GPU."""
        try:
            yield
        except MemoryError as error:
            raise GpuError(
                f"the GPU's memory is full: {str(error).rstrip('.')}; use fewer workers, or match with {ON_CPU}"
            ) from error


@cache
def open_gpu() -> Gpu:
    """Open the GPU of this machine.

    Raises
    ------
    GpuError
        If there is none, or CuPy is not installed.
    """
    try:
        import cupy
    except ImportError as error:
        raise GpuError(
            f"matching on a GPU needs CuPy: {error}; to install it: {INSTALL}, or match with {ON_CPU}"
        ) from error
    try:
        cupy.cuda.Device().use()
        return Gpu(cupy)
    except RuntimeError as error:
        raise GpuError(
            f"no GPU to match on: {error}; expected one of NVIDIA with its driver; or match with {ON_CPU}"
        ) from error


def _declared(module: ModuleType, name: str) -> str:
    value = getattr(module, name)
    if isinstance(value, tuple):  # what a variable is set to, as a constant array is not within a kernel's reach
        return f"#define {name} {{{', '.join(map(str, value))}}}\n"
    return f"constexpr {f'float {name} = {value}f' if isinstance(value, float) else f'int {name} = {value}'};\n"


def _pointer(array: Any) -> int:
    return int(array.__cuda_array_interface__["data"][0])
