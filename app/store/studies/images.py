"""Keep the images that a study shows in its consent and debriefing."""

from __future__ import annotations

import hashlib

from sqlalchemy import Connection, delete, insert, select

from app.store.database.tables import study_image


def keep_image(connection: Connection, study_id: int, name: str, content: bytes) -> None:
    """Keep an image, in place of one of the same name."""
    remove_image(connection, study_id, name)
    row = {"study_id": study_id, "name": name, "sha256": hashlib.sha256(content).hexdigest(), "content": content}
    connection.execute(insert(study_image).values(**row))


def remove_image(connection: Connection, study_id: int, name: str) -> None:
    connection.execute(delete(study_image).where(study_image.c.study_id == study_id, study_image.c.name == name))


def image_digests(connection: Connection, study_id: int) -> dict[str, str]:
    """Return the SHA-256 of each of a study's images, by name."""
    rows = select(study_image.c.name, study_image.c.sha256).where(study_image.c.study_id == study_id)
    return {row.name: row.sha256 for row in connection.execute(rows.order_by(study_image.c.name))}


def image_content(connection: Connection, sha256: str) -> bytes | None:
    """Return an image by its digest; None if no study has it."""
    return connection.scalar(select(study_image.c.content).where(study_image.c.sha256 == sha256).limit(1))


def copy_images(connection: Connection, from_study: int, to_study: int) -> None:
    """Give a study the images of another."""
    columns = ("name", "sha256", "content")
    rows = select(*(study_image.c[column] for column in columns)).where(study_image.c.study_id == from_study)
    copied = [{**row._mapping, "study_id": to_study} for row in connection.execute(rows)]
    if copied:
        connection.execute(insert(study_image), copied)
