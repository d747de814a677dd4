"""Encode a film: stimuli as strips one above the other, checked frame by frame against their sources.

At a seam both edges are repeated over a guard band: neither strip bleeds into the other where the player crops.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from app.errors import StimuliError
from app.ffmpeg import VideoFacts, decode, look_at, reading, run_ffmpeg
from app.ffmpeg.colours import BT709, browser_colours
from app.files import whole_file
from app.intake.stimuli import FPS_TOLERANCE, Stimulus

GUARD_ROWS = 16  # two macroblock halves: what a deblocking filter or a scaler can reach
GOP = 25
LEAST_PSNR_DB = 25.0  # of a frame against its source; these encoders give above 35, a wrong half or a black frame 15
LEAST_LIGHTER_PSNR_DB = 20.0  # with fewer bytes above 30, and 24 even of noise
BY_NUMBER = "settb=1/1000,setpts=1000*N"  # one second per frame, whatever the file's time stamps
STILL_WIDTH = 480  # pixels of a thumbnail
RECIPE = "stacked-4"  # part of every film's key: change it when the encoding changes

H264 = "h264"
SINGLE = "single"  # H.264 of one strip without B-frames: a decoder returns every frame immediately
LIGHTER = "lighter"  # H.264 with a fraction of the bytes, for slow lines
_GOPS = f"-g {GOP} -keyint_min {GOP} -sc_threshold 0 -threads 1"
_X264 = f"-c:v libx264 -preset medium -crf 18 {_GOPS}"
ENCODERS = {
    H264: _X264,
    SINGLE: f"{_X264} -bf 0",
    LIGHTER: f"-c:v libx264 -preset medium -crf 28 {_GOPS}",
    "vp9": f"-c:v libvpx-vp9 -crf 24 -b:v 0 -deadline good -cpu-used 4 -row-mt 0 -g {GOP} -threads 1",
    "av1": f"-c:v libsvtav1 -preset 8 -crf 24 -g {GOP} -svtav1-params lp=1",
}
MEDIA_TYPES = {  # to ask a browser about; levels as two films of full HD need them
    H264: 'video/mp4; codecs="avc1.640032"',
    "vp9": 'video/mp4; codecs="vp09.00.51.08"',
    "av1": 'video/mp4; codecs="av01.0.12M.08"',
}
CONTAINER = (  # the metadata must not name a source
    "-an -map_metadata -1 -map_chapters -1 -fflags +bitexact -flags:v +bitexact -movflags +faststart"
)


@dataclass(frozen=True)
class Strips:
    """The content of a film.

    Parameters
    ----------
    stimuli : from the top
    sources : the file that each is encoded from
    codec : key of ENCODERS
    """

    stimuli: tuple[Stimulus, ...]
    sources: tuple[Path, ...]
    codec: str

    @property
    def name(self) -> str:
        return " above ".join(stimulus.name for stimulus in self.stimuli)

    @property
    def facts(self) -> VideoFacts:
        first, n = self.stimuli[0], len(self.stimuli)
        return VideoFacts(first.width, n * first.height + (n - 1) * GUARD_ROWS, first.fps, first.n_frames)


def film_key(codec: str, sha256s: Sequence[str]) -> str:
    """Return the name of a film of these sources; the same content has the same name."""
    recipe = [RECIPE, GUARD_ROWS, ENCODERS[codec], CONTAINER, *sha256s]
    return hashlib.sha256(json.dumps(recipe).encode()).hexdigest()


def make_film(strips: Strips, path: Path) -> None:
    """Encode a film and check every strip of it.

    Raises
    ------
    StimuliError
        If it cannot be encoded, or does not decode to the expected frames.
    """
    with whole_file(path) as temporary:
        encode(strips, temporary)
        _check_facts(decode(temporary), strips.facts, strips.name)
        for number, (strip, source) in enumerate(zip(strips.stimuli, strips.sources, strict=True)):
            least_db = LEAST_LIGHTER_PSNR_DB if strips.codec == LIGHTER else LEAST_PSNR_DB
            check_strip(temporary, number, strip, source, strips.name, least_db=least_db)


def encode(content: Strips, out: Path, *, part: tuple[float, int] | None = None) -> None:
    """Encode a film; `make_film` checks it, too.

    Parameters
    ----------
    part : only this: where it begins, in s, and how many frames it has

    Raises
    ------
    StimuliError
        If it cannot be encoded.
    """
    n, half = len(content.sources), GUARD_ROWS // 2
    colours = [_colours(*strip) for strip in zip(content.stimuli, content.sources, strict=True)]
    strips = [_padded(number, colours[number], half * (number > 0), half * (number < n - 1)) for number in range(n)]
    names = "".join(f"[strip{number}]" for number in range(n))
    stack = f"vstack=inputs={n}:shortest=1," if n > 1 else ""
    graph = "".join(strips) + f"{names}{stack}zscale=f=bicubic,format=yuv420p,{BT709}[film]"
    seek, most = ([], []) if part is None else (["-ss", f"{part[0]:.3f}"], ["-frames:v", str(part[1])])
    inputs = [argument for source in content.sources for argument in (*seek, *reading(source))]
    filtering = ["-filter_complex", graph, "-map", "[film]", "-fps_mode", "passthrough"]
    encoding = [*most, *ENCODERS[content.codec].split(), *CONTAINER.split(), "-f", "mp4"]
    run_ffmpeg(
        ["-xerror", *inputs, *filtering, *encoding, "-y", str(out)],
        f"{' above '.join(map(str, content.sources))}: cannot be encoded as {content.codec}",
    )


def _colours(stimulus: Stimulus, source: Path) -> str:
    """Return the filter that gives a source the colours of all films, whatever its own are."""
    return browser_colours(look_at(source), stimulus.width, stimulus.height)


def _padded(number: int, colours: str, above: int, below: int) -> str:
    """Pad a strip in full colour resolution; `smear` repeats the outermost row over the padding."""
    pad = f"pad=iw:ih+{above + below}:0:{above}"
    smear = f"fillborders=top={above}:bottom={below}:mode=smear"
    return f"[{number}:v]{colours},setsar=1,format=yuv444p,{pad},{smear}[strip{number}];"


def _check_facts(facts: VideoFacts, expected: VideoFacts, name: str) -> None:
    same_fps = abs(facts.fps - expected.fps) <= FPS_TOLERANCE * expected.fps
    if not same_fps or replace(facts, fps=expected.fps) != expected:
        raise StimuliError(f"{name}: was encoded as {facts}, expected {expected}")


def check_strip(
    film: Path, number: int, strip: Stimulus, source: Path, name: str, *, least_db: float = LEAST_PSNR_DB
) -> None:
    """Compare a film's strip, counted from the top, with its source, frame by frame.

    Raises
    ------
    StimuliError
        If a frame differs by more than encoding does.
    """
    row = number * (strip.height + GUARD_ROWS)
    graph = (
        f"[0:v]crop={strip.width}:{strip.height}:0:{row},{BY_NUMBER},format=yuv420p[strip];"
        f"[1:v]{BY_NUMBER},{_colours(strip, source)},format=yuv420p[source];[strip][source]psnr=stats_file=-"
    )
    command = [*reading(film), *reading(source), "-filter_complex", graph, "-f", "null", "-"]
    text = run_ffmpeg(command, f"{name}: cannot be compared with {source}")
    psnr_db = [float(value) for value in re.findall(r"psnr_avg:(\S+)", text)]
    if len(psnr_db) != strip.n_frames:
        raise StimuliError(f"{name}: {len(psnr_db)} frames were compared with {source}, expected {strip.n_frames}")
    if min(psnr_db) < least_db:
        raise StimuliError(
            f"{name}: frame {psnr_db.index(min(psnr_db))} differs from {source} (PSNR {min(psnr_db):.1f} dB, expected "
            f"at least {least_db:g})"
        )


def write_still(film: Path, out: Path, *, row: int, width: int, height: int) -> None:
    """Write the first picture of a pair's half as JPEG.

    Parameters
    ----------
    row : the half's first row in the film
    width, height : of the half, pixels
    """
    crop = f"crop={width}:{height}:0:{row},scale='min({STILL_WIDTH},iw)':-2"
    with whole_file(out) as temporary:
        arguments = [*reading(film), "-vf", crop, "-frames:v", "1", "-q:v", "4", "-y", str(temporary)]
        run_ffmpeg(arguments, f"{film}: has no picture")


def write_picture(source: Path, out: Path, *, frame: int, width: int) -> None:
    """Write a picture, or a frame of a video, as JPEG.

    Parameters
    ----------
    source : the picture or video
    frame : of the video, from 0; 0 for a picture
    width : of the JPEG where the source is wider, pixels
    """
    chosen = f"select=eq(n\\,{frame}),scale='min({width},iw)':-1"
    with whole_file(out) as temporary:
        arguments = [*reading(source), "-vf", chosen, "-frames:v", "1", "-q:v", "3", "-y", str(temporary)]
        run_ffmpeg(arguments, f"{source.name}: cannot be shown")
