"""Read reports of objective evaluation and tables of measures, and select the measures that a study can compare with
its scores.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from app.files import is_plain_name, read_json_bytes
from app.intake.stimuli import StimulusSet
from ground.fields import Expected
from ground.file_models import first_fault

REPORT = "report.json"
TABLE = "measures.csv"  # of a report; a table of somebody else's measures may have any name that ends in .csv
SUFFIXES = (".svg", ".png", ".pdf", ".csv")  # of tables and figures
MOST_FILES = 400  # of a report
LARGEST_FILE = 32 * 1024 * 1024  # bytes
EVERY_DATASET = "all"  # dataset of a measure that holds for an approach on all datasets

DIRECTIONS: Mapping[str, Literal["less is better", "more is better"]] = {
    "lower": "less is better",
    "higher": "more is better",
}
BETTER: Mapping[str, str] = {direction: better for better, direction in DIRECTIONS.items()}

BETTER_LOWER: Literal["less is better"] = "less is better"
SIZES_FROM = "files of the models"  # source of the measure `bytes`

Name = Annotated[str, Field(min_length=1, max_length=200)]


class Measure(BaseModel):
    """The value of a measure for an approach on a dataset, as a report lists it; `source` says what measured it."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    dataset: Name
    approach: Name
    measure: Name
    value: Annotated[float, Field(allow_inf_nan=False)]
    direction: Literal["less is better", "more is better"]
    unit: Annotated[str, Field(max_length=40)]
    source: Annotated[str, Field(max_length=500)] = ""

    @property
    def place(self) -> tuple[str, str, str]:
        """Dataset, approach and name of the measure: the key of its value."""
        return self.dataset, self.approach, self.measure


def model_sizes(stimulus_set: StimulusSet) -> list[Measure]:
    """Return the size of each stimulus' model as a measure, where the set says it."""
    return [
        Measure(
            dataset=stimulus.dataset,
            approach=stimulus.approach,
            measure="bytes",
            value=float(stimulus.model_bytes),
            direction=BETTER_LOWER,
            unit="bytes",
            source=SIZES_FROM,
        )
        for stimulus in stimulus_set.stimuli
        if stimulus.model_bytes is not None
    ]


class _ReportFile(BaseModel):
    """The part of a report.json that a study uses."""

    model_config = ConfigDict(extra="ignore", strict=True)

    kind: Annotated[str, Field(pattern=r"^[a-z]{1,20}$"), Expected("1 to 20 letters from a to z")] = "measures"
    measures: Sequence[Measure]  # empty for reports on sensors or objects, which name no approach


@dataclass(frozen=True)
class Report:
    """What a study uses of a report.

    Parameters
    ----------
    kind : what was evaluated, or "measures"
    measures : empty for reports on sensors or objects, which name no approach
    notes : sentences on what its table of measures leaves out or averages
    """

    kind: str
    measures: Sequence[Measure]
    notes: Sequence[str] = ()


def read_report(path: Path) -> Report:
    """Read a report, or a table of measures.

    The values of a report's folder are those of its `measures.csv`, where there is one, else those of its report.json.

    Parameters
    ----------
    path : the report's folder, its report.json, or a CSV file, see `app/analysis/reading/measures_table.py`

    Raises
    ------
    ValueError
        If it cannot be read, or has no measure, table or figure.
    """
    if path.suffix.lower() == ".csv":
        return _read_table(path)
    file = path / REPORT if path.is_dir() else path
    if path.is_file() and path.suffix.lower() != ".json":
        raise ValueError(
            f"{path}: expected the folder of a report, its {REPORT}, or a table of measures that ends in .csv"
        )
    try:
        report = _ReportFile.model_validate_json(read_json_bytes(file))
    except FileNotFoundError as error:
        raise ValueError(f"{file}: there is no such report; a validation writes them") from error
    except (OSError, ValueError) as error:
        raise ValueError(f"{file}: is no report that can be attached: {first_fault(error, _ReportFile)}") from error
    if not report.measures and not report_files(path):
        raise ValueError(
            f"{file}: lists no measure and comes without tables and figures; attach its folder, or evaluate again with "
            "--approach NAME, the approach as the study calls it"
        )
    if path.is_dir() and (path / TABLE).is_file():
        measures, notes = _measures_of(path / TABLE)
        return Report(report.kind, measures, notes)
    return Report(report.kind, report.measures)


def _read_table(path: Path) -> Report:
    measures, notes = _measures_of(path)
    if not measures:
        why = "; ".join(notes) or "it has no row below its header"
        raise ValueError(f"{path}: holds no value that can be attached: {why}")
    return Report("measures", measures, notes)


def _measures_of(table: Path) -> tuple[list[Measure], tuple[str, ...]]:
    """Return a table's values and its notes."""
    from app.analysis.reading.measures_table import read_measures_table  # pandas loads slowly

    read_table = read_measures_table(table)
    measures = [
        Measure(
            dataset=value.dataset,
            approach=value.approach,
            measure=value.measure,
            value=value.value,
            direction=DIRECTIONS[value.better],
            unit=value.unit,
            source=value.source,
        )
        for value in read_table.values
    ]
    return measures, read_table.notes


def report_files(path: Path) -> list[Path]:
    """Return the tables and figures of a report, by name; none where the path is a report.json.

    Raises
    ------
    ValueError
        If there are too many, or one is too large for a figure.
    """
    if not path.is_dir():
        return []
    files = [
        file
        for file in sorted(path.iterdir())
        if file.is_file() and file.suffix in SUFFIXES and is_plain_name(file.name)
    ]
    if len(files) > MOST_FILES:
        raise ValueError(f"{path}: holds {len(files)} tables and figures, expected {MOST_FILES} at most")
    if large := [file for file in files if file.stat().st_size > LARGEST_FILE]:
        raise ValueError(f"{large[0]}: has more than {LARGEST_FILE // 2**20} MB, far more than a figure")
    return files


def expanded(
    measures: Sequence[Measure], datasets: Sequence[str], approaches: Sequence[str]
) -> tuple[list[Measure], list[str]]:
    """Return the measures of what a study compares, one per dataset, and the names of what it does not compare.

    Raises
    ------
    ValueError
        If two reports give different values of the same measure.
    """
    suited: dict[tuple[str, str, str], Measure] = {}
    strangers: dict[str, None] = {}
    for measure in measures:
        if measure.approach not in approaches or measure.dataset not in (EVERY_DATASET, *datasets):
            strangers[f"{measure.dataset}/{measure.approach}"] = None
            continue
        for dataset in datasets if measure.dataset == EVERY_DATASET else [measure.dataset]:
            copy = measure.model_copy(update={"dataset": dataset})
            before = suited.setdefault(copy.place, copy)
            if before.value != copy.value:
                raise ValueError(
                    f"{copy.measure} of {copy.approach} in {copy.dataset} is {before.value:g} in one report and "
                    f"{copy.value:g} in another; attach one of them"
                )
    return list(suited.values()), list(strangers)


def check_agreement(measures: Sequence[Measure], attached: Sequence[Mapping[str, object]]) -> None:
    """Check that a measure has one unit, and one direction, in all its values.

    Parameters
    ----------
    measures : new values
    attached : rows of values that a study has; the new ones replace those of the same place

    Raises
    ------
    ValueError
        Naming the measure and what its values say.
    """
    places = {measure.place for measure in measures}
    told = {measure.measure: measure for measure in measures}
    kept = [row for row in attached if (row["dataset"], row["approach"], row["measure"]) not in places]
    rows = [*(measure.model_dump() for measure in measures), *(row for row in kept if row["measure"] in told)]
    for row in rows:
        first = told[str(row["measure"])].model_dump()
        for (column, expected), value in zip(_meaning(first).items(), _meaning(row).values(), strict=True):
            if value != expected:
                raise ValueError(
                    f"{column} of {row['measure']} is {expected!r} for {first['dataset']}/{first['approach']} and "
                    f"{value!r} for {row['dataset']}/{row['approach']}; expected the same for all values of a measure: "
                    "correct one, attach both again together, or give one another name"
                )


def _meaning(row: Mapping[str, object]) -> dict[str, object]:
    """Return what is the same for all values of a measure, by its column in tables."""
    return {"better": BETTER[str(row["direction"])], "unit": row["unit"]}


def by_measure(rows: Sequence[Mapping[str, object]]) -> dict[str, dict[str, dict[str, float]]]:
    """Return rows as the analysis takes them: measure -> dataset -> item -> value."""
    measures: dict[str, dict[str, dict[str, float]]] = {}
    for row in rows:
        by_item = measures.setdefault(str(row["measure"]), {}).setdefault(str(row["dataset"]), {})
        by_item[str(row["approach"])] = float(str(row["value"]))
    return measures


def better_by_measure(rows: Sequence[Mapping[str, object]]) -> dict[str, str]:
    """Return for each measure whether `higher` or `lower` is better, as the analysis takes it."""
    return {str(row["measure"]): str(row["better"]) for row in rows}
