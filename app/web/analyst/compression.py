"""Compress long tables for clients that take it: JSON and CSV repeat names in every row."""

from __future__ import annotations

from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send

from app.web.analyst.formats import PARQUET

TABLES = ("/api/v1/studies", "/api/v1/audit")  # beginnings of their addresses
SHORTEST = 16 * 1024  # bytes of an answer that is compressed, unless it is sent while it is read
LEVEL = 5  # of 9: most of the gain for a third of the time
COMPRESSED_ALREADY = (*DEFAULT_EXCLUDED_CONTENT_TYPES, PARQUET)


class CompressedTables:
    """Compress what the analysts' addresses answer, and nothing else."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self.compressed = GZipMiddleware(app, SHORTEST, LEVEL, exclude_content_types=COMPRESSED_ALREADY)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        is_table = scope["type"] == "http" and scope["path"].startswith(TABLES)
        await (self.compressed if is_table else self.app)(scope, receive, send)
