"""A study's archive: everything that analysts can fetch, in one zip file with a data dictionary and checksums."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterable, Mapping
from typing import Any

from app.store.audit import audit_records
from app.store.engine import Database
from app.store.measurements import measurement_records
from app.store.participants import participant_records, questionnaire_records
from app.store.screening import screening_records
from app.store.studies import Study
from app.store.trials import trial_records
from app.store.votes import vote_records
from app.study.options import parse_options
from app.study.study_file import StudyFile, write_study_file
from app.web.answers import csv_text
from app.web.columns import TABLES
from app.web.results import analysis_of

OLDEST_DATE = (1980, 1, 1, 0, 0, 0)  # of every file in it, so that the same content is the same archive


def archive_of(database: Database, of: Study) -> bytes:
    """The archive's bytes; the same as long as nothing changes."""
    files = dict(_files(database, of))
    checksums = "".join(f"{hashlib.sha256(text.encode()).hexdigest()}  {name}\n" for name, text in files.items())
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in {**files, "SHA256SUMS": checksums}.items():
            archive.writestr(zipfile.ZipInfo(f"{of.slug}/{name}", OLDEST_DATE), text, zipfile.ZIP_DEFLATED)
    return out.getvalue()


def _files(database: Database, of: Study) -> Iterable[tuple[str, str]]:
    yield "README.md", _dictionary(of)
    yield "study.toml", _study_file(of)
    analysis = analysis_of(database, of.id)
    for name, rows in _tables(database, of, analysis or {}).items():
        more = dict.fromkeys(key for row in rows for key in row) if name in ("scores", "triads", "observers") else {}
        yield f"{name}.csv", csv_text(rows, list({**TABLES[name], **more}))
    if analysis is not None:
        yield "analysis.json", json.dumps(analysis, indent=2, allow_nan=False) + "\n"


def _tables(database: Database, of: Study, analysis: Mapping[str, Any]) -> dict[str, list[dict[str, Any]]]:
    with database.reading() as connection:
        return {
            "votes": list(vote_records(connection, of.id)),
            "trials": list(trial_records(connection, of.id)),
            "participants": participant_records(connection, of.id),
            "screening": list(screening_records(connection, of.id)),
            "questionnaire": questionnaire_records(connection, of.id),
            "validation": list(measurement_records(connection, of.id)),
            "audit": audit_records(connection, study_id=of.id),
            **{name: list(analysis.get(name, ())) for name in ("scores", "triads", "observers")},
        }


def _dictionary(of: Study) -> str:
    parts = [
        f"# {of.name}\n\nAll data of the study `{of.slug}`. Times are UTC. A text that a spreadsheet would take for a "
        "formula has an apostrophe before it. `sha256sum -c SHA256SUMS` checks the files; `study.toml` makes the study "
        "again from its stimulus set; `analysis.json` is described in the project's documentation.\n"
    ]
    for name, columns in TABLES.items():
        rows = "".join(f"| {column} | {meaning} |\n" for column, meaning in columns.items())
        parts.append(f"\n## {name}.csv\n\n| column | meaning |\n|---|---|\n{rows}")
    return "".join(parts)


def _study_file(of: Study) -> str:
    options = parse_options(of.options)
    return write_study_file(
        StudyFile(
            name=of.name,
            manifest_sha256=of.manifest_sha256,
            exposure_s=of.exposure_s,
            seed=of.seed,
            options=options,
        )
    )
