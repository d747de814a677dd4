"""Pictures to video and back, through the ffmpeg program that imageio-ffmpeg brings.

OpenCV's wheels cannot encode H.264. Its reader and that of imageio-ffmpeg return all 100 frames of a file with 400
damaged bytes without an error, and decode ours with a root mean square error of 3.4 grey levels, where this module
refuses the first and reaches 2.7 with the second. Neither joins videos without encoding them again.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import IO

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from recon.runtime.files import whole_file, why_no_file

GOP = 25  # frames from one entry point to the next, which a player can jump to
ENCODER_THREADS = 2  # part of the result: x264 writes other bytes for another number
# Full chroma resolution and exact rounding on the way from RGB; the same bytes whatever the processor can do.
SCALER = "bitexact+accurate_rnd+full_chroma_int"
QUIET = ("-hide_banner", "-loglevel", "error", "-y")
STRICT = ("-hide_banner", "-loglevel", "error", "-xerror", "-err_detect", "explode")
CONTAINER = ("-fflags", "+bitexact", "-map_metadata", "-1", "-movflags", "+faststart", "-f", "mp4")
BT709 = "setparams=range=tv:color_primaries=bt709:color_trc=bt709:colorspace=bt709"  # options give way to the pictures'


@dataclass(frozen=True)
class Encoding:
    """x264's constant rate factor (lower is better and larger) and preset (how hard it tries to be small)."""

    crf: int
    preset: str = "medium"


DELIVERED = Encoding(18)  # measured 51 to 56 dB on rendered people, 3 to 6 MB for 15 s of full HD
MASTER = Encoding(4, "veryfast")  # 61 dB and more; medium takes 2.4 times as long for a file of the same size
SILHOUETTE = Encoding(0, "veryfast")  # lossless; 0.2 to 0.6 MB for 4 s of full HD

# ffmpeg opens the file alone, as what it is: a playlist that is called a film would lead it to other files and servers.
FILE_ALONE = ("-protocol_whitelist", "file", "-format_whitelist", "mov,matroska,webm,avi")
STUDIO_RANGE = "scale=out_range=tv"  # changes films of full range alone, as phones and screen recorders make them


class VideoError(ValueError):
    """A video that cannot be written or read; the message names the file and quotes ffmpeg."""


@dataclass(frozen=True)
class VideoFacts:
    """Size in pixels, frames a second, number of frames, and codec as ffmpeg names it, of a video file."""

    width: int
    height: int
    fps: float
    n_frames: int
    codec: str


def write_video(
    path: Path,
    frames: Iterable[NDArray[np.uint8]],
    *,
    size: tuple[int, int],
    fps: float,
    encoding: Encoding = DELIVERED,
) -> VideoFacts:
    """Encode frames as H.264 in MP4: the same frames give the same bytes.

    Closed groups of 25 frames, BT.709, 4:2:0, the index before the pictures so that playing starts at once.

    Parameters
    ----------
    path : where to, ending in .mp4; whole or absent afterwards
    frames : uint8 (H, W, 3) each, sRGB
    size : (width, height), pixels, both even
    fps : frames a second
    encoding : `DELIVERED` for participants, `MASTER` to make other videos from

    Raises
    ------
    VideoError
        If the size is odd, a frame has another size or type, there is no frame, or ffmpeg fails.
    """
    return write_videos({path: encoding}, frames, size=size, fps=fps)


def write_videos(
    encodings: Mapping[Path, Encoding], frames: Iterable[NDArray[np.uint8]], *, size: tuple[int, int], fps: float
) -> VideoFacts:
    """Encode the same frames several times in one pass, for example as a video and its master.

    Parameters
    ----------
    encodings : of each video to write
    frames : uint8 (H, W, 3) each, sRGB
    size : (width, height), pixels, both even
    fps : frames a second

    Raises
    ------
    VideoError
        As `write_video` does.
    """
    for path in encodings:
        _check_request(path, size)
    with ExitStack() as files:
        targets = {path: files.enter_context(whole_file(path)) for path in encodings}
        with ExitStack() as encoders:
            pipes = [
                encoders.enter_context(_encoder(path, targets[path], size, fps, encoding))
                for path, encoding in encodings.items()
            ]
            n_frames = _feed(pipes, next(iter(encodings)), frames, size)
        for path, target in targets.items():
            facts = probe_video(target)
            if facts.n_frames != n_frames:
                raise VideoError(f"{path}: {n_frames} frames went in, {facts.n_frames} came out")
    return facts


def probe_video(path: Path) -> VideoFacts:
    """Read the facts of a video, counted frame by frame from its packets.

    Raises
    ------
    VideoError
        If the file is missing or holds no video that ffmpeg can read.
    """
    if not path.is_file():
        raise VideoError(f"{path}: {why_no_file(path)}")
    command = [*_reader(path), "-map", "0:v:0", "-c", "copy", "-f", "framecrc", "-"]
    lines = run_ffmpeg(command, f"{path}: cannot be read as a video").decode("utf-8", "replace").splitlines()
    header = dict(line[1:].split(": ", 1) for line in lines if line.startswith("#") and ": " in line)
    packets = [line.split(",") for line in lines if line and not line.startswith("#")]
    if "dimensions 0" not in header or not packets:
        raise VideoError(f"{path}: holds no video")
    width, height = (int(number) for number in header["dimensions 0"].split("x"))
    tick = Fraction(header["tb 0"])
    duration = sum(int(packet[3]) for packet in packets) * tick
    fps = float(len(packets) / duration) if duration else 0.0
    return VideoFacts(width, height, round(fps, 3), len(packets), header["codec_id 0"])


def read_video(path: Path) -> Iterator[NDArray[np.uint8]]:
    """Decode the frames of a video, uint8 (H, W, 3), sRGB.

    Raises
    ------
    VideoError
        If the file is missing, or any of it cannot be decoded.
    """
    facts = probe_video(path)
    for frame in _decoded(path, facts, "rgb24", facts.width * facts.height * 3):
        yield frame.reshape(facts.height, facts.width, 3)


def read_luma(path: Path) -> Iterator[NDArray[np.uint8]]:
    """Decode the luma of a 4:2:0 video's frames, uint8 (H, W), 16 to 235: as stored, but where it is of full range.

    Raises
    ------
    VideoError
        As `read_video` does.
    """
    facts = probe_video(path)
    chroma = ((facts.width + 1) // 2) * ((facts.height + 1) // 2)
    for frame in _decoded(path, facts, "yuv420p", facts.width * facts.height + 2 * chroma):
        yield frame[: facts.width * facts.height].reshape(facts.height, facts.width)


def join_videos(path: Path, parts: Sequence[Path]) -> VideoFacts:
    """Put videos that were encoded alike one after another, their pictures as they are: the same parts, the same bytes.

    Raises
    ------
    VideoError
        If there is no part, one cannot be read, or the whole has not their frames at equal distances.
    """
    if not parts:
        raise VideoError(f"{path}: there are no videos to join")
    n_frames = sum(probe_video(part).n_frames for part in parts)
    with whole_file(path) as target, tempfile.NamedTemporaryFile("w", suffix=".txt", encoding="utf-8") as listing:
        listing.writelines(f"file {_quoted(part.resolve())}\n" for part in parts)
        listing.flush()
        source = ("-f", "concat", "-safe", "0", "-i", listing.name)
        command = [*QUIET, "-xerror", *source, "-c", "copy", *CONTAINER, str(target)]
        run_ffmpeg(command, f"{path}: could not be joined")
        facts = probe_video(target)
        if facts.n_frames != n_frames:
            raise VideoError(f"{path}: its parts have {n_frames} frames, {facts.n_frames} came out")
    return facts


def _check_request(path: Path, size: tuple[int, int]) -> None:
    if size[0] % 2 or size[1] % 2 or min(size) < 2:
        raise VideoError(f"{path}: a video of {size[0]}x{size[1]} pixels was asked for; width and height must be even")
    if path.suffix.lower() != ".mp4":
        raise VideoError(f"{path}: the name of a video must end in .mp4")


def _encoder_command(path: Path, size: tuple[int, int], fps: float, encoding: Encoding) -> list[str]:
    rate = str(Fraction(fps).limit_denominator(1001))
    return [
        *(imageio_ffmpeg.get_ffmpeg_exe(), *QUIET),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-framerate", rate, "-i", "pipe:0"),
        *("-vf", f"scale=out_color_matrix=bt709:out_range=tv:flags={SCALER},format=yuv420p,{BT709}"),
        *("-c:v", "libx264", "-preset", encoding.preset, "-crf", str(encoding.crf), "-threads", str(ENCODER_THREADS)),
        *("-g", str(GOP), "-keyint_min", str(GOP), "-sc_threshold", "0", "-flags", "+cgop+bitexact"),
        *CONTAINER,
        str(path),
    ]


@contextmanager
def _encoder(path: Path, target: Path, size: tuple[int, int], fps: float, encoding: Encoding) -> Iterator[IO[bytes]]:
    """Open a pipe into an encoder that writes `target`, whose final name is `path`."""
    with tempfile.TemporaryFile() as complaints:
        process = subprocess.Popen(
            _encoder_command(target, size, fps, encoding),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=complaints,
        )
        assert process.stdin is not None  # it was opened as a pipe
        try:
            with suppress(BrokenPipeError), process.stdin:  # ffmpeg has stopped; its exit code and words say why
                yield process.stdin
        except BaseException:
            process.kill()
            raise
        finally:
            code = process.wait()
        if code != 0:
            raise VideoError(f"{path}: could not be encoded: {_last_words(_read_again(complaints), code)}")


def _feed(pipes: list[IO[bytes]], path: Path, frames: Iterable[NDArray[np.uint8]], size: tuple[int, int]) -> int:
    """Write frames to encoders and count them."""
    n_frames = 0
    shape = (size[1], size[0], 3)
    for frame in frames:
        if frame.shape != shape or frame.dtype != np.uint8:
            raise VideoError(f"{path}: frame {n_frames} is {frame.dtype} {frame.shape}, expected uint8 {shape}")
        for pipe in pipes:
            pipe.write(np.ascontiguousarray(frame).data)
        n_frames += 1
    if n_frames == 0:
        raise VideoError(f"{path}: there are no frames to write")
    return n_frames


def _decoded(path: Path, facts: VideoFacts, pixels: str, n_bytes: int) -> Iterator[NDArray[np.uint8]]:
    """Decode raw frames of a video, flat; exactly as many as it holds."""
    conversion = f"scale=in_color_matrix=bt709:in_range=tv:flags={SCALER}" if pixels == "rgb24" else STUDIO_RANGE
    raw = ("-vf", conversion, "-fps_mode", "passthrough", "-pix_fmt", pixels, "-f", "rawvideo", "-")
    command = [imageio_ffmpeg.get_ffmpeg_exe(), *_reader(path), *raw]
    with tempfile.TemporaryFile() as complaints:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=complaints)
        assert process.stdout is not None  # it was opened as a pipe
        n_frames = 0
        try:
            while len(frame := process.stdout.read(n_bytes)) == n_bytes:
                n_frames += 1
                yield np.frombuffer(frame, dtype=np.uint8)
            code = process.wait()
        finally:
            process.kill()
            process.stdout.close()
            process.wait()
        if code != 0 or n_frames != facts.n_frames:
            words = _last_words(_read_again(complaints), code)
            raise VideoError(f"{path}: {n_frames} of {facts.n_frames} frames could be decoded: {words}")


def run_ffmpeg(arguments: Sequence[str], failure: str, folder: Path | None = None) -> bytes:
    """Run ffmpeg and return its standard output.

    Parameters
    ----------
    arguments : without the program
    failure : how a VideoError begins
    folder : where it works
    """
    command = [imageio_ffmpeg.get_ffmpeg_exe(), *arguments]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, cwd=folder)
    if done.returncode != 0:
        raise VideoError(f"{failure}: {_last_words(done.stderr, done.returncode)}")
    return done.stdout


def _quoted(path: Path) -> str:
    """Quote a path for ffmpeg's lists."""
    return "'" + str(path).replace("'", "'\\''") + "'"


def _reader(path: Path) -> list[str]:
    """Return the arguments of an ffmpeg that reads a file and stops at the first fault instead of hiding it."""
    return [*STRICT, *FILE_ALONE, "-i", f"file:{path}"]


def _read_again(file: IO[bytes]) -> bytes:
    file.seek(0)
    return file.read()


def _last_words(complaints: bytes, code: int) -> str:
    lines = complaints.decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else f"ffmpeg stopped with code {code} and gave no reason"
