"""A module that does for `recon.depth.gpu.Gpu` what CuPy does, without a GPU: g++ compiles the kernels."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from threading import Lock
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

COMPILER = shutil.which("g++")
EMULATION = Path(__file__).with_suffix(".cpp")
UNKNOWN = 0xA5  # byte of memory that nothing was written to


class DeviceArray(np.ndarray):
    """An array that tells its place in memory as CuPy's do."""

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        return self.__array_interface__


class RawModule:
    """Kernels, compiled for the processor with the same rounding."""

    def __init__(self, folder: Path, code: str) -> None:
        kernels = re.findall(r"__global__ void (\w+)\(", code)
        source, library = folder / "kernels.cpp", folder / "kernels.so"
        runs = "".join(f"RUN({kernel})\n" for kernel in kernels)
        source.write_text(EMULATION.read_text(encoding="utf-8") + code + runs, encoding="utf-8")
        rounding, jumps = "-ffp-contract=off", "-U_FORTIFY_SOURCE"  # which takes a change of stack for a mistake
        command = [str(COMPILER), "-std=c++17", "-O2", rounding, jumps, "-shared", "-fPIC", "-w"]
        subprocess.run([*command, "-o", library, source], check=True)
        self._library = ctypes.CDLL(str(library))
        self._alone = Lock()

    def get_function(self, name: str) -> Any:
        """Return a kernel, called as CuPy's are: blocks, threads, arguments."""

        def call(blocks: Sequence[int], threads: Sequence[int], arguments: Sequence[Any]) -> None:
            words = [_word(argument) for argument in arguments]
            places = (ctypes.c_void_p * len(words))(*(word.ctypes.data for word in words))
            grid = (ctypes.c_int * 2)(*blocks, *[1] * (2 - len(blocks)))
            with self._alone:
                self._library[f"run_{name}"](grid, ctypes.c_int(*threads), places)

        return call


def emulated(folder: Path) -> Any:
    """Return the module; compiled files go into a folder."""

    def module(code: str, options: Sequence[str]) -> RawModule:
        assert "--fmad=false" in options
        return RawModule(folder, code)

    return SimpleNamespace(
        RawModule=module,
        asarray=lambda array: np.array(array, order="C").view(DeviceArray),
        asnumpy=lambda array: array.view(np.ndarray).copy(),
        empty=_empty,
        full=lambda shape, value, dtype: np.full(shape, value, dtype).view(DeviceArray),
        zeros=lambda shape, dtype: np.zeros(shape, dtype).view(DeviceArray),
    )


def _empty(shape: Any, dtype: Any) -> NDArray[Any]:
    array = np.empty(shape, dtype)
    array.view(np.uint8)[...] = UNKNOWN
    return array.view(DeviceArray)


def _word(argument: Any) -> NDArray[Any]:
    """Return an array that holds an argument as it is passed: an address, or a number or a structure by value."""
    if isinstance(argument, DeviceArray):
        return np.array([argument.ctypes.data], np.uint64)
    if isinstance(argument, np.ndarray):
        assert argument.size == 1, "an array that is not on the GPU"
        return argument
    assert isinstance(argument, np.generic), f"{argument!r} has no size"
    return np.array([argument])
