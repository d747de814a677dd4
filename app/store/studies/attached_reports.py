"""Keep reports of objective evaluation attached to a study; another of the same kind and subject replaces one."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import Connection, select

from app.store.database.tables import report
from app.store.studies.studies import put_row


def replace_report(connection: Connection, study_id: int, kind: str, subject: str, digest: str, now: datetime) -> None:
    """Store the digest that names the folder of a report's files."""
    place = {"study_id": study_id, "kind": kind, "subject": subject}
    put_row(connection, report, place, {"digest": digest, "attached_at": now})


def report_digests(connection: Connection) -> list[str]:
    """Return the digests of attached reports, of all studies."""
    return sorted(set(connection.scalars(select(report.c.digest))))


def report_records(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return a row for each attached report: `kind, subject, digest, attached_at`."""
    columns = (report.c[name] for name in ("kind", "subject", "digest", "attached_at"))
    rows = connection.execute(
        select(*columns).where(report.c.study_id == study_id).order_by(report.c.kind, report.c.id)
    )
    return [dict(row._mapping) for row in rows]
