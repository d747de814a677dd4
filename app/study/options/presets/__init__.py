"""Name sets of study options for common kinds of study; each is a TOML file beside this module."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

from app.study.kinds import PRESETS
from app.study.languages.language_pack import flat_texts
from app.study.options.options import overridden
from app.study.options.own_texts import CONSENT, DEBRIEFING


@dataclass(frozen=True)
class Preset:
    """A named set of study options.

    Parameters
    ----------
    name : of PRESETS
    summary : what a session has, for those who choose
    options : as `parse_options` reads them; what is left out has its default
    """

    name: str
    summary: str
    options: Mapping[str, Any]

    def overridden_by(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options with those given in their place; the keys of a table replace one by one.

        A consent or debriefing given replaces the preset's in every language.
        """
        return overridden(self.options, given) | {"texts": self._texts_overridden_by(given)}

    def _texts_overridden_by(self, given: Mapping[str, Any]) -> Any:
        replaced = {key for key in (CONSENT, DEBRIEFING) if key.removeprefix("study.") in given}
        texts = {language: flat_texts(said) for language, said in self.options.get("texts", {}).items()}
        kept = {
            language: {key: text for key, text in said.items() if key not in replaced}
            for language, said in texts.items()
        }
        theirs = given.get("texts", {})
        if not isinstance(theirs, Mapping) or not all(isinstance(said, Mapping) for said in theirs.values()):
            return theirs  # which `parse_options` refuses
        return {
            language: {**kept.get(language, {}), **flat_texts(theirs.get(language, {}))}
            for language in {**kept, **theirs}
        }


def read_preset(name: str) -> Preset:
    """Read a preset.

    Raises
    ------
    ValueError
        If no preset has this name.
    """
    if name not in PRESETS:
        raise ValueError(f"preset {name!r} is not known; expected one of {', '.join(PRESETS)}")
    content = tomllib.loads(files(__name__).joinpath(f"{name}.toml").read_text(encoding="utf-8"))
    return Preset(name, content["summary"], content["options"])
