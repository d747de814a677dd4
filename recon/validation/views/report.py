"""The report of a run against its sensors and photographs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import error_colours
from recon.validation.page import PALETTE, Section, percent, save_picture, write_figure, write_report
from recon.validation.pictures import BACKGROUND, tile, window_around
from recon.validation.views.evaluation import FLOOR, Comparison, mean_agreement
from recon.validation.views.image_quality import luma
from recon.validation.views.novel_view import Photograph

MOST_PICTURES = 6
DIFFERENCE_LIMIT = 64  # grey levels at which the colours of a difference picture end
ACROSS = 4  # tiles; more are too small to see anything in
TABLES = ("sensors", "agreement", "views", "means")
COLUMNS = {
    "kind": "photographs",
    "region": "region",
    "approach": "model",
    "n_views": "views",
    "psnr_db": "PSNR dB",
    "psnr_object_db": "PSNR of the object dB",
    "ssim": "SSIM",
    "gradient": "gradients",
    "coverage": "coverage %",
    "spill": "spill %",
    "roughness": "rim roughness",
    "back_faces": "back faces %",
}
SHARES = ("coverage", "spill", "back_faces", "agree", "in_front")


def write_views_report(report: Mapping[str, Any], shown: Sequence[Comparison], out: Path) -> Path:
    """Write report.json, tables, figures and report.html; returns the HTML's path.

    Parameters
    ----------
    report, shown : as from `measure_views`
    out : folder
    """
    title, tables = f"Views of {report['settings']['dataset']}", {name: report[name] for name in TABLES}
    return write_report(out, title, report, tables, partial(_sections, report, shown))


def _sections(report: Mapping[str, Any], shown: Sequence[Comparison], out: Path) -> list[Section]:
    """Return the page's sections, whose figures are written into a folder."""
    return [
        Section("Novel views", _views_text(report), _means(report), [_figure(report, out)]),
        *([_agreement(report)] if report["sensors"] else []),
        _pictures(shown, out),
    ]


def _views_text(report: Mapping[str, Any]) -> str:
    text = (
        "Every model is rendered without light from where a photograph was taken, and compared with that "
        "photograph. “Held out” photographs are used by no sensor; the models were made from those called “sensor”."
        " PSNR, SSIM and the similarity of gradients are taken over the pixels where the model covers the object "
        "with fronts of faces; in the PSNR of the object all of its pixels count, and what is not covered is black."
        " Backs of faces, which a view from behind shows, count as nothing. Coverage is the share of the object "
        "that the model covers, spill the share of what was drawn beside the object. The rim is a band along the "
        "outline; its roughness is the length of the rendered outline, holes included, against that of the object: "
        "1 is as smooth as the object, more is ragged or full of holes."
    )
    if report["settings"]["has_floor"]:
        text += (
            f" “{FLOOR}” is a mesh made in the same way from the sensors' true depth: no depth method can be expected "
            "to come nearer to the photographs."
        )
    return text


def _means(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {shown: percent(row[name]) if name in SHARES else row[name] for name, shown in COLUMNS.items()}
        for row in report["means"]
    ]


def _figure(report: Mapping[str, Any], out: Path) -> tuple[str, str]:
    svg = write_figure(out / "psnr", _chart(report["views"]))
    return "PSNR of every view of the whole object; the line is the mean.", svg


def _chart(rows: Sequence[Mapping[str, Any]]) -> Any:
    import altair as alt

    values = [dict(row) for row in rows if row["region"] == "all" and row["psnr_db"] is not None]
    names = list(dict.fromkeys(row["approach"] for row in values))
    colour = alt.Color("kind:N", title="photographs", sort=None, scale=alt.Scale(range=list(PALETTE)))
    base = alt.Chart(alt.Data(values=values)).encode(y=alt.Y("approach:N", title=None, sort=names), color=colour)
    x = alt.X("psnr_db:Q", title="PSNR, dB", scale=alt.Scale(zero=False))
    offset = alt.YOffset("kind:N", sort=None)
    points = base.mark_circle(opacity=0.5, size=30).encode(x=x, yOffset=offset)
    means = base.mark_tick(thickness=3, size=12).encode(x="mean(psnr_db):Q", yOffset=offset)
    return (points + means).properties(width=460, height=alt.Step(18))


def _agreement(report: Mapping[str, Any]) -> Section:
    threshold = report["settings"]["threshold_mm"]
    text = (
        f"Points of each sensor's depth map, compared with the surface that another sensor measured: “agree” is the "
        f"share within {threshold:.3g} mm of it, “in front” the share that floats where the other sensor looks "
        "through. Points far behind it are hidden from the other sensor and do not count. Errors that all sensors "
        "share do not show here."
    )
    return Section("Sensors against each other", text, _shares([*report["agreement"], *_pairs(report["sensors"])]))


def _shares(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Turn the shares in rows into per cents."""
    return [
        {f"{k} %" if k in SHARES else k: percent(value) if k in SHARES else value for k, value in row.items()}
        for row in rows
    ]


def _pairs(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Average over frames for each depth method and pair of sensors."""
    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["depth"], f"{row['of']} seen by {row['by']}"), []).append(row)
    columns = ("agree", "in_front", "median_abs_mm", "median_mm")
    return [{"depth": f"{depth}, {pair}"} | mean_agreement(group, columns) for (depth, pair), group in groups.items()]


def _pictures(shown: Sequence[Comparison], out: Path) -> Section:
    figures = []
    for comparison in shown[:MOST_PICTURES]:
        photograph = comparison.photograph
        name = f"view_{photograph.name}_{photograph.frame:04d}"
        picture = save_picture(out, name, comparison_picture(comparison))
        figures.append((f"{photograph.name}, frame {photograph.frame} ({photograph.kind})", picture))
    text = (
        "The photograph, then each model and its difference in brightness where it covers the object: red is too "
        f"bright, blue too dark, from {DIFFERENCE_LIMIT} grey levels on. Grey is not covered; yellow was drawn "
        "beside the object."
    )
    return Section("Pictures", text, figures=figures)


def comparison_picture(comparison: Comparison) -> NDArray[np.uint8]:
    """Draw tiles, uint8 (H, W, 3): the photograph, and each model's rendering above its difference, four in a row."""
    photograph = comparison.photograph
    window = _window(comparison)
    empty = tile(np.full_like(photograph.pixels[window], 255), "")
    columns = [np.concatenate([tile(photograph.pixels[window], "photograph"), empty])]
    for approach, rendering in comparison.pictures.items():
        drawn = np.where(rendering.covered[..., None], rendering.picture, BACKGROUND).astype(np.uint8)
        difference = difference_picture(rendering.picture, rendering.covered, photograph)
        columns.append(np.concatenate([tile(drawn[window], approach), tile(difference[window], "difference")]))
    columns += [np.full_like(columns[0], 255)] * (-len(columns) % ACROSS)
    rows = [np.concatenate(columns[first : first + ACROSS], axis=1) for first in range(0, len(columns), ACROSS)]
    return np.concatenate(rows)


def difference_picture(
    picture: NDArray[np.uint8], covered: NDArray[np.bool_], photograph: Photograph
) -> NDArray[np.uint8]:
    """Colour the difference of brightness, uint8 (H, W, 3): grey where nothing was drawn, yellow beside the object.

    Parameters
    ----------
    picture : uint8 (H, W, 3), sRGB, the rendering
    covered : bool (H, W), where the rendering shows the mesh
    photograph : from the same camera
    """
    mask = np.ones_like(covered) if photograph.mask is None else photograph.mask
    errors = luma(picture) - luma(photograph.pixels)
    colours = error_colours(errors.ravel(), DIFFERENCE_LIMIT).reshape(picture.shape)
    colours[~covered] = BACKGROUND
    colours[~covered & ~mask] = 235
    colours[covered & ~mask] = (240, 228, 66)  # Okabe and Ito's yellow
    return colours


def _window(comparison: Comparison) -> tuple[slice, slice]:
    """Choose the part of the picture around the object, or around what the models cover without a mask."""
    mask = comparison.photograph.mask
    if mask is None:
        mask = np.any([rendering.covered for rendering in comparison.pictures.values()], axis=0)
    return window_around(mask)
