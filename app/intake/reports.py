"""Reports of objective evaluation: what of them a study can compare with its scores."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

REPORT = "report.json"
SUFFIXES = (".svg", ".png", ".pdf", ".csv")  # of tables and figures
PLAIN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,99}")
MOST_FILES = 400  # of a report
LARGEST_FILE = 32 * 1024 * 1024  # bytes
EVERY_DATASET = "all"  # a measure of an approach whatever the scene

Name = Annotated[str, Field(min_length=1, max_length=200)]


class Measure(BaseModel):
    """The value of one measure for an approach in a dataset, as a report lists it."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)

    dataset: Name
    approach: Name
    measure: Name
    value: Annotated[float, Field(allow_inf_nan=False)]
    direction: Literal["less is better", "more is better"]
    unit: Annotated[str, Field(max_length=40)]

    @property
    def place(self) -> tuple[str, str, str]:
        """What it is the value of."""
        return self.dataset, self.approach, self.measure


class Report(BaseModel):
    """The part of a report.json that is read here."""

    model_config = ConfigDict(extra="ignore", strict=True)

    kind: Annotated[str, Field(pattern=r"^[a-z]{1,20}$")] = "measures"
    measures: Sequence[Measure]  # none where it is of sensors or objects, whatever the approach


def read_report(path: Path) -> Report:
    """What a report says of which approaches.

    Parameters
    ----------
    path : its folder, or its report.json

    Raises
    ------
    ValueError
        If it cannot be read, or has nothing to show: no measure, table or figure.
    """
    file = path / REPORT if path.is_dir() else path
    try:
        found = Report.model_validate_json(file.read_bytes())
    except FileNotFoundError as error:
        raise ValueError(f"{file}: there is no such report; `reconstudy validate` writes them") from error
    except (OSError, ValidationError) as error:
        raise ValueError(f"{file}: is no report that can be attached: {_first_fault(error)}") from error
    if not found.measures and not report_files(path):
        raise ValueError(
            f"{file}: lists no measure and comes without tables and figures; attach its folder, or evaluate again with "
            "--approach NAME, the approach as the study calls it"
        )
    return found


def report_files(path: Path) -> list[Path]:
    """The tables and figures of a report, by name; of a report.json by itself there are none.

    Raises
    ------
    ValueError
        If they are more, or one is larger, than a report's are.
    """
    if not path.is_dir():
        return []
    found = [
        file
        for file in sorted(path.iterdir())
        if file.is_file() and file.suffix in SUFFIXES and PLAIN_NAME.fullmatch(file.name)
    ]
    if len(found) > MOST_FILES:
        raise ValueError(f"{path}: holds {len(found)} tables and figures, expected {MOST_FILES} at most")
    if large := [file for file in found if file.stat().st_size > LARGEST_FILE]:
        raise ValueError(f"{large[0]}: has more than {LARGEST_FILE // 2**20} MB, far more than a figure")
    return found


def expanded(
    measures: Sequence[Measure], datasets: Sequence[str], approaches: Sequence[str]
) -> tuple[list[Measure], list[str]]:
    """The measures of what a study compares, one for each dataset, and what it does not compare.

    Raises
    ------
    ValueError
        If two give different values of the same.
    """
    suited: dict[tuple[str, str, str], Measure] = {}
    strangers: dict[str, None] = {}
    for one in measures:
        if one.approach not in approaches or one.dataset not in (EVERY_DATASET, *datasets):
            strangers[f"{one.dataset}/{one.approach}"] = None
            continue
        for dataset in datasets if one.dataset == EVERY_DATASET else [one.dataset]:
            own = one.model_copy(update={"dataset": dataset})
            before = suited.setdefault(own.place, own)
            if before != own:
                raise ValueError(
                    f"{own.measure} of {own.approach} in {own.dataset} is {before.value:g} in one report and "
                    f"{own.value:g} in another; attach one of them"
                )
    return list(suited.values()), list(strangers)


def by_measure(rows: Sequence[Mapping[str, object]]) -> dict[str, dict[str, dict[str, float]]]:
    """Rows as the analysis takes them: measure -> dataset -> item -> value."""
    measures: dict[str, dict[str, dict[str, float]]] = {}
    for row in rows:
        own = measures.setdefault(str(row["measure"]), {}).setdefault(str(row["dataset"]), {})
        own[str(row["approach"])] = float(str(row["value"]))
    return measures


def _first_fault(error: OSError | ValidationError) -> str:
    if isinstance(error, OSError):
        return str(error)
    fault = error.errors()[0]
    return f"{'.'.join(map(str, fault['loc'])) or 'the file'}: {fault['msg']}"
