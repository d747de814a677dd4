"""Keep the forms of studies that are not created yet: each person's latest of each stimulus set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, delete, insert, select, update

from app.store.database.tables import study_draft


@dataclass(frozen=True)
class KeptDraft:
    """A form as it was typed: of a stimulus set, by its name in addresses."""

    stimulus_set: str
    content: Mapping[str, Any]
    changed_at: datetime


def keep_draft(
    connection: Connection, actor: str, stimulus_set: str, content: Mapping[str, Any], now: datetime
) -> None:
    """Keep a form in place of the person's earlier one of the same stimulus set."""
    values = {"content": dict(content), "changed_at": now}
    kept = update(study_draft).where(*_is_of(actor, stimulus_set)).values(**values)
    if connection.execute(kept).rowcount == 0:
        connection.execute(insert(study_draft).values(actor=actor, stimulus_set=stimulus_set, **values))


def drafts_of(connection: Connection, actor: str) -> list[KeptDraft]:
    """Return a person's forms, the newest first."""
    columns = [study_draft.c[name] for name in KeptDraft.__dataclass_fields__]
    rows = select(*columns).where(study_draft.c.actor == actor).order_by(study_draft.c.changed_at.desc())
    return [KeptDraft(**row._mapping) for row in connection.execute(rows)]


def draft_of(connection: Connection, actor: str, stimulus_set: str) -> Mapping[str, Any]:
    """Return what a person has typed for a stimulus set; nothing: nobody has."""
    content = connection.scalar(select(study_draft.c.content).where(*_is_of(actor, stimulus_set)))
    return content or {}


def drop_draft(connection: Connection, actor: str, stimulus_set: str) -> None:
    """Drop a form, as its study is there or nobody wants it."""
    connection.execute(delete(study_draft).where(*_is_of(actor, stimulus_set)))


def _is_of(actor: str, stimulus_set: str) -> tuple[Any, Any]:
    return study_draft.c.actor == actor, study_draft.c.stimulus_set == stimulus_set
