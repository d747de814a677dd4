"""Serve films under opaque names: ranges, conditional requests, and caching for good."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, RedirectResponse, Response

from app.errors import NotFoundError, UnavailableError
from app.films.object_store import SIGNED_FOR_S, MediaStore
from app.films.pairs import FilmFile
from app.films.strips import SINGLE
from app.store.studies.images import image_content
from app.store.trials.designs import film_file
from app.study.trial.image import media_type
from app.web.gates import Store, settings

# The content of a name never changes. Private: shared caches must not serve a study's material to others.
FOREVER = "private, max-age=31536000, immutable"
# The policy of files that users brought: a page shows its own pictures and style, and cannot run scripts or send forms.
SANDBOX = (
    "sandbox allow-same-origin; default-src 'none'; img-src 'self' data:; media-src 'self'; "
    "style-src 'self' 'unsafe-inline'; frame-ancestors 'self'"
)
FOR_A_WHILE = f"private, max-age={SIGNED_FOR_S // 2}"  # cache time of a signed URL, which expires

log = logging.getLogger(__name__)

Piece = bytes | bytearray

router = APIRouter()


@router.get("/images/{sha256}", include_in_schema=False)
def image(sha256: Annotated[str, Path(pattern="^[0-9a-f]{64}$")], database: Store) -> Response:
    """Serve an image of a study's consent or debriefing."""
    with database.reading() as connection:
        content = image_content(connection, sha256)
    if content is None:
        raise NotFoundError("There is no such image.")
    return Response(content, media_type=media_type(content), headers={"Cache-Control": FOREVER})


class Film(FileResponse):
    """Send a file, read in the event loop where it is in memory: passing that to a thread takes longer."""

    chunk_size = 256 * 1024

    @asynccontextmanager
    async def _open_file(self) -> AsyncIterator[_Pieces]:  # type: ignore[override]
        async with super()._open_file() as file:
            yield _Pieces(file.wrapped.fileno())


class _Pieces:
    """An open file with the methods that `FileResponse` uses."""

    def __init__(self, file: int) -> None:
        self._file, self._at = file, 0

    async def seek(self, at: int) -> None:
        self._at = at

    async def read(self, n_bytes: int) -> Piece:
        piece: Piece | None = _in_memory(self._file, n_bytes, self._at)
        if piece is None:
            piece = await run_in_threadpool(os.pread, self._file, n_bytes, self._at)
        self._at += len(piece)
        return piece


def _in_memory(file: int, n_bytes: int, at: int) -> bytearray | None:
    """Read a piece of a file if it is in memory; None if the disk must be waited for or the file ends before."""
    piece = bytearray(n_bytes)
    try:
        n_read = os.preadv(file, [piece], at, os.RWF_NOWAIT)
    except (OSError, AttributeError):  # AttributeError: the system has no such call
        return None
    return piece if n_read == n_bytes else None


@router.api_route("/media/{media}", methods=["GET", "HEAD"], response_class=FileResponse, include_in_schema=False)
def media(media: Annotated[str, Path(max_length=32)], request: Request, database: Store) -> Response:
    with database.reading() as connection:
        film = film_file(connection, media)
    if film is None:
        raise NotFoundError("There is no such video.")
    tag = entity_tag(media, film)
    headers = {"ETag": f'"{tag}"', "Cache-Control": FOREVER}
    if is_known(request.headers.get("if-none-match", ""), tag):
        return Response(status_code=304, headers=headers)
    path = settings(request).media_dir / film.file
    store: MediaStore | None = request.app.state.media_store
    if store is not None and not (film.codec == SINGLE and path.is_file()):  # a store's address would name a stimulus
        return RedirectResponse(store.address(film.file), headers={"Cache-Control": FOR_A_WHILE})
    if accel := settings(request).media_accel:
        headers["X-Accel-Redirect"] = accel + film.file
        return Response(headers=headers, media_type="video/mp4")
    try:
        status = path.stat()
    except FileNotFoundError as error:
        log.error("%s is missing; `reconstudy db check` names all such films, a backup with --media has them", path)
        if not path.parent.is_dir():  # a folder that may come back, such as one of another machine: browsers ask again
            raise UnavailableError("The videos are missing on the server. Please tell the experimenter.") from error
        raise NotFoundError("This video is missing on the server.") from error
    return Film(path, headers=headers, media_type="video/mp4", stat_result=status)


def entity_tag(media: str, film: FilmFile) -> str:
    """Return a digest of address and content; that of the content alone would tell which trials show the same film."""
    return hashlib.sha256(f"{media} {film.sha256}".encode()).hexdigest()


def is_known(if_none_match: str, tag: str) -> bool:
    """Whether a client already has the content, by RFC 9110's weak comparison."""
    tags = {known.strip().removeprefix("W/") for known in if_none_match.split(",")}
    return "*" in tags or f'"{tag}"' in tags
