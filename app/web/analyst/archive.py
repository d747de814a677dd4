"""Write a study's archive: all tables that analysts can fetch, in a zip file with data dictionary and checksums."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import IO, Any

from app.operations.studies.manage import study_file_of
from app.store.database.engine import Database, Transaction
from app.store.failing_films import failing_films
from app.store.participants.comments import comment_records, tag_records
from app.store.participants.interviews import questionnaire_records
from app.store.participants.participants import participant_records
from app.store.participants.screening import screening_records
from app.store.studies.audit import audit_records
from app.store.studies.images import image_content, image_digests
from app.store.studies.measurements import measurement_records
from app.store.studies.studies import Study, study_by_id
from app.store.trials.demographics import demographic_records
from app.store.trials.designs import conditions_of
from app.store.trials.sessions import shown_wordings
from app.store.trials.trial_records import trial_records
from app.store.trials.vote_records import vote_records
from app.study.options.options import parse_options
from app.study.options.study_file import StudyFile, write_study_file
from app.web.analyst.columns import FURTHER, TABLES, with_others
from app.web.analyst.formats import PART, write_csv
from app.web.analyst.results import inputs_of, items_factors, prepare_results, rows_of

ANALYSIS_TABLES = ("scores", "ratings", "comparisons", "triads", "observers")
OLDEST_DATE = (1980, 1, 1, 0, 0, 0)  # of every file: the same content then gives the same archive


def write_archive(out: IO[bytes], database: Database, study_id: int) -> None:
    """Write the archive from one snapshot of the database; unchanged data give the same bytes.

    Only a part of each table is in memory at a time.
    """
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        with database.snapshot() as connection:
            study = study_by_id(connection, study_id)
            assert study is not None, "its caller has just found it"
            files = _Files(archive, study.slug)
            files.write("README.md", _dictionary(study))
            files.write("study.toml", write_study_file(_without_codes(study_file_of(study))))
            files.write(
                "texts.json", json.dumps(shown_wordings(connection, study.id), indent=2, ensure_ascii=False) + "\n"
            )
            for name, sha256 in image_digests(connection, study.id).items():
                files.write_bytes(f"images/{name}", image_content(connection, sha256) or b"")
            prepared = prepare_results(connection, inputs_of(connection, study.id))
            for name, rows in _tables(connection, study.id):
                files.write_table(name, rows, list(TABLES[name]))
            _write_items(files, conditions_of(connection, study.id))
        analysis = prepared.results().analysis
        for name in ANALYSIS_TABLES:
            rows = rows_of(analysis or {}, name)
            files.write_table(name, rows, with_others(TABLES[name], rows))
        if analysis is not None:
            _write_analysis(files, analysis, study.name)
        files.write("SHA256SUMS", files.checksums)


def _without_codes(file: StudyFile) -> StudyFile:
    """Leave a recruiting platform's code and addresses out of a study file: an archive may be published."""
    return file.but(options=file.options.but(outside=file.options.outside.without_codes))


def _write_analysis(files: _Files, analysis: Mapping[str, Any], source: str) -> None:
    """Write the analysis as `reconstudy analyse` does: its tables, every figure, the report, and analysis.json."""
    from app.analysis.report.write import COLUMNS, report_files, table_csv

    for name, columns in COLUMNS.items():
        if name not in ANALYSIS_TABLES and analysis.get(name):
            files.write(f"{name}.csv", table_csv(analysis[name], columns))
    for path, content in report_files(analysis, source=source):
        files.write_bytes(path, content)
    files.write("analysis.json", json.dumps(analysis, indent=2, allow_nan=False) + "\n")


class _Files:
    """The files of an archive, with the checksums so far."""

    def __init__(self, archive: zipfile.ZipFile, folder: str) -> None:
        self._archive, self._folder = archive, folder
        self.checksums = ""

    def write(self, name: str, text: str) -> None:
        self.write_bytes(name, text.encode())

    def write_bytes(self, name: str, content: bytes) -> None:
        with self._file(name) as file:
            file.write(content)

    def write_table(self, name: str, rows: Iterable[Mapping[str, Any]], columns: Sequence[str]) -> None:
        with self._file(f"{name}.csv") as file:
            write_csv(file, rows, columns)

    @contextmanager
    def _file(self, name: str) -> Iterator[IO[bytes]]:
        entry = zipfile.ZipInfo(f"{self._folder}/{name}", OLDEST_DATE)
        entry.compress_type = zipfile.ZIP_DEFLATED
        with self._archive.open(entry, "w") as file:
            hashed = _Hashed(file)
            with io.BufferedWriter(hashed, PART) as buffered:
                yield buffered
        self.checksums += f"{hashed.digest.hexdigest()}  {name}\n"


class _Hashed(io.RawIOBase):
    """A file that is hashed while it is written."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.digest = hashlib.sha256()

    def writable(self) -> bool:
        return True

    def write(self, part: Any) -> int:
        self.digest.update(part)
        return self._file.write(part)


def _tables(connection: Transaction, study_id: int) -> Iterator[tuple[str, Iterable[Mapping[str, Any]]]]:
    yield "votes", vote_records(connection, study_id)
    yield "trials", trial_records(connection, study_id)
    yield "participants", participant_records(connection, study_id)
    yield "screening", screening_records(connection, study_id)
    yield "questionnaire", questionnaire_records(connection, study_id)
    yield "comments", comment_records(connection, study_id)
    yield "comment_tags", tag_records(connection, study_id)
    yield "demographics", demographic_records(connection, study_id)
    yield "validation", measurement_records(connection, study_id)
    yield "audit", audit_records(connection, study_id=study_id)
    yield "failures", failing_films(connection, study_id)


def _write_items(files: _Files, conditions: Mapping[str, Mapping[str, str]]) -> None:
    """Write the conditions' factor levels as `reconstudy analyse --items` takes them; nothing where there are none."""
    if factors := items_factors(conditions):
        files.write_table(
            "items", ({**levels, "item": name} for name, levels in conditions.items()), ["item", *factors]
        )


def _dictionary(study: Study) -> str:
    parts = [
        f"# {study.name}\n\nAll data of the study `{study.slug}`. Times are UTC. An apostrophe precedes text that a "
        "spreadsheet would take for a formula. `sha256sum -c SHA256SUMS` checks the files; `study.toml` makes the "
        "study again from its stimulus set, without a recruiting platform's code and addresses; `texts.json` has all "
        "texts that participants have read, `images` what they show; `report.html` says what was found, with every "
        "figure in `figures` as SVG, PNG and PDF; the project's documentation describes `analysis.json`.\n"
    ]
    if noted := parse_options(study.options).lab_sheet.rows():
        rows = "".join(f"| {label} | {_cell(text)} |\n" for label, text in noted)
        parts.append(f"\n## Lab sheet\n\n| what | as noted by the experimenter |\n|---|---|\n{rows}")
    for name, columns in TABLES.items():
        described = columns | FURTHER.get(name, {})
        rows = "".join(f"| {column} | {about.meaning} |\n" for column, about in described.items())
        parts.append(f"\n## {name}.csv\n\n| column | meaning |\n|---|---|\n{rows}")
    parts.append(
        "\n## items.csv\n\nThe levels of the conditions, for `reconstudy analyse votes.csv --items items.csv`; missing "
        "where no condition has any.\n\n| column | meaning |\n|---|---|\n| item | condition |\n"
        "| any other | the condition's level of this factor; empty if it has none |\n"
    )
    return "".join(parts)


def _cell(text: str) -> str:
    """Return a text as a cell of a Markdown table: in one line, its bars escaped."""
    return " ".join(text.split()).replace("|", "\\|")
