"""Write the report's first sections: what was shown, how it was made, and to whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory
from typing import Any

from app.analysis.reading.votes_table import ALL
from app.experiment.parts import Figure, Section, Table, data_url
from app.experiment.results import Results, screened_out
from app.experiment.study import N_PEOPLE, TRUTH
from app.files import read_json
from app.films.strips import write_still
from app.intake.stimuli import MANIFEST

HERE = {  # table 1
    "id": "cost-volume filtering by a permeability filter, hierarchical search, left/right check; whole disparities",
    "dr": "the same; parabola, holes filled, costs aggregated once more along the surface found",
    "pm": "PatchMatch on slanted planes, from DR's surface; float disparities",
    "fa": "a surface per sensor (APSS, marching cubes), then one mesh as their union",
    "fb": "one cloud as the union of the sensors' clouds, then its surface",
}
FURTHER = {
    "sgm": "OpenCV's semi-global matching, its parameters as in OpenCV's examples",
    "poisson": "one cloud of all sensors, then Open3D's screened Poisson reconstruction",
    "tsdf": "Open3D's integration of the sensors' depth maps",
    "vertices": "colours of the clouds' points, one for each vertex, as in the paper",
    "photographs": "a texture from the photographs of all sensors, as sharp as they are",
}
PARAMETERS = {  # table 2: name, and where our value comes from
    "census_window": ("Cost computation: census window", "{census_window} × {census_window}"),
    "permeability_sigma": ("Cost aggregation: permeability σ", "{id[sigma]:g}"),
    "hierarchy_levels": ("Hierarchical matching: levels", "0 – {id[levels]}"),
    "consistency_threshold": ("Left/right consistency threshold", "{id[consistency_threshold]}"),
    "temporal_sigma": ("Temporal filtering: permeability σ", "{temporal[sigma]:g}"),
    "temporal_sigma_disparity": ("Temporal filtering: consistency σ′", "{temporal[sigma_disparity]:g}"),
}
METHODS = {"super4pcs": "Super4PCS", "robust": "consensus of spheres through three points"}
DEVIATIONS = (  # what table 2 does not say, or we do otherwise: name, paper, ours
    (
        "Census: a second code",
        "none named",
        "each view's image blurred by 1 pixel gives a second code; both costs are added, against noise",
    ),
    ("DR: refinement along the surface", "[11], parameters not given", "costs aggregated once more along the surface"),
    ("PM: start", "random planes [12]", '{pm_start}; seed = "none" in a methods file starts at random'),
    ("PM: window", "35 × 35 [12]", "33 × 33, every other pixel"),
    ("PM: smoothness", "none in [12]", "{pm[smoothness]:g} grey levels a pixel between neighbours' planes"),
    ("PM: models", "static", "moving, like all others"),
    ("Sphere: registration", "Super4PCS", "{sphere_method}, then robust refinement of the centre"),
)


def material_section(results: Results, published: Mapping[str, Any]) -> Section:
    best, worst = (list(results.truth(ALL, ALL))[place] for place in (0, -1))
    stimuli = read_json(results.out / "stimuli" / MANIFEST)["stimuli"]
    figures = []
    for letter, approach in zip("abc", (best, worst, TRUTH), strict=True):
        videos = [stimulus for stimulus in stimuli if stimulus["approach"] == approach]
        pictures = [_still(results.out / "stimuli", video) for video in videos]
        names = ", ".join(video["dataset"] for video in videos)
        how = "the truth, which nobody votes on" if approach == TRUTH else f"by {approach}"
        caption = f"Figure 2{letter}. The first picture of the videos {names}, {how}."
        figures.append(Figure(caption, pictures=pictures))
    trials = published["trials"]
    rows = [
        ("videos", str(trials["videos"]), str(sum(stimulus["approach"] != TRUTH for stimulus in stimuli))),
        ("seconds each", f"{trials['seconds']}", f"{results.objective['scale']['seconds']:g}"),
        ("comparisons of a participant", str(trials["comparisons"]), str(_n_compared(results))),
    ]
    text = (
        "Every scene by every approach, seen from a camera that moves from the first sensor to the last. All models "
        "move here; the paper showed PM's as static ones, because PM took too long, so that its flicker went unseen."
    )
    return Section("Test material", [text], [Table("trials", "", ("", "paper", "here"), rows)], figures)


def _n_compared(results: Results) -> int:
    """Return how many pairs each participant compared."""
    return int(results.answers["votes"] // len(results.analysis["observers"]))


def _still(folder: Path, stimulus: Mapping[str, Any]) -> str:
    with TemporaryDirectory() as temporary:
        path = Path(temporary) / "still.jpg"
        write_still(folder / stimulus["video"], path, row=0, width=stimulus["width"], height=stimulus["height"])
        return data_url(path.read_bytes(), "jpeg")


def approaches_section(results: Results, published: Mapping[str, Any]) -> Section:
    used = {level for levels in results.levels.values() for level in levels.values()}
    first = [(name.upper(), published["table_1"][name], text) for name, text in HERE.items()]
    first += [(name, "–", FURTHER.get(name, "as its methods file says")) for name in sorted(used - HERE.keys())]
    first += [(name, "–", "models by another program") for name, levels in results.levels.items() if not levels]
    parameters = results.objective["parameters"]
    given = {
        **results.objective,
        **parameters,
        "pm_start": "DR's surface" if parameters["pm"]["is_seeded"] else "random planes",
        "sphere_method": METHODS[results.sphere()["settings"]["method"]],
    }
    second = [
        (name, str(published["table_2"][key]), form.format_map(given)) for key, (name, form) in PARAMETERS.items()
    ]
    second += [(name, paper, form.format_map(given)) for name, paper, form in DEVIATIONS]
    tables = [
        Table("table_1", "Table 1. Compared approaches", ("", "paper", "here"), first),
        Table("table_2", "Table 2. Parameters, then what differs from the paper", ("", "paper", "here"), second),
    ]
    return Section("Approaches", ["An approach is a depth method with a view fusion, pm_fb for example."], tables)


def people_section(results: Results, published: Mapping[str, Any]) -> Section:
    paper, failed = published["table_3"], screened_out(results)
    answers: dict[str, dict[str, Any]] = {}
    for row in results.answers["questionnaire"]:
        answers.setdefault(row["question"], {})[row["participant"]] = row["answer"]
    ages = [float(age) for age in answers["age"].values()]
    sexes, trained = list(answers["sex"].values()), list(answers["trained"].values())
    rows = [
        ("participants", str(paper["participants"]), str(len(ages))),
        ("male, female", f"{paper['male']}, {paper['female']}", f"{sexes.count('male')}, {sexes.count('female')}"),
        ("experienced: yes, no", f"{paper['experienced']}, {paper['inexperienced']}",
         f"{trained.count('yes')}, {trained.count('no')}"),
        ("age: youngest, oldest, mean", f"{paper['age_min']}, {paper['age_max']}, {paper['age_mean']}",
         f"{min(ages):g}, {max(ages):g}, {fmean(ages):.1f}"),
        ("failed the screening besides", str(paper["screened_out"]), f"{len(failed)} ({_tests(failed)})"),
    ]  # fmt: skip
    acuities = [row["logmar"] for row in results.answers["screening"] if row["logmar"] is not None]
    text = (
        f"{N_PEOPLE + 1} artificial people took the screening over HTTP by looking at its pictures: Landolt rings "
        f"(best {min(acuities):+.2f} logMAR, worst {max(acuities):+.2f}) and plates of coloured dots. Who failed "
        "took no part."
    )
    return Section("Participants", [text], [Table("table_3", "Table 3. Demographics", ("", "paper", "here"), rows)])


def _tests(failed: Sequence[tuple[str, str]]) -> str:
    return ", ".join(test for _, test in failed) or "nobody"
