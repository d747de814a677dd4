"""Finished artefacts of a run, keyed by the digest of what they were made from, so that a run can be resumed.

An artefact counts as finished only if its note says so: the note is written after the file, and holds the key
(inputs, parameters, code version), the file's own digest, and what its maker warned of. A run that is killed between
the two makes it again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from recon.storage.files import read_json, write_json
from recon.storage.remote import fetched, is_copy, is_there, remove, stored

PACKAGE = Path(__file__).parents[1]

Warnings = Sequence[str] | None
"""What those who use an artefact should know about it, a sentence each."""


def file_digest(path: Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def key_of(content: Mapping[str, Any]) -> str:
    """SHA-256 of a JSON-like description; the order of its keys does not matter."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


@cache
def code_version(*sources: str) -> str:
    """Digest of the source text of modules or packages of `recon`, e.g. ``code_version("depth", "cloud.py")``."""
    digest = hashlib.sha256()
    for source in sources:
        path = PACKAGE / source
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.read_bytes())
    return digest.hexdigest()


class Artefacts:
    """The finished files under one folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def make(self, name: str, key: Mapping[str, Any], write: Callable[[Path], Warnings]) -> bool:
        """Call `write` with the artefact's path unless it is there already with the same key; keep its warnings.

        Returns whether it had to be made.
        """
        return self.make_together([name], key, lambda paths: write(paths[0]))

    def make_together(
        self, names: Sequence[str], key: Mapping[str, Any], write: Callable[[list[Path]], Warnings]
    ) -> bool:
        """As `make`, for artefacts that one pass writes: unless all are there, all are made."""
        wanted = key_of(key)
        if all(self._is_whole(name, wanted) for name in names):
            return False
        for name in names:
            remove(self._note(name))
        paths = [self.folder / name for name in names]
        warnings = write(paths)
        for name, path in zip(names, paths, strict=True):
            note = {"key": wanted, "sha256": file_digest(stored(path))}
            write_json(self._note(name), note | ({"warnings": list(warnings)} if warnings else {}))
            stored(self._note(name))
        return True

    def has(self, name: str, key: Mapping[str, Any]) -> bool:
        """Whether the artefact is there with this key."""
        return self._is_whole(name, key_of(key))

    def digest(self, name: str) -> str:
        """SHA-256 of a finished artefact."""
        return str(self._written(name)["sha256"])

    def digests(self, names: Iterable[str]) -> list[str]:
        """SHA-256 of several finished artefacts, in their order."""
        return [self.digest(name) for name in names]

    def warnings(self, names: Iterable[str]) -> list[str]:
        """What was warned of when finished artefacts were made, in their order."""
        return [warning for name in names for warning in self._written(name).get("warnings", ())]

    def remove(self, names: Iterable[str]) -> None:
        """Remove artefacts that are not needed any more, with their notes."""
        for name in names:
            remove(self._note(name))
            remove(self.folder / name)

    def _note(self, name: str) -> Path:
        return self.folder / ".finished" / f"{name}.json"

    def _written(self, name: str) -> dict[str, Any]:
        return read_json(fetched(self._note(name)))

    def _is_whole(self, name: str, wanted: str) -> bool:
        path = self.folder / name
        if not (is_there(path) and is_there(self._note(name))):
            return False
        written = self._written(name)
        if written.get("key") != wanted:
            return False
        return is_copy(path) or written.get("sha256") == file_digest(path)  # an object store keeps its own digests
