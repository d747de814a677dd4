"""Films of every kind through import and browser: `python bench/film_matrix.py [--minutes 5] [--whole]`.

The kinds are the whole product of 5 codecs, 4 containers, pixel shapes, rotations, ranges, matrices, transfers, depths,
interlacing, odd sizes and sound, less what a codec or a container cannot hold: tens of thousands of films. Without
`--whole` those are made that have every three of these properties together at least once, then others by lot while
there is time; `--only bt2020nc,8` takes those alone that have these values, and `--lot` draws all by lot from the whole
product.

A film is shown right (each patch within 3 levels of the truth) or refused with a way out; printed are the numbers of
both, the refusals, and every film that is neither. The truth is what the film's own values mean: decoded by ffmpeg, and
turned into colours in floating point by the formulas of the standards. What is seen are the values that the browser
decoded, turned into colours by the matrix and the range that the browser says it uses: Chromium's own drawing without a
graphics card rounds blue by up to 6 levels.
"""

from __future__ import annotations

import argparse
import base64
import json
import random
import subprocess
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from itertools import combinations, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from film_colours import FFMPEG_NAMES, PRIMARIES, Values, light_of, rgb_of, xyz_of
from playwright.sync_api import Page, sync_playwright

from app.errors import StimuliError
from app.ffmpeg import look_at
from app.ffmpeg.look import SDR_NITS, Look
from app.films.pairs import FilmMaker, prepare_alone
from app.intake.import_videos import import_stimuli
from app.operations.studies.play_films import find_browser
from tests.app.intake.test_treatment import (
    FFMPEG,
    HEIGHT,
    MOST_LEVELS,
    PLAYED,
    WIDTH,
    Case,
    mobius,
    write,
)

LOSSLESS = {
    "h264": "-c:v libx264 -qp 0",
    "hevc": "-c:v libx265 -x265-params lossless=1:log-level=none",
    "vp9": "-c:v libvpx-vp9 -lossless 1",
    "av1": "-c:v libaom-av1 -crf 4 -cpu-used 8",
    "prores": "-c:v prores_ks -profile:v {profile}",
}
HD = (1280, 720)
MATRICES = {  # of zscale, its primaries, and ffmpeg's name of both
    "bt709": ("709", "bt709", "bt709", "bt709"),
    "smpte170m": ("170m", "170m", "smpte170m", "smpte170m"),
    "bt2020nc": ("2020_ncl", "bt2020", "bt2020nc", "bt2020"),
    "untagged": ("170m", "bt709", "", ""),
    "untagged HD": ("709", "bt709", "", ""),
}
HDR = {"smpte2084": "PQ", "arib-std-b67": "HLG"}
WAYS_OUT = ("`ffmpeg", "`--range")
ASKED = "`--range"
GAMMA = 2.4  # of displays: ITU-R BT.1886
PLANES = (
    PLAYED
    + """  const frame = new VideoFrame(video);
  if (frame.format !== "I420") throw new Error(`decoded as ${frame.format}, expected I420`);
  const data = new Uint8Array(frame.allocationSize());
  const layout = await frame.copyTo(data);
  const inner = (at, length, parts) => [0.25, 0.75].map((side) => Math.floor(((at + side) * length) / parts));
  const patch = (plane, row, column) => {
    const half = plane ? 2 : 1;
    const [top, bottom] = inner(row, height / half, rows);
    const [left, right] = inner(column, width / half, columns);
    let sum = 0;
    for (let y = top; y < bottom; y++)
      for (let x = left; x < right; x++) sum += data[layout[plane].offset + y * layout[plane].stride + x];
    return sum / (bottom - top) / (right - left);
  };
  const three = (row, column) => [0, 1, 2].map((plane) => patch(plane, row, column));
  const means = [...Array(rows).keys()].map((row) => [...Array(columns).keys()].map((column) => three(row, column)));
  return [width, height, frame.colorSpace.toJSON(), means];
}"""
)  # of the inner half of each patch, luma and both chromas as they were decoded
TRIES = 60  # films by lot, of which the one with most that is new is taken


class Kind(NamedTuple):
    """What a film is, by one of the values of each property in KINDS."""

    codec: str
    container: str
    pixel_shape: str
    rotation: int
    color_range: str
    matrix: str
    transfer: str
    bits: int
    is_interlaced: bool
    is_odd: bool
    has_sound: bool


VALUES: Sequence[Sequence[object]] = (
    tuple(LOSSLESS),
    (".mp4", ".mov", ".mkv", ".webm"),
    ("1", "4/3", "8/9"),
    (0, 90, 180, 270),
    ("tv", "pc"),
    tuple(MATRICES),
    ("bt709", "iec61966-2-1", "smpte2084", "arib-std-b67"),
    (8, 10),
    (False, True),
    (False, True),
    (False, True),
)


@dataclass
class Found:
    """How many films were what, and which are wrong.

    Parameters
    ----------
    n_right, n_refused : films
    refusals : their number by the refusal's words; asked for the range, they go on with the answer
    most_levels : of a film that is right, from the truth
    wrong : what is wrong, by film
    """

    n_right: int
    n_refused: int
    refusals: Counter[str]
    most_levels: float
    wrong: dict[str, str]


def can_be(kind: Kind) -> bool:
    """Can the codec and the container hold it?"""
    held = {".mp4": ("h264", "hevc", "vp9", "av1"), ".mov": ("h264", "hevc", "prores"), ".webm": ("vp9", "av1")}
    return (
        kind.codec in held.get(kind.container, LOSSLESS)
        and (kind.codec != "prores" or kind.bits == 10)
        and not (kind.is_interlaced and kind.codec not in ("h264", "prores"))
        and not (kind.is_interlaced and kind.is_odd)
        and not (kind.is_odd and kind.matrix == "untagged HD")  # one film fewer of each size
    )


def case_of(kind: Kind) -> Case:
    """Return how to make a film of a kind, and how large it is shown."""
    matrix, primaries, matrix_tag, primaries_tag = MATRICES[kind.matrix]
    is_hdr = kind.transfer in HDR
    if is_hdr and not matrix_tag:  # as HDR without further tags is read
        matrix, primaries = "2020_ncl", "bt2020"
    level = stored_format(kind)
    light = f":t={kind.transfer}:npl=203" if is_hdr else ":t=bt709"
    color_range = {"tv": "limited", "pc": "full"}[kind.color_range]
    chain = f":m={matrix}:r={color_range}:p={primaries}{light},format={level}"
    width, height = WIDTH, HEIGHT
    if kind.matrix == "untagged HD":
        chain, (width, height) = f"{chain},scale={HD[0]}:{HD[1]}:flags=neighbor", HD
    if kind.is_odd:
        chain, width, height = f"{chain},crop={WIDTH - 1}:{HEIGHT - 1}:0:0:exact=1", WIDTH - 2, HEIGHT - 2
    said = f"range={kind.color_range}:color_trc={kind.transfer}"
    chain += f",setparams={said}:colorspace={matrix_tag or 'unknown'}:color_primaries={primaries_tag or 'unknown'}"
    shape = Fraction(kind.pixel_shape)
    chain += f",setsar={kind.pixel_shape}"
    size = (2 * round(width * shape / 2), height) if shape >= 1 else (width, 2 * round(height / shape / 2))
    return Case(
        chain,
        _encoding(kind, matrix_tag, primaries_tag),
        kind.container,
        size=size if kind.rotation in (0, 180) else (size[1], size[0]),
        turns=kind.rotation // 90,
        is_grey=is_hdr,
        before=f"-display_rotation {kind.rotation}" if kind.rotation else "",
    )


def stored_format(kind: Kind) -> str:
    """Return the pixel format in which a film of a kind is written."""
    rows = "444" if kind.is_odd else "422" if kind.codec == "prores" else "420"
    return f"yuv{rows}p" + ("10le" if kind.bits == 10 else "")


def _encoding(kind: Kind, matrix_tag: str, primaries_tag: str) -> str:
    parts = ["-f lavfi -i sine=r=48000 -shortest -map 0:v -map 1:a"] if kind.has_sound else []
    parts.append(LOSSLESS[kind.codec].format(profile=4 if kind.is_odd else 3))
    if kind.is_interlaced:
        parts.append("-flags +ilme+ildct" + (" -x264opts tff=1" if kind.codec == "h264" else ""))
    tags = {"colorspace": matrix_tag, "color_primaries": primaries_tag}
    tags |= {"color_range": kind.color_range, "color_trc": kind.transfer}
    return " ".join([*parts, *(f"-{name} {value}" for name, value in tags.items() if value)])


def by_lot(seed: int) -> list[Kind]:
    """Return all kinds in an order by lot."""
    every = [kind for kind in map(Kind._make, product(*VALUES)) if can_be(kind)]
    random.Random(seed).shuffle(every)
    return every


def with_all_threes(seed: int) -> list[Kind]:
    """Return kinds in which every three values that go together do so at least once, then all others by lot."""
    lot, every = random.Random(seed), by_lot(seed)
    missing = {three for kind in every for three in _threes(kind)}
    chosen: list[Kind] = []
    while missing:
        first = next(iter(missing))
        fits = [kind for kind in every if all(kind[at] == value for at, value in first)]
        best = max(lot.sample(fits, min(TRIES, len(fits))), key=lambda kind: len(missing & _threes(kind)))
        chosen.append(best)
        missing -= _threes(best)
    known = set(chosen)
    return [*chosen, *(kind for kind in every if kind not in known)]


def _threes(kind: Kind) -> set[tuple[tuple[int, object], ...]]:
    return set(combinations(enumerate(kind), 3))


def fault_of(kind: Kind, folder: Path, page: Page, found: Found) -> str:
    """Import a film, and compare what a browser shows of it with the truth; return what is wrong."""
    case = case_of(kind)
    path = folder / "set" / "scene" / f"film{kind.container}"
    write(case, path)
    look = look_at(path)
    turns = case.turns if look.rotation else 0  # a container that forgets the rotation shows the film as it was
    said = ""
    try:
        made = import_stimuli(folder / "set", folder / "made")
    except StimuliError as error:
        words = str(error).replace(str(path), "FILM")
        if not any(way in words for way in WAYS_OUT):
            return f"refused without a way out: {words}"
        found.refusals[words] += 1
        if ASKED not in words:
            found.n_refused += 1
            return ""
        said = {"tv": "limited", "pc": "full"}[kind.color_range]
        made = import_stimuli(folder / "set", folder / "made", untagged_range=said)
    (film,) = prepare_alone(made.stimulus_set, FilmMaker(folder))
    truth = np.rot90(colours_of(kind, path, look), turns)
    size, seen = seen_in(page, folder / film.file, *truth.shape[:2])
    wanted = case.size if turns == case.turns else case.size[:: -1 if case.turns % 2 else 1]
    tolerance = 2 * (kind.pixel_shape != "1")  # Matroska says the shape in whole pixels
    if max(abs(one - other) for one, other in zip(size, wanted, strict=True)) > tolerance:
        return f"shown as {size}, expected {wanted}"
    levels = np.abs(seen - truth).max()
    found.n_right += int(levels <= MOST_LEVELS)
    found.most_levels = max(found.most_levels, float(levels) if levels <= MOST_LEVELS else 0)
    return "" if levels <= MOST_LEVELS else f"up to {levels:.1f} levels from the truth, of at most {MOST_LEVELS}"


def seen_in(page: Page, film: Path, rows: int, columns: int) -> tuple[tuple[int, int], Values]:
    """Return the size of a film in the browser, and the mean colour of each patch, (rows, columns, 3), 0 to 255."""
    sent = [base64.b64encode(film.read_bytes()).decode(), rows, columns]
    width, height, space, means = page.evaluate(PLANES, sent)
    rgb = rgb_of(np.array(means), matrix=space["matrix"], is_full=space["fullRange"], bits=8)
    return (width, height), 255 * rgb.clip(0, 1)


def colours_of(kind: Kind, path: Path, look: Look) -> Values:
    """Return what a browser must show of each patch of a film as it is stored, (3, 4, 3), 0 to 255."""
    matrix, primaries, *_ = MATRICES[kind.matrix]
    if kind.transfer in HDR and kind.matrix.startswith("untagged"):
        matrix, primaries = "2020_ncl", "bt2020"
    is_full = kind.color_range == "pc"
    rgb = rgb_of(
        stored(path, look, kind),
        matrix=FFMPEG_NAMES.get(matrix, matrix),
        is_full=is_full,
        bits=kind.bits,
    )
    to_bt709 = np.linalg.inv(xyz_of(PRIMARIES["bt709"])) @ xyz_of(PRIMARIES[primaries])
    if kind.transfer in HDR:
        light = np.clip(light_of(rgb, kind.transfer, matrix) @ to_bt709.T, 0, None)
        brightest = np.maximum(light.max(axis=-1, keepdims=True), 1e-6)
        light *= mobius(brightest, peak=look.peak_nits / SDR_NITS) / brightest
    elif primaries == "bt709":
        return 255 * rgb.clip(0, 1)
    else:
        light = rgb.clip(0, None) ** GAMMA @ to_bt709.T
    return 255 * light.clip(0, 1) ** (1 / GAMMA)


def stored(path: Path, look: Look, kind: Kind) -> Values:
    """Return the mean luma and chroma of the inner half of each patch as the film holds them, not turned."""
    pixel_format = stored_format(kind)
    bare = [FFMPEG, "-v", "error", "-noautorotate", "-i", str(path), "-frames:v", "1", "-f", "rawvideo"]
    raw = subprocess.run([*bare, "-pix_fmt", pixel_format, "-"], check=True, capture_output=True).stdout
    values = np.frombuffer(raw, np.uint16 if kind.bits > 8 else np.uint8).astype(np.float64)
    is_turned = look.rotation % 180 != 0
    width, height = (look.height, look.width) if is_turned else (look.width, look.height)
    across = 1 if "444" in pixel_format else 2
    down = 2 if "420" in pixel_format else 1
    small = (-(-height // down), -(-width // across))
    ends = np.cumsum([0, height * width, small[0] * small[1], small[0] * small[1]])
    planes = [
        values[start:end].reshape(shape)
        for start, end, shape in zip(ends, ends[1:], [(height, width), small, small], strict=False)
    ]
    return np.stack([patch_means(plane, 3, 4) for plane in planes], axis=-1)


def patch_means(plane: Values, rows: int, columns: int) -> Values:
    """Return the mean of the inner half of each patch of a plane."""
    ys, xs = (
        [[int((at + side) * length / parts) for side in (0.25, 0.75)] for at in range(parts)]
        for length, parts in zip(plane.shape, (rows, columns), strict=True)
    )
    return np.array([[plane[top:bottom, left:right].mean() for left, right in xs] for top, bottom in ys])


def named(kind: Kind) -> str:
    return " ".join(f"{name}={value}" for name, value in kind._asdict().items())


def checked(kinds: Sequence[Kind], minutes: float | None) -> Iterator[tuple[str, str, Found]]:
    """Yield each film, what is wrong with it, and what was found until then."""
    found = Found(0, 0, Counter(), 0.0, {})
    until_s = time.monotonic() + 60 * minutes if minutes else float("inf")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_browser("auto"))
        page = browser.new_page()
        for kind in kinds:
            if time.monotonic() > until_s:
                break
            with TemporaryDirectory() as folder:
                try:
                    fault = fault_of(kind, Path(folder), page, found)
                except (subprocess.CalledProcessError, StimuliError) as error:
                    fault = f"accepted and not shown: {error}"
            yield named(kind), fault, found
        browser.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=5, help="after which no other film begins")
    parser.add_argument("--whole", action="store_true", help="the whole product, however long it takes: hours")
    parser.add_argument("--lot", action="store_true", help="draw all kinds by lot")
    parser.add_argument("--first", type=int, default=0, help="how many kinds of the drawn ones to leave out")
    parser.add_argument("--only", default="", help="values, by commas, that a film must have")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    found = Found(0, 0, Counter(), 0.0, {})
    wanted = {value for value in arguments.only.split(",") if value}
    drawn = (by_lot if arguments.lot else with_all_threes)(arguments.seed)
    kinds = [kind for kind in drawn[arguments.first :] if wanted <= {str(value) for value in kind}]
    for name, fault, found in checked(kinds, None if arguments.whole else arguments.minutes):
        if fault:
            found.wrong[name] = fault
            print(f"{name}: {fault}", flush=True)
    result = {field.name: getattr(found, field.name) for field in fields(found)}
    print(json.dumps({"films_of_all": len(kinds), **result}, indent=2))


if __name__ == "__main__":
    main()
