"""Run ffmpeg, as imageio-ffmpeg ships it, on files that may come from anybody: it opens nothing else, and ends."""

from __future__ import annotations

import logging
import os
import re
import resource
import shlex
import subprocess
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from statistics import mode

import imageio_ffmpeg

from app.errors import StimuliError
from app.ffmpeg.look import BRIGHTEST, DARKEST, Look, parse_look
from ground.progress import Progress as Progress
from ground.progress import no_progress as no_progress

WORKERS = 2  # processes at once, each on one thread, so that files are reproducible
LONGEST_S = 3 * 3600  # of an ffmpeg; a minute of 4K takes half an hour to encode as AV1
MOST_MEMORY = 4 * 1024**3  # bytes; three films of 4K, one above the other, take 1.5 GB to encode
MOST_PIXELS = 2**27  # of a picture: 134 megapixels
VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi")
FORMATS: Mapping[str, str] = {  # ffmpeg's name of a file's format, by suffix; left to guess, it also takes playlists
    **dict.fromkeys((".mp4", ".mov", ".m4v"), "mov"),
    **dict.fromkeys((".mkv", ".webm"), "matroska"),
    **dict.fromkeys((".jpg", ".jpeg"), "jpeg_pipe"),
    **dict.fromkeys((".tif", ".tiff"), "tiff_pipe"),
    ".avi": "avi",
    ".png": "png_pipe",
    ".bmp": "bmp_pipe",
    ".ppm": "ppm_pipe",
    ".pgm": "pgm_pipe",
}
CUT_OFF = "it is cut off, or no film of the kind that its name says: copy it again whole, or export it again"
MEANINGS = {  # what ffmpeg says of frequent faults, and what they are
    **dict.fromkeys(("moov atom not found", "ended prematurely", "Truncating packet", "partial file"), CUT_OFF),
    **dict.fromkeys(("EBML", "Error opening input"), CUT_OFF),
    "matches no streams": "it holds no pictures, or is cut off",
    "no decoder found": "its codec is not known here: export it again, as H.264 for example",
    "Non-monotonic DTS": "its pictures' times run backwards, as where films were joined: export it again",
    "Cannot allocate memory": "it takes more memory than there is",
    "No space left on device": "the disk is full",
}
DAMAGED = "it is damaged: copy it again whole, or export it again"  # whatever else ffmpeg says
PICTURES_FOR_RANGE = 24  # at most, and only such as are coded by themselves
_MEAN_LUMA = "lavfi.signalstats.YAVG"
_LOOKING = ("-map", "0:v:0", "-vf", "sidedata=delete:SEI_UNREGISTERED,showinfo=checksum=0", "-fps_mode", "passthrough")
_FAULT = re.compile(r"^(?:\[[^\]\n]* @ [^\]\n]*\] )*\[(?:error|fatal|panic)\] (.*)$", re.MULTILINE)
_WHOLE_LINE = re.compile(
    r"\[Parsed_showinfo\w* @ \w+\] \[info\] (?:config .*|n: .* type:\S ?|  side data - .*"
    r"|color_range:\S+ color_space:\S+ color_primaries:\S+ color_trc:\S+ ?)"
    r"|\[info\] (?:  .*|Output #.*|frame= .*)|\[out#.*|"
)
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class VideoFacts:
    """Facts about a video, measured by decoding it.

    Parameters
    ----------
    width, height : of the decoded pictures after rotation, pixels
    fps, n_frames : of the first track of pictures
    pixel_shape : width of a pixel by its height; 1: browsers show the film in its own size
    look : how its pictures are meant; None: not asked for
    """

    width: int
    height: int
    fps: float
    n_frames: int
    pixel_shape: Fraction = Fraction(1)
    look: Look | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        shape = "" if self.pixel_shape == 1 else f", pixels {self.pixel_shape.numerator}:{self.pixel_shape.denominator}"
        return f"{self.n_frames} frames at {self.fps:.6g}/s of {self.width}x{self.height}{shape}"


def decode(path: Path) -> VideoFacts:
    """Decode a whole video and return its facts.

    Raises
    ------
    StimuliError
        If there is no such file, it does not decode from beginning to end, or its frames are not equally far apart.
    """
    _check_there(path)
    complaint = f"{path}: cannot be decoded as a video"
    text, told = _run(["-xerror", *reading(path), *_LOOKING, "-f", "framecrc", "-"], complaint, is_told=True)
    if _is_torn(told):
        run_ffmpeg(["-xerror", *reading(path), "-map", "0:v:0", "-f", "null", "-"], complaint)
    size = re.search(r"^#dimensions 0: (\d+)x(\d+)$", text, re.MULTILINE)
    base = re.search(r"^#tb 0: (\d+)/(\d+)$", text, re.MULTILINE)
    times = [int(line.split(",")[2]) for line in text.splitlines() if line and not line.startswith("#")]
    if not size or not base or not times:
        raise StimuliError(f"{path}: holds no picture")
    steps = [later - earlier for earlier, later in pairwise(times)] or [1]
    ticks_per_s = int(base[2]) / int(base[1])
    fps = ticks_per_s / max(mode(steps), 1)
    if len(set(steps)) > 1:
        shortest, longest = (1000 * step / ticks_per_s for step in (min(steps), max(steps)))
        raise StimuliError(
            f"{path}: its frames are {shortest:.4g} to {longest:.4g} ms apart, expected one constant frame rate",
            by_command=f"encode it again by `ffmpeg -i {shlex.quote(path.name)} -r {fps:.4g} -crf 10 NEW.mp4`",
            on_page=f"export it again from the program that made it, with a constant rate of {fps:.4g} frames a second",
        )
    look = _look(path, told)
    if look.lacks_range:
        look = replace(look, beyond=_beyond_limited_range(path, length_s=len(times) / fps))
    return VideoFacts(int(size[1]), int(size[2]), fps, len(times), look.pixel_shape, look)


def _beyond_limited_range(path: Path, *, length_s: float) -> float:
    """Return the share of luma beyond the limited range, in pictures from all over a film."""
    is_beyond = f"format=yuv444p10,lutyuv=y=if(lt(val\\,{4 * DARKEST})+gt(val\\,{4 * BRIGHTEST})\\,1000\\,0)"
    spread = f"select=isnan(prev_selected_t)+gte(t-prev_selected_t\\,{length_s / PICTURES_FOR_RANGE:.6f})"
    told = f"signalstats,metadata=mode=print:key={_MEAN_LUMA}:file=-"
    command = ["-skip_frame", "nokey", *reading(path), "-map", "0:v:0", "-vf", f"{spread},{is_beyond},{told}"]
    text = run_ffmpeg([*command, "-f", "null", "-"], f"{path}: cannot be decoded as a video")
    means = [float(line.partition("=")[2]) for line in text.splitlines() if line.startswith(_MEAN_LUMA)]
    return sum(means) / max(len(means), 1) / 1000


def look_at(path: Path) -> Look:
    """Return how a film looks by its first picture; `decode` looks at all.

    Raises
    ------
    StimuliError
        If there is no such file, or its first picture cannot be decoded.
    """
    _check_there(path)
    status = path.stat()
    return _first_look(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=1024)
def _first_look(path: Path, _changed_ns: int, _size: int) -> Look:
    command = ["-xerror", *reading(path), *_LOOKING, "-frames:v", "1", "-f", "null", "-"]
    _, told = _run(command, f"{path}: cannot be decoded as a video", is_told=True)
    return _look(path, told)


def _check_there(path: Path) -> None:
    if not path.is_file():
        raise StimuliError(f"{path}: there is no such file")
    if path.stat().st_size == 0:
        raise StimuliError(f"{path}: is empty (0 bytes): copy it again")


def _look(path: Path, told: str) -> Look:
    try:
        return parse_look(told)
    except ValueError as error:
        raise StimuliError(f"{path}: {error}; export it again from the program that made it") from error


def _is_torn(told: str) -> bool:
    """Tell whether something stands within a line of a log: ffmpeg's threads write at once, then without a level."""
    return not all(_WHOLE_LINE.fullmatch(line) for line in told.partition("Stream mapping:")[2].splitlines())


def reading(path: Path) -> list[str]:
    """Return the arguments by which ffmpeg reads a file in the format of its suffix, and opens nothing else.

    Raises
    ------
    StimuliError
        If no film or picture has this suffix.
    """
    if (suffix := path.suffix.lower()) not in FORMATS:
        raise StimuliError(f"{path}: ends in {suffix or 'nothing'}, expected one of {', '.join(FORMATS)}")
    bounds = ["-threads", "1", "-max_pixels", str(MOST_PIXELS), "-protocol_whitelist", "file"]
    return [*bounds, "-f", FORMATS[suffix], "-i", f"file:{path}"]


def run_ffmpeg(arguments: Iterable[str], complaint: str) -> str:
    """Run ffmpeg and return its output; `complaint` begins the message of a failure."""
    return _run(arguments, complaint)[0]


def _run(arguments: Iterable[str], complaint: str, *, is_told: bool = False) -> tuple[str, str]:
    """Run ffmpeg and return its output and its log, which has more than errors where it is to tell."""
    level = "level+info" if is_told else "level+error"
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", level, "-nostdin", "-nostats", "-hide_banner", *arguments]
    quiet = {**os.environ, "SVT_LOG": "1"}  # the AV1 encoder prints errors only
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, errors="replace", env=quiet) as process:
        with suppress(ProcessLookupError, AttributeError):  # AttributeError: only Linux has it
            resource.prlimit(process.pid, resource.RLIMIT_DATA, (MOST_MEMORY, MOST_MEMORY))
        try:
            output, errors = process.communicate(timeout=LONGEST_S)
        except BaseException as error:
            process.kill()
            if isinstance(error, subprocess.TimeoutExpired):
                raise StimuliError(f"{complaint}: it takes longer than {LONGEST_S // 3600} hours") from error
            raise
    if process.returncode != 0 or _FAULT.search(errors):
        fault = _FAULT.search(errors)
        raise StimuliError(f"{complaint}: {_in_plain_words(fault[1] if fault else f'exit {process.returncode}')}")
    return output, errors


def _in_plain_words(reason: str) -> str:
    """Return what ffmpeg's complaint means; its own words go to the log."""
    log.info("ffmpeg: %s", reason)
    return next((plain for words, plain in MEANINGS.items() if words in reason), DAMAGED)


def in_parallel(jobs: Sequence[tuple[str, Callable[[], None]]], progress: Progress) -> None:
    """Run jobs in parallel, each waiting for a process; the first error cancels those that have not begun."""
    progress("", 0, len(jobs))
    with ThreadPoolExecutor(WORKERS) as pool:
        names = {pool.submit(job): name for name, job in jobs}
        try:
            for done, future in enumerate(as_completed(names), start=1):
                future.result()
                progress(names[future], done, len(jobs))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
