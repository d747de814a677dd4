"""Find the language packs of a server: those of the program, and the experimenter's own in the data folder."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from app.files import packaged
from app.settings import Settings
from app.study.languages.language_pack import SHIPPED, LanguagePack, LanguagePackError, read_language_pack

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FoundPack:
    """A pack's file; `pack` is None where it is refused, and `refusal` says why."""

    path: Path
    pack: LanguagePack | None
    refusal: str = ""


def find_language_packs(settings: Settings) -> list[FoundPack]:
    """Find all packs, the program's first; a later one replaces an earlier one of the same language."""
    return list(_found(packaged(SHIPPED), settings.languages_dir))


def read_languages(settings: Settings) -> Mapping[str, LanguagePack]:
    """Return the packs in use, by tag; those with faults are refused, and the log says why."""
    packs: dict[str, LanguagePack] = {}
    for file in find_language_packs(settings):
        if file.pack is not None:
            packs[file.pack.tag] = file.pack
        else:
            log.warning("a language pack is refused: %s", file.refusal)
    return dict(sorted(packs.items()))


def _found(*folders: Path) -> Iterator[FoundPack]:
    for folder in folders:
        for path in sorted(folder.glob("*.json")):
            try:
                yield FoundPack(path, read_language_pack(path))
            except LanguagePackError as error:
                yield FoundPack(path, None, str(error))
