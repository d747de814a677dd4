"""Pooling of a film's measures over its frames, and the tables that hold them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.validation.films.film import MeasuredFilm
from recon.validation.films.kinds import Kind
from recon.validation.measures import BETTER, LESS, Measured, Subject, measure_rows

WORST_PERCENT = 5  # this share of the frames is worse than the worst percentile
SOURCE = "validate films"
BYTES = "bytes"  # a model's size, which the analysis sets beside its score


def pooled_measures(values: Sequence[float], measure: str, kind: Kind) -> dict[str, float]:
    """Pool a measure over frames: by its mean, by the harmonic mean, and by the worst percentile.

    The harmonic mean is libvmaf's, of the values plus 1, less 1, so that a frame of 0 does not make it 0; a measure of
    which less is better has none. The percentile is the 5th, or the 95th where less is better. Frames without a value
    do not count.

    Parameters
    ----------
    values : one for each frame; NaN where there is none
    measure : its name, such as "vmaf" or "ssim_actor"
    kind : what it is

    Returns
    -------
    by name: MEASURE, MEASURE_harmonic, MEASURE_p5 (or _p95); empty if no frame has a value
    """
    known = np.array([value for value in values if not np.isnan(value)])
    if not len(known):
        return {}
    if kind.is_of_film:
        return {measure: float(known[0])}
    if kind.direction == LESS:
        percent = 100 - WORST_PERCENT
        return {measure: float(known.mean()), f"{measure}_p{percent}": _percentile(known, percent)}
    with np.errstate(divide="ignore"):  # of values that are all infinite
        harmonic = float(1 / np.mean(1 / (known + 1)) - 1)
    return {
        measure: float(known.mean()),
        f"{measure}_harmonic": harmonic,
        f"{measure}_p{WORST_PERCENT}": _percentile(known, WORST_PERCENT),
    }


def measured_values(films: Sequence[MeasuredFilm]) -> list[Measured]:
    """List every measure of every film for the table of measures: pooled first, then frame by frame."""
    return [value for film in films for value in (*_pooled_values(film), *_sizes(film), *_frame_values(film))]


def pooled_rows(film: MeasuredFilm) -> Iterator[dict[str, Any]]:
    """Describe a film for report.json, a row for each measure; a value that is infinite is null."""
    for measure, values in film.values.items():
        kind = film.kind(measure)
        pooled = pooled_measures(values, measure, kind)
        if pooled:
            yield {
                "dataset": film.pair.film.dataset,
                "approach": film.pair.film.approach,
                "measure": measure,
                "unit": kind.unit,
                "better": BETTER[kind.direction],
                "region": _region(film, measure),
                "n_frames": int(np.sum(~np.isnan(values))),
                **{
                    name.removeprefix(measure).lstrip("_") or "mean": value if np.isfinite(value) else None
                    for name, value in pooled.items()
                },
            }


def study_measures(films: Sequence[MeasuredFilm]) -> list[dict[str, Any]]:
    """List the means that are finite for a study that attaches the report."""
    rows = []
    for film in films:
        subject = Subject(film.pair.film.dataset, (film.pair.film.approach,))
        for measure, values in film.values.items():
            kind = film.kind(measure)
            mean = pooled_measures(values, measure, kind).get(measure)
            rows += measure_rows(subject, measure, mean, direction=kind.direction, unit=kind.unit)
        rows += measure_rows(subject, BYTES, film.pair.film.model_bytes, direction=LESS, unit=BYTES)
    return rows


def _percentile(values: NDArray[np.float64], percent: float) -> float:
    """Return a value of the list, none between two: infinite values cannot be interpolated."""
    return float(np.percentile(values, percent, method="inverted_cdf"))


def _pooled_values(film: MeasuredFilm) -> Iterator[Measured]:
    for measure, values in film.values.items():
        for name, value in pooled_measures(values, measure, film.kind(measure)).items():
            yield _value(film, None, measure, name, value)


def _sizes(film: MeasuredFilm) -> Iterator[Measured]:
    """Yield the size of the model's files, where it is known."""
    size = film.pair.film.model_bytes
    if size is not None:
        yield Measured(
            dataset=film.pair.film.dataset,
            approach=film.pair.film.approach,
            frame=None,
            measure=BYTES,
            direction="",
            value=float(size),
            unit=BYTES,
            better=BETTER[LESS],
            source="files of the models",
        )


def _frame_values(film: MeasuredFilm) -> Iterator[Measured]:
    for measure, values in film.values.items():
        if film.kind(measure).is_of_film:
            continue
        for frame, value in zip(film.frames, values, strict=True):
            if not np.isnan(value):
                yield _value(film, frame, measure, measure, value)


def _value(film: MeasuredFilm, frame: int | None, measure: str, name: str, value: float) -> Measured:
    kind = film.kind(measure)
    return Measured(
        dataset=film.pair.film.dataset,
        approach=film.pair.film.approach,
        frame=frame,
        measure=name,
        direction="",
        value=value,
        unit=kind.unit,
        better=BETTER[kind.direction],
        source=f"{SOURCE}, {_region(film, measure)}",
    )


def _region(film: MeasuredFilm, measure: str) -> str:
    return "actor" if film.is_of_actor(measure) else "whole frame"
