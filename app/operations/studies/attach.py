"""Attach reports of objective evaluation, their measures and models to a study.

The data folder holds their files under the digest of their content: `reports/DIGEST/`, `models/DIGEST.ply`.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from app.files import file_digest, private_folder, whole_file, whole_folder
from app.intake.arrivals import read_results
from app.intake.bounds import in_bounds
from app.intake.models import Model
from app.intake.reports import Measure, Report, check_agreement, expanded, report_files
from app.settings import Settings
from app.store.database.engine import Database
from app.store.studies.attached_models import replace_models
from app.store.studies.attached_reports import replace_report
from app.store.studies.audit import Entry, record
from app.store.studies.measurements import measurement_records, replace_measurements
from app.store.studies.studies import Study
from app.store.trials.designs import conditions_of, datasets_of

LONGEST_SUBJECT = 500
MOST_LISTED = 12  # names in a sentence
ATTACHED = "results attached"  # in the audit log
WHOLE_STUDY = "the whole study"  # subject of a report that names no approach


@dataclass(frozen=True)
class Compared:
    """The datasets and conditions that a study compares."""

    study: Study
    datasets: Sequence[str]
    conditions: Sequence[str]

    def refusal(self, strangers: Iterable[str]) -> ValueError:
        """Return the error for measures or models that match nothing in the study."""
        return ValueError(
            f"this describes {listed(list(strangers))}; the study {self.study.slug} compares "
            f"{', '.join(self.conditions)} in {', '.join(self.datasets)}"
        )


def attach(
    settings: Settings,
    database: Database,
    study: Study,
    paths: Sequence[Path],
    *,
    only: Sequence[str] = (),
    by: str,
    now: datetime,
) -> dict[str, Any]:
    """Attach reports, tables of measures and folders of models, replacing earlier ones of the same subject; those of
    other studies are left out.

    A report that names no approach belongs to the study as a whole: it is shown, and has nothing to compare with
    scores.

    Parameters
    ----------
    paths : folders that `reconstudy validate` or `reconstudy models` wrote, a report.json, or a CSV table of measures
    only : names of the measures to attach; none for all. Tables and figures of reports are attached whole
    by : the person's name, for the audit log

    Returns
    -------
    what was attached; `ignored` names what the study does not compare, `notes` say what tables leave out or average

    Raises
    ------
    ValueError
        If a path cannot be read, none of its content is what the study compares, or a measure of `only` is not there.
        Then nothing is attached.
    """
    with database.reading() as connection:
        datasets, conditions = datasets_of(connection, study.id), list(conditions_of(connection, study.id))
        attached = measurement_records(connection, study.id)
    compared = Compared(study, datasets, conditions)
    reports, every_model = in_bounds(read_results, paths)
    _check_distinct([report for _, report in reports])
    measures, strangers = _suited_measures(compared, _chosen([report for _, report in reports], only))
    check_agreement(measures, attached)
    models, foreign = _suited_models(compared, every_model)
    kept = [(report, _keep_report(settings, path)) for path, report in reports]
    for model in models:
        _keep_model(settings, model)
    names = list(dict.fromkeys(measure.measure for measure in measures))
    ignored = list(dict.fromkeys([*strangers, *foreign]))
    notes = [note for _, report in reports for note in report.notes]
    detail = {"measures": names, "reports": len(kept), "models": len(models), "ignored": ignored, "notes": notes}
    with database.writing() as connection:
        replace_measurements(connection, study.id, measures, now)
        for report, digest in kept:
            if digest is not None:
                replace_report(connection, study.id, report.kind, subject_of(report.measures), digest, now)
        replace_models(connection, study.id, models, now)
        record(connection, by, Entry(ATTACHED, study.id, study.slug, detail), now)
    return {"study": study.slug, "n_values": len(measures), **detail}


def listed(names: Sequence[str]) -> str:
    """Return the names as words, the first of many."""
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(names[:MOST_LISTED]) + more


def subject_of(measures: Sequence[Measure]) -> str:
    """Return the subject of a report, such as "ball: pm_fa, pm_fb"."""
    if not measures:
        return WHOLE_STUDY
    by_dataset: dict[str, dict[str, None]] = {}
    for measure in measures:
        by_dataset.setdefault(measure.dataset, {})[measure.approach] = None
    subject = "; ".join(f"{dataset}: {', '.join(approaches)}" for dataset, approaches in by_dataset.items())
    return subject[:LONGEST_SUBJECT]


def report_folder(settings: Settings, digest: str) -> Path:
    """Return the folder of a report's files."""
    return settings.data_dir / "reports" / digest


def digest_of(files: Sequence[Path]) -> str:
    """Return the digest that names a report's folder."""
    sums = "".join(f"{file_digest(file)}  {file.name}\n" for file in files)
    return hashlib.sha256(sums.encode()).hexdigest()


def model_file(settings: Settings, sha256: str) -> Path:
    """Return the path of a model."""
    return settings.data_dir / "models" / f"{sha256}.ply"


def _check_distinct(reports: Sequence[Report]) -> None:
    whole = [report.kind for report in reports if not report.measures]
    if twice := sorted({kind for kind in whole if whole.count(kind) > 1}):
        raise ValueError(
            f"{whole.count(twice[0])} reports of kind {twice[0]} name no approach, expected one, as each would replace "
            "the other; evaluate again with --approach NAME"
        )


def _chosen(reports: Sequence[Report], only: Sequence[str]) -> list[Measure]:
    measures = [measure for report in reports for measure in report.measures]
    known = list(dict.fromkeys(measure.measure for measure in measures))
    if missing := [name for name in only if name not in known]:
        raise ValueError(
            f"there is no measure {missing[0]!r} in what is attached; there are {', '.join(known) or 'none'}"
        )
    return [measure for measure in measures if not only or measure.measure in only]


def _suited_measures(compared: Compared, measures: Sequence[Measure]) -> tuple[list[Measure], list[str]]:
    suited, strangers = expanded(measures, compared.datasets, compared.conditions)
    if measures and not suited:
        raise compared.refusal(strangers)
    return suited, strangers


def _suited_models(compared: Compared, models: Sequence[Model]) -> tuple[list[Model], list[str]]:
    suited = [
        model for model in models if model.dataset in compared.datasets and model.condition in compared.conditions
    ]
    strangers = [f"{model.dataset}/{model.condition}" for model in models if model not in suited]
    if models and not suited:
        raise compared.refusal(strangers)
    return suited, strangers


def _keep_report(settings: Settings, path: Path) -> str | None:
    """Copy a report's tables and figures; return the digest of all of them, None where there are none."""
    files = report_files(path)
    if not files:
        return None
    digest = digest_of(files)
    folder = report_folder(settings, digest)
    if not folder.exists():
        private_folder(folder.parent)
        with whole_folder(folder) as temporary:
            for file in files:
                shutil.copyfile(file, temporary / file.name)
    return digest


def _keep_model(settings: Settings, model: Model) -> None:
    path = model_file(settings, model.sha256)
    if not path.exists():
        private_folder(path.parent)
        with whole_file(path) as temporary:
            shutil.copyfile(model.path, temporary)
