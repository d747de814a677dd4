"""The report of a stimulus set's films against the reference's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from recon.validation.films.film import MeasuredFilm
from recon.validation.films.kinds import ACTOR
from recon.validation.films.tables import measured_values
from recon.validation.page import PALETTE, Section, free_name, save_picture, write_figure, write_report

WIDTH_PX, HEIGHT_PX = 560, 90


def write_films_report(report: Mapping[str, Any], films: Sequence[MeasuredFilm], out: Path) -> Path:
    """Write report.json, tables, figures and report.html; returns the HTML's path.

    Parameters
    ----------
    report, films : as from `measure_films`
    out : folder
    """
    title, tables = f"Films against {report['settings']['reference']}", {"films": report["films"]}
    return write_report(out, title, report, tables, partial(_sections, report, films), measured_values(films))


def _sections(report: Mapping[str, Any], films: Sequence[MeasuredFilm], out: Path) -> list[Section]:
    """Return the page's sections, whose figures are written into a folder."""
    datasets = list(dict.fromkeys(film.pair.film.dataset for film in films))
    return [
        Section("Films", _films_text(report)),
        *(_dataset_section(report, [f for f in films if f.pair.film.dataset == name], out) for name in datasets),
    ]


def _films_text(report: Mapping[str, Any]) -> str:
    settings = report["settings"]
    step = "every frame" if settings["every"] == 1 else f"one frame in {settings['every']}"
    texts = [
        f"Each film is compared with that of {settings['reference']} on the same path, {step} of the "
        f"{settings['measured']}, in luma. Means over the frames; measures.csv holds the harmonic means, the "
        f"percentile beyond which the worst {settings['worst_percent']} % of the frames lie, and every frame.",
        *(f"{remark[0].upper()}{remark[1:]}." for remark in report["remarks"]),
    ]
    return " ".join(texts)


def _dataset_section(report: Mapping[str, Any], films: Sequence[MeasuredFilm], out: Path) -> Section:
    dataset = films[0].pair.film.dataset
    rows = [row for row in report["films"] if row["dataset"] == dataset]
    has_masks = films[0].pair.has_masks
    text = (
        "“Actor” is what the film or its reference shows of the model, “frame” the whole picture. Flicker is "
        f"{'the actor' if has_masks else 'the frame'}'s."
    )
    svg = write_figure(out / free_name(out, f"{dataset}_frames"), frames_chart(films))
    figures: list[tuple[str, str | bytes]] = [("Each frame of each film, over time.", svg)]
    for film in films:
        picture = save_picture(out, f"{dataset}_{film.pair.film.approach}_worst", film.worst.picture)
        caption = f"{film.pair.film.approach}: its worst frame, {film.worst.number}, by SSIM ({film.worst.ssim:.3f})"
        figures.append((f"{caption}{'; in orange the outline of the actor' if has_masks else ''}.", picture))
    return Section(dataset, text, _wide(rows, films[0]), figures)


def _wide(rows: Sequence[Mapping[str, Any]], film: MeasuredFilm) -> list[dict[str, Any]]:
    """Lay out means, a row for each approach and region."""
    table: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        region = "actor" if row["region"] == "actor" else "frame"
        cells = table.setdefault((row["approach"], region), {"approach": row["approach"], "region": region})
        cells[film.kind(row["measure"]).heading] = "∞" if row["mean"] is None else row["mean"]
    columns = dict.fromkeys(film.kind(row["measure"]).heading for row in rows)
    return [
        {"approach": cells["approach"], "region": cells["region"]} | {title: cells.get(title) for title in columns}
        for cells in table.values()
    ]


def frames_chart(films: Sequence[MeasuredFilm]) -> Any:
    """Draw each measure over time, a line for each approach; of the actor where there are masks."""
    import altair as alt

    names = dict.fromkeys(name.removesuffix(ACTOR) for name in films[0].values if not films[0].kind(name).is_of_film)
    approaches = [film.pair.film.approach for film in films]
    colour = alt.Color("approach:N", title=None, sort=approaches, scale=alt.Scale(range=list(PALETTE)))
    dash = alt.StrokeDash("approach:N", legend=None, sort=approaches)
    charts = []
    for name in names:
        measure = name + ACTOR if name + ACTOR in films[0].values else name
        title = films[0].kind(name).heading + (", actor" if films[0].is_of_actor(measure) else "")
        values = [
            {"s": frame / film.pair.facts.fps, "value": value, "approach": film.pair.film.approach}
            for film in films
            for frame, value in zip(film.frames, film.values[measure], strict=True)
            if np.isfinite(value)
        ]
        y = alt.Y("value:Q", title=None, scale=alt.Scale(zero=False), axis=alt.Axis(tickCount=4))
        line = alt.Chart(alt.Data(values=values)).mark_line(strokeWidth=1.5)
        line = line.encode(x=alt.X("s:Q", title="time, s"), y=y, color=colour, strokeDash=dash)
        charts.append(line.properties(width=WIDTH_PX, height=HEIGHT_PX, title=alt.Title(title, anchor="start")))
    return alt.vconcat(*charts, spacing=8)
