"""The check of a capture as one page that stands alone: figures, problems, thumbnails; and as JSON beside it."""

from __future__ import annotations

from base64 import b64encode
from html import escape
from pathlib import Path

import cv2
import numpy as np

from recon.capture.checking.check import CheckReport
from recon.capture.checking.continuity import Glance
from recon.storage.files import whole_file, write_json

MAX_THUMBNAILS = 12  # of a camera, evenly over its frames
STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #1c1c1c }
table { border-collapse: collapse } th, td { text-align: left; padding: .25rem 1rem .25rem 0; vertical-align: top }
td.number { text-align: right; font-variant-numeric: tabular-nums }
.problems { border-left: .25rem solid #a4260e; padding-left: 1rem }
.warnings { border-left: .25rem solid #b07800; padding-left: 1rem } .sound { border-left: .25rem solid #1d6b35;
padding-left: 1rem } .frames { display: flex; flex-wrap: wrap; gap: .25rem } figure { margin: 0 } img { width: 112px }
figcaption { font-size: .75rem; color: #555 }
"""
HEADINGS = (
    "sensor", "baseline, mm", "rectified, pixels", "disparities", "mm of depth per pixel", "expected error, mm",
    "texture", "vertical error, px", "matched points",
)  # fmt: skip


def write_check(report: CheckReport, out: Path) -> Path:
    """Write `report.html` and `report.json` into a folder and return the page's path."""
    write_json(out / "report.json", report.as_json())
    page = out / "report.html"
    with whole_file(page) as temporary:
        temporary.write_text(check_page(report), encoding="utf-8")
    return page


def check_page(report: CheckReport) -> str:
    """The page as HTML, with its pictures inside."""
    name = escape(Path(report.folder).name)
    verdicts = "".join(f"<li>{escape(verdict)}</li>" for verdict in report.verdicts)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>Check of {name}</title>'
        f"<style>{STYLE}</style></head><body><main><h1>Check of {name}</h1>"
        f"<p>{escape(report.folder)}: {report.n_frames} frames, {len(report.sensors)} sensors</p>"
        f"{_problems(report)}<h2>What to expect</h2><ul>{verdicts}</ul>"
        f"<h2>Sensors</h2>{_table(report)}<h2>Frames</h2>{_thumbnails(report)}</main></body></html>\n"
    )


def _problems(report: CheckReport) -> str:
    if not report.problems and not report.warnings:
        return '<p class="sound">Nothing is wrong.</p>'
    usable = "" if report.problems else '<p class="sound">The capture can be used; mind the warnings.</p>'
    return f"{usable}{_list('Problems', report.problems)}{_list('Warnings', report.warnings)}"


def _list(heading: str, sentences: tuple[str, ...]) -> str:
    if not sentences:
        return ""
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f'<section class="{heading.lower()}"><h2>{heading}</h2><ul>{items}</ul></section>'


def _table(report: CheckReport) -> str:
    head = "".join(f'<th scope="col">{heading}</th>' for heading in HEADINGS)
    rows = []
    for sensor in report.sensors:
        rows_facts = sensor.rows
        values = (
            f"{sensor.baseline_mm:.2f}",
            "{}x{}".format(*sensor.rectified_size) if sensor.rectified_size else "-",
            _number(sensor.n_disparities, "d"),
            _number(sensor.depth_per_disparity_mm, ".2f"),
            _number(sensor.expected_error_mm, ".1f"),
            sensor.texture,
            _number(rows_facts.vertical_error_px if rows_facts else None, ".3f"),
            _number(rows_facts.n_matches if rows_facts else None, "d"),
        )
        cells = "".join(f'<td class="number">{value}</td>' for value in values)
        rows.append(f'<tr><th scope="row">{escape(sensor.id)}</th>{cells}</tr>')
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _thumbnails(report: CheckReport) -> str:
    parts = []
    for pattern, by_frame in report.glances.items():
        frames = sorted(by_frame)
        shown = [frames[round(i)] for i in np.linspace(0, len(frames) - 1, min(len(frames), MAX_THUMBNAILS))]
        pictures = "".join(_figure(pattern, frame, by_frame[frame]) for frame in shown)
        parts.append(f'<h3>{escape(pattern)}</h3><div class="frames">{pictures}</div>')
    return "".join(parts)


def _figure(pattern: str, frame: int, glance: Glance) -> str:
    jpeg = cv2.imencode(".jpg", glance.thumbnail.astype(np.uint8))[1].tobytes()
    source = f"data:image/jpeg;base64,{b64encode(jpeg).decode()}"
    return (
        f'<figure><img src="{source}" alt="{escape(pattern)}, frame {frame}"><figcaption>{frame}</figcaption></figure>'
    )
