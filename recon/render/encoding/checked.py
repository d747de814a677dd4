"""Videos for participants, checked frame by frame for what encoding lost."""

from __future__ import annotations

import tempfile
import zlib
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from recon.render.encoding.quality import VideoCheck, luma_of, psnr_of, ssim_of
from recon.render.encoding.video import DELIVERED, MASTER, VideoError, VideoFacts, read_luma, write_videos


def write_checked_video(
    path: Path, frames: Iterable[NDArray[np.uint8]], *, size: tuple[int, int], fps: float, master: Path | None = None
) -> tuple[VideoFacts, VideoCheck]:
    """Encode frames for participants, and a master of them, and compare every encoded frame with its original.

    The frames are asked for once: their luma is kept in a temporary file beside the video until it is compared.

    Parameters
    ----------
    path : where to, ending in .mp4
    frames : uint8 (H, W, 3) each, sRGB
    size : (width, height), pixels, both even
    fps : frames a second
    master : where to write the near-lossless master; none if not given

    Raises
    ------
    VideoError
        As `write_video` does. A video below the bar for participants raises nothing: see `VideoCheck.faults`.
    """
    encodings = {path: DELIVERED} | ({master: MASTER} if master else {})
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=path.parent) as kept:
        facts = write_videos(encodings, _keeping_luma(frames, kept), size=size, fps=fps)
        kept.seek(0)
        return facts, _compared(path, _kept_luma(kept, size))


def holds_checked_frames(path: Path, check: VideoCheck) -> bool:
    """Tell whether the frames of a video are, bit by bit, those that were checked."""
    return tuple(zlib.crc32(luma.data) for luma in read_luma(path)) == check.crc32


def check_video(path: Path, frames: Iterable[NDArray[np.uint8]]) -> VideoCheck:
    """Compare every frame of a 4:2:0 video with the frame that it was made from, in luma.

    Parameters
    ----------
    path : the video
    frames : uint8 (H, W, 3) each, sRGB, as they were given to `write_video`

    Raises
    ------
    VideoError
        If the video cannot be decoded or does not have exactly these frames.
    """
    return _compared(path, map(luma_of, frames))


def _compared(path: Path, originals: Iterable[NDArray[np.uint8]]) -> VideoCheck:
    psnr, ssim, crc32 = [], [], []
    for number, (luma, stored) in enumerate(zip_longest(originals, read_luma(path))):
        if luma is None or stored is None or luma.shape != stored.shape:
            actual, wanted = ("no frame" if image is None else f"a frame of {image.shape}" for image in (stored, luma))
            raise VideoError(f"{path}: has {actual} at number {number}, expected {wanted}")
        psnr.append(psnr_of(luma, stored))
        ssim.append(ssim_of(luma, stored))
        crc32.append(zlib.crc32(stored.data))
    return VideoCheck(tuple(psnr), tuple(ssim), tuple(crc32))


def _keeping_luma(frames: Iterable[NDArray[np.uint8]], file: IO[bytes]) -> Iterator[NDArray[np.uint8]]:
    for frame in frames:
        file.write(luma_of(frame).data)
        yield frame


def _kept_luma(file: IO[bytes], size: tuple[int, int]) -> Iterator[NDArray[np.uint8]]:
    while luma := file.read(size[0] * size[1]):
        yield np.frombuffer(luma, dtype=np.uint8).reshape(size[1], size[0])
