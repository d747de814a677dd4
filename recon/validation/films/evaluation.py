"""Measures of every film of a stimulus set against the reference's film of the same scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from recon.render.encoding.quality import WINDOW_PX
from recon.runtime.workers import Progress, no_progress, open_pool
from recon.validation.films.film import MeasuredFilm, measure_film
from recon.validation.films.likeness import SMALLEST_PX
from recon.validation.films.perceptual import Perceptual
from recon.validation.films.programs import FilmPrograms
from recon.validation.films.stimuli import Pair, paired, read_films
from recon.validation.films.tables import WORST_PERCENT, pooled_rows, study_measures
from recon.validation.films.vmaf import MODEL, has_vmaf


@dataclass(frozen=True)
class FilmSettings:
    """Options of the evaluation.

    Parameters
    ----------
    reference : the approach, or other condition, that the others are compared with
    masters : whether to measure the near-lossless masters instead of the videos that participants see
    every : measure each `every`-th frame only, from the first on
    workers : local processes, one film each; 1 works in this process
    perceptual, programs : measures by other packages, and by programs
    """

    reference: str
    masters: bool = False
    every: int = 1
    workers: int = 1
    perceptual: Perceptual = field(default_factory=Perceptual)
    programs: FilmPrograms = field(default_factory=FilmPrograms)


def measure_films(
    stimulus_set: Path, settings: FilmSettings, progress: Progress = no_progress
) -> tuple[dict[str, Any], list[MeasuredFilm]]:
    """Compare every film of a set with the reference's; returns the content of report.json, and the frames' measures.

    Parameters
    ----------
    stimulus_set : its folder or its manifest
    settings : options of the evaluation
    progress : told after each frame, or after each film where several processes work

    Raises
    ------
    ValueError
        If the set cannot be read, nothing in it can be compared, films differ in size, rate or length, or one cannot be
        decoded.
    """
    if settings.every < 1:
        raise ValueError(f"every is {settings.every}, expected 1 or more")
    settings.perceptual.check()
    pairs, remarks = paired(read_films(stimulus_set, masters=settings.masters), settings.reference)
    for pair in pairs:
        if min(pair.facts.width, pair.facts.height) < WINDOW_PX:
            raise ValueError(f"{pair.film.video}: is smaller than SSIM's window of {WINDOW_PX} pixels")
    remarks += _missing_measures(pairs)
    films = _measured(pairs, settings, progress)
    report = {
        "schema_version": 1,
        "kind": "films",
        "settings": {
            "set": str(stimulus_set),
            "reference": settings.reference,
            "measured": "masters" if settings.masters else "videos",
            "every": settings.every,
            "worst_percent": WORST_PERCENT,
            "vmaf_model": MODEL if has_vmaf() else None,
            **({"display": asdict(settings.perceptual.display)} if settings.perceptual.names else {}),
        },
        "remarks": remarks + _infinite(films),
        "films": [row for film in films for row in pooled_rows(film)],
    }
    return report | {"measures": study_measures(films)}, films


def _measured(pairs: Sequence[Pair], settings: FilmSettings, progress: Progress) -> list[MeasuredFilm]:
    """Measure films, here or in several processes, in the order of the pairs."""
    total = sum(len(range(0, pair.facts.n_frames, settings.every)) for pair in pairs)
    done = 0

    def tell(n_frames: int) -> None:
        nonlocal done
        done += n_frames
        progress("frames", done, total)

    tell(0)
    films: dict[str, MeasuredFilm] = {}
    is_alone = settings.workers == 1
    with open_pool(settings.workers) as pool:
        measure = partial(
            measure_film,
            every=settings.every,
            threads=pool.threads,
            perceptual=settings.perceptual,
            programs=settings.programs,
            tell=tell if is_alone else None,
        )
        for film in pool.run([partial(measure, pair) for pair in pairs]):
            films[film.pair.film.name] = film
            if not is_alone:
                tell(len(film.frames))
    return [films[pair.film.name] for pair in pairs]


def _missing_measures(pairs: Sequence[Pair]) -> list[str]:
    remarks = []
    if not has_vmaf():
        remarks.append("the ffmpeg that is used has no filter libvmaf: there is no VMAF; see IMAGEIO_FFMPEG_EXE")
    small = {pair.film.dataset: pair.facts for pair in pairs if min(pair.facts.width, pair.facts.height) < SMALLEST_PX}
    remarks += [
        f"{dataset}: there is no MS-SSIM of pictures of {facts.width}x{facts.height}; it needs {SMALLEST_PX} pixels a "
        "side"
        for dataset, facts in small.items()
    ]
    return remarks


def _infinite(films: Sequence[MeasuredFilm]) -> list[str]:
    equal = {film.pair.film.name: np.isinf(film.values["psnr_y"]) for film in films}
    return [
        f"{name}: {is_equal.sum()} frames equal the reference's; their PSNR is infinite, and so is its mean"
        + ("" if is_equal.all() else " (not the harmonic one)")
        for name, is_equal in equal.items()
        if is_equal.any()
    ]
