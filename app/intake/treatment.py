"""Say what must be done to a film so that every browser shows it right, and do it: square pixels, whole pictures, SDR.

What stays as it is, is copied. What no filter can make right is refused, with the ffmpeg command that can.
"""

from __future__ import annotations

import hashlib
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from app.errors import StimuliError
from app.ffmpeg import VideoFacts, decode, look_at, reading, run_ffmpeg
from app.ffmpeg.colours import TONE_MAPPING, browser_colours, unknown_colours
from app.ffmpeg.look import LIMITED_UNTAGGED, UNTAGGED, Look
from app.files import whole_file

SUFFIX = ".mp4"  # of films that were encoded again
PREVIEW_WIDTH, PREVIEW_S = 960, 20  # pixels and seconds at most
FILM_CRF, LOSSLESS = "10", "0"  # x264's: 45 dB and more, and no loss at all
RANGES = {"limited": "tv", "full": "pc"}  # in ffmpeg's words
MOST_BEYOND = 0.002  # share of pixels beyond the limited range of a film that may have it
MANY_BEYOND = 0.05  # noise on black reaches more, so this is only said where the codec's standard says limited
_ENCODING = ("-c:v", "libx264", "-preset", "medium", "-g", "25", "-threads", "1")
_CLEAN = ("-an", "-map_metadata", "-1", "-map_chapters", "-1", "-fflags", "+bitexact", "-movflags", "+faststart")


@dataclass(frozen=True)
class Target:
    """What the films of a dataset are made alike to: size in pixels, pictures a second, and their number."""

    width: int
    height: int
    fps: float
    n_frames: int


@dataclass(frozen=True)
class Treatment:
    """What is done to a film.

    Parameters
    ----------
    filters : of ffmpeg, in this order; none: the film is copied
    done : sentences on it, for whoever imports
    facts : of what comes out
    """

    filters: tuple[str, ...]
    done: tuple[str, ...]
    facts: VideoFacts


def treatment_of(path: Path, facts: VideoFacts) -> Treatment:
    """Return what a film needs to be shown right.

    Parameters
    ----------
    path : the film, which refusals name
    facts : as `decode` measured them

    Raises
    ------
    StimuliError
        If its colours cannot be read, or it is partly transparent: names the command that makes a usable film of it.
    """
    look = facts.look
    assert look is not None, "decode looks at every film"
    _check_readable(path, facts, look)
    filters: list[str] = []
    done: list[str] = []
    width, height = facts.width, facts.height
    if look.said_range == "pc" or _lacks_range(look):
        filters.append(f"setparams=range={look.shown_range}")
        done.append(f"its values read as {'full' if look.shown_range == 'pc' else 'limited'} range, as was said")
    if look.is_interlaced:
        filters.append("bwdif=mode=send_frame")
        done.append("deinterlaced (bwdif, a picture for each two fields)")
    if width % 2 or height % 2:
        width, height = width - width % 2, height - height % 2
        filters.append(f"crop={width}:{height}:0:0:exact=1")
        done.append(f"cut from {facts.width}x{facts.height} to even numbers")
    if look.hdr:
        filters.append(browser_colours(look, width, height))
        done.append(f"{look.hdr} with a peak of {look.peak_nits:g} cd/m² tone-mapped by {TONE_MAPPING}")
    if (square := _square(width, height, facts.pixel_shape)) != (width, height):
        shape = f"{facts.pixel_shape.numerator}:{facts.pixel_shape.denominator}"
        done.append(f"scaled from {width}x{height} with pixels {shape} to {square[0]}x{square[1]} with square pixels")
        width, height = square
        filters.append(f"zscale=w={width}:h={height}:f=lanczos")
    return Treatment(
        tuple(filters), tuple(done), replace(facts, width=width, height=height, pixel_shape=Fraction(1), look=look)
    )


def conformed(treatment: Treatment, target: Target) -> Treatment:
    """Return a treatment that also makes a film like the others of its dataset.

    Raises
    ------
    ValueError
        If the film has another shape, or is shorter than the target.
    """
    facts, filters, done = treatment.facts, list(treatment.filters), list(treatment.done)
    if facts.fps != target.fps:
        filters.append(f"fps={Fraction(target.fps).limit_denominator(1001)}")
        done.append(f"its rate changed from {facts.fps:.6g} to {target.fps:.6g} pictures a second")
    if (facts.width, facts.height) != (target.width, target.height):
        if abs(facts.width * target.height / (facts.height * target.width) - 1) > 0.01:
            raise ValueError(
                f"is shown as {facts.width}x{facts.height}, another shape than the {target.width}x{target.height} of "
                "its scene's other films: cut it, or encode it again with square pixels"
            )
        filters.append(f"zscale=w={target.width}:h={target.height}:f=lanczos")
        done.append(f"scaled from {facts.width}x{facts.height} to {target.width}x{target.height}")
    n_frames = int(facts.n_frames * target.fps / facts.fps + 0.5)
    if n_frames > target.n_frames:
        done.append(f"cut after {target.n_frames} of {n_frames} pictures")
    if filters or n_frames != target.n_frames:
        filters.append(f"tpad=stop_mode=clone:stop=2,trim=end_frame={target.n_frames}")  # rounding may lack a picture
    wanted = replace(facts, width=target.width, height=target.height, fps=target.fps, n_frames=target.n_frames)
    return Treatment(tuple(filters), tuple(done), wanted)


def common_target(every: Sequence[VideoFacts]) -> Target:
    """Return the size and rate that most films of a dataset have, and the length of the shortest at this rate."""
    sizes, rates = [(facts.width, facts.height) for facts in every], [facts.fps for facts in every]
    size, fps = max(sizes, key=sizes.count), max(rates, key=rates.count)
    return Target(*size, fps, min(int(facts.n_frames * fps / facts.fps + 0.5) for facts in every))


def write_treated(source: Path, treatment: Treatment, out: Path, *, crf: str = FILM_CRF) -> VideoFacts:
    """Encode a film again by its treatment, as H.264 in BT.709; return its facts, after decoding it to its end.

    Raises
    ------
    StimuliError
        If it cannot be encoded, or what was made is not as expected.
    """
    look = treatment.facts.look
    assert look is not None, "decode looks at every film"
    colours = [] if look.hdr else [browser_colours(look, treatment.facts.width, treatment.facts.height)]
    chain = ",".join([*treatment.filters, *colours, "setsar=1", "format=yuv420p"])
    arguments = ["-xerror", *reading(source), "-map", "0:v:0", "-vf", chain, "-fps_mode", "passthrough"]
    complaint = f"{source}: cannot be made a film that browsers show right"
    run_ffmpeg([*arguments, *_ENCODING, "-crf", crf, *_CLEAN, "-f", "mp4", "-y", str(out)], complaint)
    made = decode(out)
    if replace(made, fps=treatment.facts.fps) != treatment.facts or abs(made.fps / treatment.facts.fps - 1) > 1e-3:
        raise StimuliError(f"{source}: was made a film of {made}, expected {treatment.facts}")
    return made


def preview_of(source: Path, folder: Path) -> Path:
    """Return the preview of a film, which is made in a folder unless it is there; otherwise as `write_preview`."""
    fact = source.stat()
    told = hashlib.sha256(f"{source} {fact.st_mtime_ns} {fact.st_size}".encode()).hexdigest()[:32]
    path = folder / f"preview-{told}.mp4"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        write_preview(source, path)
    return path


def write_preview(source: Path, out: Path) -> None:
    """Write the beginning of any film as one that every browser plays, small, with the film's shape and colours.

    Raises
    ------
    StimuliError
        If it cannot be decoded, or its colours cannot be read.
    """
    look = look_at(source)
    if unknown := unknown_colours(look, look.width, look.height):
        raise StimuliError(f"{source}: its colours have {unknown}")
    whole = ["bwdif=mode=send_frame"] if look.is_interlaced else []
    even = f"crop={look.width - look.width % 2}:{look.height - look.height % 2}:0:0:exact=1"
    size = f"scale=w=trunc(min({PREVIEW_WIDTH}\\,iw*max(sar\\,1))/2)*2:h=trunc(ow/dar/2)*2"
    colours = (
        f"{browser_colours(look, look.width, look.height)},format=yuv420p"  # else swscale takes its range from yuvj
    )
    chain = ",".join([*whole, even, colours, size, "setsar=1"])
    arguments = [*reading(source), "-map", "0:v:0", "-t", str(PREVIEW_S), "-vf", chain]
    encoding = ["-c:v", "libx264", "-preset", "veryfast", "-crf", "23", "-threads", "1", *_CLEAN, "-f", "mp4"]
    with whole_file(out) as temporary:
        run_ffmpeg([*arguments, *encoding, "-y", str(temporary)], f"{source.name}: cannot be shown")


def look_notes(name: str, facts: VideoFacts, treatment: Treatment) -> Iterable[str]:
    """Yield sentences on what was found in a film and done to it that its owner should know."""
    look = facts.look
    assert look is not None, "decode looks at every film"
    if treatment.done:
        yield f"{name}: {'; '.join(treatment.done)}"
    if look.has_sound:
        yield f"{name}: has sound, which is kept away from participants"
    if look.codec in LIMITED_UNTAGGED and not look.said_range and look.beyond > MANY_BEYOND:
        yield (
            f"{name}: {100 * look.beyond:.2g} % of its pixels lie beyond the limited range, by which players read films"
            " without a range; where it looks too dark and too harsh, say that it has the full range"
        )
    if look.n_films > 1:
        yield f"{name}: holds {look.n_films} tracks of pictures; the first is taken"


def colours_told(facts: VideoFacts) -> str:
    """Say how a film's colours are read: tagged or guessed."""
    look = facts.look
    assert look is not None, "decode looks at every film"
    matrix, values = look.shown_matrix(facts.width, facts.height), look.shown_range
    guessed = [] if look.matrix != UNTAGGED or look.is_rgb else ["matrix"]
    guessed += ["range"] if look.color_range == UNTAGGED and not look.said_range else []
    how = f"{' and '.join(guessed)} guessed from size and format" if guessed else "tagged"
    return f"{look.bits} bits, {'RGB' if look.is_rgb else matrix}, range {values} ({how})"


def refuse_unready(path: Path, name: str, facts: VideoFacts) -> None:
    """Refuse a film in a stimulus set that is not ready to be shown.

    Raises
    ------
    StimuliError
        Naming what is to be done: to import the films.
    """
    if needed := treatment_of(path, facts).done:
        raise StimuliError(
            f"{path}: {name} is not ready to be shown, as it must be {needed[0]}",
            by_command="`reconstudy stimuli import FOLDER -o SET` of its films does that",
            on_page="send its films alone, without the set's manifest.json: the import does that",
        )


def _check_readable(path: Path, facts: VideoFacts, look: Look) -> None:
    quoted = shlex.quote(path.name)
    if unknown := unknown_colours(look, facts.width, facts.height):
        raise StimuliError(
            f"{path}: its colours have {unknown}; expected SDR, PQ or HLG. Export it as SDR in BT.709 from the program "
            "that made it",
            by_command=f"if its colours are BT.709 and only the tag is wrong: `ffmpeg -i {quoted} -vf "
            "setparams=colorspace=bt709:color_primaries=bt709:color_trc=bt709 -crf 10 NEW.mp4`",
        )
    if look.rotation % 90:
        raise StimuliError(
            f"{path}: is to be turned by {look.rotation:g} degrees, which browsers do not do; expected quarters of a "
            "turn. Export it upright from the program that made it",
            by_command=f"or take it as it lies by `ffmpeg -noautorotate -i {quoted} -crf 10 NEW.mp4`",
        )
    if look.has_alpha:
        decoder = f"-c:v libvpx{'-vp9' if look.codec == 'vp9' else ''} " if look.hides_alpha else ""
        raise StimuliError(
            f"{path}: has transparent parts ({look.pixel_format}{' and alpha' * look.hides_alpha}), below which "
            "browsers show the page",
            by_command="lay it on black by "
            f"`ffmpeg {decoder}-i {quoted} -vf premultiply=inplace=1,format=yuv444p -crf 10 NEW.mp4`",
            on_page="export it again on a background of your choice",
        )
    if _lacks_range(look) and not look.said_range:
        raise StimuliError(
            f"{path}: does not say whether its values have the limited range (16 to 235) or the full one (0 to 255), "
            f"and {100 * look.beyond:.2g} % of its pixels lie beyond the limited one, which would be cut off",
            by_command="say which it is by `--range full` or `--range limited`",
            on_page="choose it below “brightness range where a film does not say it” and send the films again",
        )


def _lacks_range(look: Look) -> bool:
    """Tell whether nothing says a film's range, neither itself nor its codec's standard, and its values ask for it."""
    return look.codec not in LIMITED_UNTAGGED and look.beyond > MOST_BEYOND


def _square(width: int, height: int, shape: Fraction) -> tuple[int, int]:
    """Return a size with square pixels in which no row and no column is lost, in even numbers."""
    if shape >= 1:
        return _even(width * shape), height
    return width, _even(height / shape)


def _even(length: Fraction | float) -> int:
    return 2 * round(length / 2)
