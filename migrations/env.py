"""How Alembic meets the database: on the connection it is given, in the transaction that is already open."""

from __future__ import annotations

from alembic import context

from app.store.database.tables import metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    render_as_batch=True,  # SQLite alters a table by copying it
    compare_type=True,
)
context.run_migrations()
