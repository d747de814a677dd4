"""The picture of docs/measures.md, how measures answer to distortions: `python docs/measures_picture.py`

The reference is the studio's standing person, sampled; each distortion is made from it, and all are measured by what
`reconstudy validate cloud` runs.
"""

from __future__ import annotations

import html
from base64 import b64encode
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray
from pictures import keep
from playwright.sync_api import sync_playwright
from scipy.spatial import cKDTree

from app.study.screening.pictures import png
from recon.geometry.mesh import Cloud
from recon.geometry.mesh_files import write_cloud
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MESH
from recon.validation.cloud_quality.evaluation import CloudSettings, measure_clouds
from recon.validation.cloud_quality.reading import Sampling, read_point_set
from recon.validation.cloud_quality.sequences import find_compared

DENSITY = 0.04  # points per mm²
HEIGHT_PX, MARGIN_MM = 300, 40.0
MEASURES = (
    "d1_mse", "d2_mse", "d1_hausdorff_squared", "chamfer", "f_score", "y_mse", "cb_mse", "cr_mse",
    "pointssim_geometry", "pointssim_normals", "pointssim_curvature", "pointssim_colour",
)  # fmt: skip

Distortion = Callable[[Cloud, np.random.Generator], Cloud]


def noise(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    return moved(cloud, rng.normal(0, 5, cloud.points.shape))


def along_the_surface(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    steps = rng.normal(0, 5, cloud.points.shape)
    return moved(cloud, steps - cloud.normals * (steps * cloud.normals).sum(axis=1, keepdims=True))


def inflated(cloud: Cloud, _rng: np.random.Generator) -> Cloud:
    return moved(cloud, 8 * cloud.normals)


def hole(cloud: Cloud, _rng: np.random.Generator) -> Cloud:
    low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
    return cloud.select(np.linalg.norm(cloud.points - (0.5 * low + 0.5 * high), axis=1) > 0.12 * (high - low).max())


def every_fourth(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    return cloud.select(rng.permutation(len(cloud))[: len(cloud) // 4])


def outliers(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    is_out = rng.random(len(cloud)) < 0.003
    return moved(cloud, is_out[:, None] * rng.uniform(-200, 200, cloud.points.shape))


def darker(cloud: Cloud, _rng: np.random.Generator) -> Cloud:
    return coloured(cloud, 0.8 * cloud.colours)


def tinted(cloud: Cloud, _rng: np.random.Generator) -> Cloud:
    return coloured(cloud, cloud.colours + np.array([24.0, -7.1, 0]))  # the luma stays


def blurred(cloud: Cloud, _rng: np.random.Generator) -> Cloud:
    near = np.asarray(cKDTree(cloud.points).query(cloud.points, 60, workers=-1)[1])
    return coloured(cloud, cloud.colours[near].mean(axis=1))


DISTORTIONS: dict[str, Distortion] = {
    "noise of 5 mm": noise,
    "5 mm along the surface": along_the_surface,
    "inflated by 8 mm": inflated,
    "a hole": hole,
    "a quarter of the points": every_fourth,
    "0.3 % far off": outliers,
    "darker by a fifth": darker,
    "tinted": tinted,
    "blurred colours": blurred,
}


def main() -> None:
    """Measure, draw and write docs/pictures/measures.webp."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        clouds = distorted_clouds(folder)
        files = {
            text: write_cloud(folder / f"{index}.ply", cloud) for index, (text, cloud) in enumerate(clouds.items())
        }
        reference, *others = files.values()
        names = list(clouds)[1:]
        settings = CloudSettings(measures=("d1", "d2", "chamfer", "f_score", "colour", "pointssim"), threshold=10.0)
        comparison = measure_clouds(find_compared(others, reference, names=names), settings)
    values = {(row["approach"], row["measure"]): float(row["value"]) for row in comparison.report["measures"]}
    page = table(clouds, {measure: [values[name, measure] for name in names] for measure in MEASURES})
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        view = browser.new_page(viewport={"width": 1180, "height": 900})
        view.set_content(page)
        shot = view.locator("table").screenshot()
        browser.close()
    keep("measures", np.asarray(cv2.imdecode(np.frombuffer(shot, np.uint8), cv2.IMREAD_COLOR_RGB), np.uint8))


def distorted_clouds(folder: Path) -> dict[str, Cloud]:
    """The reference and each distortion of it, by what to call them."""
    synthesise(folder / "capture", SynthParameters(scene="standing", n_sensors=1, n_frames=1, size=(64, 48)))
    samples = read_point_set(folder / "capture" / MESH.format(frame=0), Sampling(DENSITY, 1))
    assert samples.normals is not None
    assert samples.colours is not None
    reference = Cloud(samples.points, samples.normals, samples.colours)
    return {"reference": reference} | {
        name: distort(reference, np.random.default_rng(1)) for name, distort in DISTORTIONS.items()
    }


def moved(cloud: Cloud, steps: NDArray[np.floating]) -> Cloud:
    """A cloud with its points displaced by steps (N, 3), mm."""
    return Cloud((cloud.points + steps).astype(np.float32), cloud.normals, cloud.colours)


def coloured(cloud: Cloud, levels: NDArray[np.floating]) -> Cloud:
    """A cloud with other colours (N, 3), 0 to 255."""
    return Cloud(cloud.points, cloud.normals, np.rint(np.clip(levels, 0, 255)).astype(np.uint8))


def table(clouds: Mapping[str, Cloud], values: Mapping[str, list[float]]) -> str:
    """A page with a picture of each cloud above its values; a cell is the darker the worse its value is in its row."""
    heads = "".join(
        f'<th><img src="data:image/png;base64,{b64encode(png(drawn(cloud))).decode()}"><br>{html.escape(name)}</th>'
        for name, cloud in clouds.items()
    )
    rows = ""
    for measure, row in values.items():
        damage = [value if measure.endswith(("mse", "squared", "chamfer")) else 1 - value for value in row]
        if measure.endswith(("mse", "squared")):
            damage = [value**0.5 for value in damage]
        cells = "".join(
            f'<td style="background: rgba(0, 114, 178, {0.85 * worse / max(damage):.3f}); '
            f'color: {"white" if worse > 0.6 * max(damage) else "#222"}">{value:.3g}</td>'
            for value, worse in zip(row, damage, strict=True)
        )
        best = "0" if measure.endswith(("mse", "squared", "chamfer")) else "1"
        rows += f"<tr><th>{measure}</th><td>{best}</td>{cells}</tr>"
    style = (
        "body { font: 13px 'Liberation Sans', Arial, sans-serif; margin: 0; color: #222 } img { height: 190px } "
        "table { border-collapse: collapse; background: white } "
        "td { text-align: center; padding: 3px 6px; white-space: nowrap } "
        "th { font-weight: normal; padding: 2px 4px; vertical-align: top } tr th:first-child { text-align: left }"
    )
    return f"<style>{style}</style><table><tr><th></th>{heads}</tr>{rows}</table>"


def drawn(cloud: Cloud) -> NDArray[np.uint8]:
    """A cloud from the front, uint8 (H, W, 3)."""
    width_mm, height_mm = 560.0 + 2 * MARGIN_MM, 1800.0 + 2 * MARGIN_MM
    scale = HEIGHT_PX / height_mm
    picture = np.full((HEIGHT_PX, round(width_mm * scale), 3), 255, np.uint8)
    nearest_last = np.argsort(cloud.points[:, 2], kind="stable")
    points, colours = cloud.points[nearest_last], cloud.colours[nearest_last]
    columns = np.rint((points[:, 0] + width_mm / 2) * scale).astype(int)
    rows = np.rint(HEIGHT_PX - (points[:, 1] + MARGIN_MM) * scale).astype(int)
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        row, column = rows + down, columns + right
        inside = (row >= 0) & (row < picture.shape[0]) & (column >= 0) & (column < picture.shape[1])
        picture[row[inside], column[inside]] = colours[inside]
    return picture


if __name__ == "__main__":
    main()
