"""Unpack uploaded zip files safely: limits on names, on the number and kinds of files, and on what they unpack to."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import IO

from app.errors import InvalidError, TooLargeError
from app.files import LARGEST_JSON, is_plain_name
from ground.files import DAMAGED_ZIP

MB = 1024 * 1024
MOST_FILES = 2000  # in an upload of results or films
MOST_PARTS = 8  # of a path; a capture's are up to truth/depth/held_out/S1_S2/0000.png
MOST_RATIO = 200  # unpacked to packed; films and models hardly compress
PACKED_BY = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # others may ask for gigabytes to unpack a byte
LARGEST: Mapping[str, int] = {".json": LARGEST_JSON}  # bytes of a file by its suffix; others share the upload's limit
LEFT_OUT = ("__MACOSX", "Thumbs.db", "desktop.ini")  # what desktops add to folders, besides hidden files
DAMAGED = (*DAMAGED_ZIP, UnicodeDecodeError)  # the last where a name is not in UTF-8
BEGINNINGS: Mapping[str, tuple[bytes, ...]] = {  # how files begin whose content is shown or decoded
    ".png": (b"\x89PNG\r\n\x1a\n",),
    ".jpg": (b"\xff\xd8\xff",),
    ".jpeg": (b"\xff\xd8\xff",),
    ".ply": (b"ply\n", b"ply\r"),
    ".glb": (b"glTF",),
    ".las": (b"LASF",),
    ".laz": (b"LASF",),
    ".e57": (b"ASTM-E57",),
    ".parquet": (b"PAR1",),
    ".spz": (b"\x1f\x8b", b"NGSP"),
    ".sog": (b"PK\x03\x04",),
    ".mkv": (b"\x1aE\xdf\xa3",),
    ".webm": (b"\x1aE\xdf\xa3",),
    ".avi": (b"RIFF",),
    ".webp": (b"RIFF",),
    ".pdf": (b"%PDF-",),
    ".svg": (b"<svg", b"<?xml"),
}
MP4 = (".mp4", ".mov", ".m4v")
MP4_MARK, MP4_MARK_AT = b"ftyp", 4


def is_zip(path: Path) -> bool:
    """Tell a zip file, whole or damaged, from any other by how it begins."""
    with path.open("rb") as file:
        return file.read(2) == b"PK"


def check_zip(packed: Path, largest_mb: int, most_files: int = MOST_FILES) -> None:
    """Check an upload before unpacking any of it.

    Parameters
    ----------
    packed : the zip file
    largest_mb : how much it may unpack to
    most_files : how many files it may hold

    Raises
    ------
    InvalidError
        If it is not a zip file of plain names: names the file in it.
    TooLargeError
        If it would unpack to more than the limit, or than there is room for.
    """
    try:
        with zipfile.ZipFile(packed) as archive:
            _check_entries(_files_in(archive), largest_mb, most_files, shutil.disk_usage(packed.parent).free)
    except zipfile.BadZipFile as error:
        raise InvalidError("This is not a zip file.") from error
    except DAMAGED as error:
        raise InvalidError(f"The zip file cannot be read: {error}. Pack it again, then repeat.") from error


def unpack(packed: Path, out: Path, limit: int, suffixes: Collection[str], kind: str) -> None:
    """Unpack below `out`; the sizes in the headers are not trusted.

    Parameters
    ----------
    packed : the zip file
    out : a folder that may be missing
    limit : how much it may unpack to, bytes
    suffixes, kind : of files that belong there, and what they are, as in `check_file`

    Raises
    ------
    InvalidError
        If the zip file is damaged or encrypted, or a file in it does not belong there.
    TooLargeError
        If it unpacks to more than the limit, or to far more than it is packed to.
    """
    try:
        with zipfile.ZipFile(packed) as archive:
            most = min(limit, MOST_RATIO * packed.stat().st_size + MB)  # entries may share their packed bytes
            for entry in _files_in(archive):
                path = out.joinpath(*PurePosixPath(entry.filename).parts)
                try:
                    path.parent.mkdir(parents=True, exist_ok=True)
                    most -= _unpack(archive, entry, path, most)
                except (FileExistsError, NotADirectoryError) as error:
                    raise InvalidError(f"{entry.filename} is in the zip file twice, or inside a file.") from error
                check_file(path, entry.filename, suffixes, kind)
    except DAMAGED as error:
        raise InvalidError(f"The zip file is damaged or encrypted: {error}. Pack it again, then repeat.") from error


def check_file(path: Path, name: str, suffixes: Collection[str], kind: str) -> None:
    """Refuse a file that does not belong to its kind, or whose content is another than its name says.

    Parameters
    ----------
    path : the file
    name : its name in the upload
    suffixes : of files that belong there
    kind : what they are

    Raises
    ------
    InvalidError
        Naming the file.
    """
    suffix = PurePosixPath(name).suffix.lower()
    if suffix not in suffixes:
        raise InvalidError(f"{name} does not belong to {kind}; expected files that end in {', '.join(suffixes)}.")
    with path.open("rb") as file:
        head = file.read(16)
    is_mp4 = head[MP4_MARK_AT : MP4_MARK_AT + len(MP4_MARK)] == MP4_MARK
    if not head.startswith(BEGINNINGS.get(suffix, (b"",))) or (suffix in MP4 and not is_mp4):
        raise InvalidError(f"{name} is no {suffix[1:].upper()} file, whatever its name says.")
    if suffix == ".svg" and b"<script" in path.read_bytes().lower():
        raise InvalidError(f"{name} holds a script, which a figure needs not; leave it out.")


def _files_in(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """Return the files of an archive, without hidden ones and what desktops add."""
    return [entry for entry in archive.infolist() if not entry.is_dir() and not _is_left_out(entry.filename)]


def _is_left_out(name: str) -> bool:
    parts = name.split("/")
    is_hidden = any(part.startswith(".") and part not in (".", "..") for part in parts)
    return is_hidden or parts[0] in LEFT_OUT or parts[-1] in LEFT_OUT


def _check_entries(entries: list[zipfile.ZipInfo], largest_mb: int, most_files: int, free: int) -> None:
    if not 1 <= len(entries) <= most_files:
        raise InvalidError(f"The zip file holds {len(entries)} files; expected 1 to {most_files}.")
    for entry in entries:
        parts = PurePosixPath(entry.filename).parts
        if not all(map(is_plain_name, parts)) or len(parts) > MOST_PARTS:
            raise InvalidError(
                f"The name {entry.filename[:120]!r} in the zip file is not plain; expected letters, digits and spaces, "
                'no dot at the beginning and none of \\ : * ? " < > |.'
            )
        if entry.compress_type not in PACKED_BY:
            raise InvalidError(
                f"{entry.filename} is packed by another method than Deflate. Pack it again, then repeat."
            )
        _check_size(entry, entry.file_size)
    if (total := sum(entry.file_size for entry in entries)) > largest_mb * MB:
        raise TooLargeError(f"The zip file unpacks to {total // MB} MB; this server takes {largest_mb} MB at most.")
    if total > free:
        raise TooLargeError(
            f"The zip file unpacks to {total // MB} MB; the server's disk has {free // MB} MB free. Delete what nobody "
            "needs, then repeat."
        )


def _unpack(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, path: Path, most: int) -> int:
    """Unpack a file of at most so many bytes; return how many it has."""
    size = 0
    with archive.open(entry) as source, path.open("xb") as target:
        for chunk in _chunks(source):
            size += len(chunk)
            _check_size(entry, size)
            if size > most:
                raise TooLargeError(
                    f"The zip file unpacks to far more than it may; it was stopped at {entry.filename}."
                )
            target.write(chunk)
    return size


def _check_size(entry: zipfile.ZipInfo, size: int) -> None:
    """Refuse a file that unpacks to more than its kind does, or to far more than it is packed to."""
    largest = LARGEST.get(PurePosixPath(entry.filename).suffix.lower(), size)
    if size > largest or size > MOST_RATIO * max(entry.compress_size, 1) + MB:
        raise InvalidError(f"{entry.filename} unpacks to {size / MB:.1f} MB, far more than such files do.")


def _chunks(source: IO[bytes]) -> Iterator[bytes]:
    while chunk := source.read(MB):
        yield chunk
