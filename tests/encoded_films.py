"""Films that a test run has encoded or decoded once: the same sources make the same films, which are copied."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

from app.ffmpeg import VideoFacts, decode
from app.files import whole_file
from app.films.strips import Strips


def made_once(make_film: Callable[[Strips, Path], None], folder: Path) -> Callable[[Strips, Path], None]:
    """Copy films that lie in a folder from earlier; processes may share it, as a film's name says its content."""

    def make(strips: Strips, path: Path) -> None:
        kept = folder / path.name
        if not kept.is_file():
            make_film(strips, path)
            with whole_file(kept) as temporary:
                shutil.copyfile(path, temporary)
            return
        with whole_file(path) as temporary:
            shutil.copyfile(kept, temporary)

    return make


def decoded_once() -> Callable[[Path], VideoFacts]:
    """Decode each content once; what cannot be decoded is refused anew each time."""
    known: dict[tuple[str, str], VideoFacts] = {}

    def facts(path: Path) -> VideoFacts:
        if not path.is_file():
            return decode(path)
        content = path.suffix, sha256(path.read_bytes()).hexdigest()
        if content not in known:
            known[content] = decode(path)
        return known[content]

    return facts
