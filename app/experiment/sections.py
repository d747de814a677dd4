"""List the sections of the experiment's report: the paper's tables and figures from our data, beside the published."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from app.experiment.material import approaches_section, material_section, people_section
from app.experiment.measured import cuboid_section, models_section, sphere_section
from app.experiment.parts import Section, Table
from app.experiment.results import Results
from app.experiment.voted import prediction_section, ratings_section, subjective_section


def experiment_sections(results: Results, published: Mapping[str, Any]) -> Iterator[Section]:
    """Yield the parts of the report, in the paper's order.

    Parameters
    ----------
    published : the content of paper.toml
    """
    yield material_section(results, published)
    yield approaches_section(results, published)
    yield people_section(results, published)
    yield sphere_section(results, published)
    yield cuboid_section(results)
    yield models_section(results)
    yield subjective_section(results, published)
    yield from ratings_section(results)
    yield prediction_section(results)
    yield _course(results)


def _course(results: Results) -> Section:
    seconds = {**results.seconds, "all": sum(results.seconds.values())}
    rows = [(name, f"{taken / 60:.1f} min") for name, taken in seconds.items()]
    text = (
        "Started again, the command makes only what is missing. Every part has a report of its own in validation/; the "
        "study and its films are in the folder study-…, to be looked at with RECONSTUDY_DATA_DIR=that folder "
        "reconstudy serve."
    )
    return Section("How long it took", [text], [Table("seconds", "", ("step", "time"), rows)])
