"""Name sets of study options for common kinds of study; each is a TOML file beside this module."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

PAPER, QUICK, ONLINE = "paper", "quick", "online"
PRESETS = (PAPER, QUICK, ONLINE)


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
        texts = self.options.get("texts", {})
        kept = {tag: {"study": _without(said["study"], given)} for tag, said in texts.items()}
        options = {**self.options, "texts": {tag: said for tag, said in kept.items() if said["study"]}}
        tables = {
            key: {**value, **given[key]}
            for key, value in options.items()
            if isinstance(value, Mapping) and isinstance(given.get(key), Mapping)
        }
        return {**options, **given, **tables}


def _without(texts: Mapping[str, str], given: Mapping[str, Any]) -> dict[str, str]:
    return {key: text for key, text in texts.items() if key not in given}


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
