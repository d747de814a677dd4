"""Films of every kind through import and browser: `python bench/film_matrix.py [--minutes 5] [--whole]`.

The kinds are the whole product of 5 codecs, 4 containers, pixel shapes, rotations, ranges, matrices, transfers, depths,
interlacing, odd sizes and sound, less what a codec or a container cannot hold: tens of thousands of films. Without
`--whole` those are made that have every three of these properties together at least once, then others by lot while
there is time; `--only bt2020nc,8` takes those alone that have these values. A film is shown right (each patch within 3
levels of what lies between the truth and what Chromium makes of a lossless film of it, which is up to 6 levels off in
blue) or refused with a way out; printed are the numbers of both, the refusals, and every film that is neither. Where 8
bits are too few for a film's own colours (BT.2020, PQ, HLG), their step counts, too.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import cache
from itertools import combinations, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page, sync_playwright

from app.errors import StimuliError
from app.ffmpeg import look_at
from app.films.pairs import FilmMaker, prepare_alone
from app.intake.import_videos import import_stimuli
from app.operations.studies.play_films import find_browser
from tests.app.intake.test_treatment import (
    HEIGHT,
    MOST_LEVELS,
    WIDTH,
    Case,
    shown,
    truth,
    write,
    write_patches,
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
WAY_OUT = "`ffmpeg"
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
    refusals : their number by the refusal's words
    wrong : what is wrong, by film
    """

    n_right: int
    n_refused: int
    refusals: Counter[str]
    wrong: dict[str, str]


def can_be(kind: Kind) -> bool:
    """Can the codec and the container hold it?"""
    held = {".mp4": ("h264", "hevc", "vp9", "av1"), ".mov": ("h264", "hevc", "prores"), ".webm": ("vp9", "av1")}
    return (
        kind.codec in held.get(kind.container, LOSSLESS)
        and (kind.codec != "prores" or kind.bits == 10)
        and not (kind.codec == "prores" and kind.color_range == "pc")  # said to be guessed
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
    rows = "444" if kind.is_odd else "422" if kind.codec == "prores" else "420"
    level = f"yuv{rows}p" + ("10le" if kind.bits == 10 else "")
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


def _encoding(kind: Kind, matrix_tag: str, primaries_tag: str) -> str:
    parts = ["-f lavfi -i sine=r=48000 -shortest -map 0:v -map 1:a"] if kind.has_sound else []
    parts.append(LOSSLESS[kind.codec].format(profile=4 if kind.is_odd else 3))
    if kind.is_interlaced:
        parts.append("-flags +ilme+ildct" + (" -x264opts tff=1" if kind.codec == "h264" else ""))
    tags = {"colorspace": matrix_tag, "color_primaries": primaries_tag}
    tags |= {"color_range": kind.color_range, "color_trc": kind.transfer}
    return " ".join([*parts, *(f"-{name} {value}" for name, value in tags.items() if value)])


def with_all_threes(seed: int) -> list[Kind]:
    """Return kinds in which every three values that go together do so at least once, then all others by lot."""
    lot = random.Random(seed)
    every = [kind for kind in map(Kind._make, product(*VALUES)) if can_be(kind)]
    missing = {three for kind in every for three in _threes(kind)}
    lot.shuffle(every)
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
    case, name = case_of(kind), HDR.get(kind.transfer, "")
    path = folder / "set" / "scene" / f"film{kind.container}"
    write(case, path)
    look = look_at(path)
    turns = case.turns if look.rotation else 0  # a container that forgets the rotation shows the film as it was
    try:
        stimulus_set = import_stimuli(folder / "set", folder / "made").stimulus_set
    except StimuliError as error:
        said = str(error).replace(str(path), "FILM")
        found.n_refused += 1
        found.refusals[said] += 1
        return "" if WAY_OUT in said else f"refused without a way out: {said}"
    (film,) = prepare_alone(stimulus_set, FilmMaker(folder))
    expected = truth(name, Case(is_grey=case.is_grey, turns=turns))
    rows, columns = expected.shape[:2]
    size, seen = shown(page, folder / film.file, rows, columns)
    wanted = case.size if turns == case.turns else case.size[:: -1 if case.turns % 2 else 1]
    tolerance = 2 * (kind.pixel_shape != "1")  # Matroska says the shape in whole pixels
    if max(abs(one - other) for one, other in zip(size, wanted, strict=True)) > tolerance:
        return f"shown as {size}, expected {wanted}"
    film_of_truth = true_film(page, name, case.is_grey, turns)
    between = np.clip(seen, np.minimum(expected, film_of_truth), np.maximum(expected, film_of_truth))
    levels = np.abs(seen - between).max()
    most = MOST_LEVELS + own_step(kind)
    found.n_right += int(levels <= most)
    return "" if levels <= most else f"up to {levels:.1f} levels from the truth, of at most {most:g}"


def own_step(kind: Kind) -> float:
    """Return by how many levels 8 bits of a film's own colours may be off where 3 levels do not hold that; else 0."""
    if kind.bits != 8:
        return 0
    return 6 if kind.transfer in HDR else 1 if kind.matrix == "bt2020nc" else 0


@cache
def true_film(page: Page, name: str, is_grey: bool, turns: int) -> NDArray[np.float64]:
    """What the browser shows of a lossless film of the truth."""
    patches = truth(name, Case(is_grey=is_grey, turns=turns))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "true" / "film.mp4"
        write_patches(patches.round().astype(np.uint8), path, Case())
        return shown(page, path, *patches.shape[:2])[1]


def named(kind: Kind) -> str:
    return " ".join(f"{name}={value}" for name, value in kind._asdict().items())


def checked(kinds: Sequence[Kind], minutes: float | None) -> Iterator[tuple[str, str, Found]]:
    """Yield each film, what is wrong with it, and what was found until then."""
    found = Found(0, 0, Counter(), {})
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
    parser.add_argument("--only", default="", help="values, by commas, that a film must have")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    found = Found(0, 0, Counter(), {})
    wanted = {value for value in arguments.only.split(",") if value}
    kinds = [kind for kind in with_all_threes(arguments.seed) if wanted <= {str(value) for value in kind}]
    for name, fault, found in checked(kinds, None if arguments.whole else arguments.minutes):
        if fault:
            found.wrong[name] = fault
            print(f"{name}: {fault}", flush=True)
    result = {field.name: getattr(found, field.name) for field in fields(found)}
    print(json.dumps({"films_of_all": len(kinds), **result}, indent=2))


if __name__ == "__main__":
    main()
