"""The finished files of a folder, so that work that was stopped goes on where it stopped.

A file is finished when its note, ``.finished/NAME.json``, is there: it is written after the file, and holds the key of
what the file was made from (inputs, parameters, code), the file's own digest, and what its maker warned of. A file
whose note has another key, or that is not the one whose digest the note holds, is made again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ground.files import file_digest as file_digest
from recon.runtime.files import read_json, write_json
from recon.runtime.remote import fetched, is_copy, is_there, remove, stored

PACKAGE = Path(__file__).parents[1]
NOTES = ".finished"

Warnings = Sequence[str] | None  # what users of a file should know about it, a sentence each


def key_of(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a JSON-like description; the order of its entries does not matter."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


@cache
def code_version(*sources: str) -> str:
    """Digest the source text of modules or packages of `recon`, e.g. ``code_version("depth", "cloud.py")``."""
    digest = hashlib.sha256()
    for source in sources:
        path = PACKAGE / source
        for file in sorted(path.rglob("*.py")) + sorted(path.rglob("*.cu")) if path.is_dir() else [path]:
            digest.update(file.read_bytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Artefacts:
    """The finished files of a folder, which may be the copy of one behind a URL; names are paths in it."""

    folder: Path

    def make(self, name: str, key: Mapping[str, Any], write: Callable[[Path], Warnings]) -> list[str]:
        """Make one file as `make_together` does.

        Parameters
        ----------
        name, key : of the file, and what it is made from
        write : writes the file at a path, and returns warnings
        """
        return self.make_together([name], key, lambda paths: write(paths[0]))

    def make_together(
        self, names: Sequence[str], key: Mapping[str, Any], write: Callable[[list[Path]], Warnings]
    ) -> list[str]:
        """Make files in one go, unless all are finished and of this key; returns the names of those made: all or none.

        Parameters
        ----------
        names : of the files
        key : what they are made from: inputs, parameters, code
        write : writes the files at their paths, and returns warnings
        """
        if all(self.has(name, key) for name in names):
            return []
        for name in names:
            remove(self._note(name))
        paths = [self.folder / name for name in names]
        warnings = write(paths)
        for name, path in zip(names, paths, strict=True):
            note = {"key": key_of(key), "sha256": file_digest(stored(path))}
            write_json(self._note(name), note | ({"warnings": list(warnings)} if warnings else {}))
            stored(self._note(name))
        return list(names)

    def has(self, name: str, key: Mapping[str, Any]) -> bool:
        """Return whether a file is finished and of this key."""
        path = self.folder / name
        if not (is_there(path) and is_there(self._note(name))):
            return False
        try:
            note = self._read_note(name)
        except ValueError:  # a crash of the machine can leave an empty file
            return False
        if note.get("key") != key_of(key):
            return False
        return is_copy(path) or note.get("sha256") == file_digest(path)  # an object store keeps its own digests

    def path(self, name: str) -> Path:
        """Return where a file can be read on this machine, after fetching it if the folder is behind a URL."""
        return fetched(self.folder / name)

    def digest(self, name: str) -> str:
        """Return the SHA-256 of a finished file, as its note has it."""
        return str(self._read_note(name)["sha256"])

    def digests(self, names: Iterable[str]) -> list[str]:
        """Return the SHA-256 of several finished files, in their order."""
        return [self.digest(name) for name in names]

    def warnings(self, names: Iterable[str]) -> list[str]:
        """Return what was warned of when finished files were made, in their order."""
        return [warning for name in names for warning in self._read_note(name).get("warnings", ())]

    def remove(self, names: Iterable[str]) -> None:
        """Remove files that are not needed any more, with their notes."""
        for name in names:
            remove(self._note(name))
            remove(self.folder / name)

    def _note(self, name: str) -> Path:
        return self.folder / NOTES / f"{name}.json"

    def _read_note(self, name: str) -> dict[str, Any]:
        try:
            return read_json(fetched(self._note(name)))
        except ValueError as error:
            raise ValueError(
                f"{error}; it says how {name} was made: copy a folder with its hidden ones, or start the command that "
                "made it again"
            ) from error
