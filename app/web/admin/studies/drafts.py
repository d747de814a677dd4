"""Read, keep and complete the form of a study that is not created yet: what was typed, over what its way fills in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

from starlette.datastructures import FormData

from app.operations.studies.create import read_options
from app.study.options.neutral_words import neutral_words
from app.study.options.option_table import COLUMNS
from app.study.options.options import parse_options
from app.study.options.platforms import PLATFORMS, WAYS, Platform
from app.study.options.presets import PRESETS, QUICK, read_preset
from app.study.options.study_file import StudyFile
from app.study.stages import PRACTICE
from app.web.admin.studies.form import ANSWERS, WAS, WAY, changed_since, options_of, read_values, values_of

SINGLE_FILMS: Mapping[str, Any] = {"pair_films": "decoded", "lighter_films": False, "second_codec": ""}


@dataclass(frozen=True)
class Draft:
    """A form as it was typed.

    Parameters
    ----------
    preset, platform : that fill in what was not typed
    answers : what the platforms ask for, by PLATFORM.NAME
    typed : the settings that differ from what these fill in, by name
    """

    preset: str = QUICK
    platform: str = ""
    answers: Mapping[str, str] = field(default_factory=dict)
    typed: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def kept(cls, content: Mapping[str, Any]) -> Self:
        """Read a draft that was kept; one of another version begins anew."""
        known = {name: content[name] for name in cls.__dataclass_fields__ if name in content}
        draft = cls(**known)
        return draft if draft.preset in PRESETS and draft.platform in PLATFORMS else cls()

    @classmethod
    def sent(cls, fields: FormData, preset: str, platform: str) -> Self:
        """Read a draft from the form.

        Raises
        ------
        InvalidError
            If the form has a field that is no setting, or a number is none.
        """
        given = read_values(fields)
        was = str(fields.get(WAS, ""))
        if not was:  # a form of nobody's page, such as a program's
            plain = values_of(StudyFile(name="", options=read_options(None, {}, preset))) if preset in PRESETS else {}
            given = {name: value for name, value in given.items() if value != plain.get(name)}
        way = WAYS.get(str(fields.get(WAY, "")))
        answers = {name.removeprefix(ANSWERS): str(fields[name])[:200] for name in fields if name.startswith(ANSWERS)}
        draft = cls(preset, platform, answers, changed_since(was, given))
        return replace(draft, preset=way.preset, platform=way.platform) if way else draft

    @property
    def way(self) -> str:
        """Where people take part; empty: none of the ways has these."""
        fits = (name for name, way in WAYS.items() if (way.preset, way.platform) == (self.preset, self.platform))
        return next(fits, "")

    @property
    def sends(self) -> Platform:
        """The platform that sends people."""
        return PLATFORMS[self.platform]

    def as_json(self) -> dict[str, Any]:
        return asdict(self)

    def base(self, *, is_neutral: bool, has_many_pairs: bool = False) -> dict[str, Any]:
        """Return what is filled in where nothing was typed, by setting.

        Parameters
        ----------
        is_neutral : do the films show anything? Then no words speak of models
        has_many_pairs : too many to make a film of each? Then browsers decode single ones
        """
        options = read_options(None, {}, self.preset)
        values = values_of(StudyFile(name="", options=neutral_words(options) if is_neutral else options))
        return {**values, **(SINGLE_FILMS if has_many_pairs else {}), **self._outside(is_complete=False)}

    def study(self, *, has_many_pairs: bool = False) -> StudyFile:
        """Return the study that the form describes; `has_many_pairs` as for `base`.

        Raises
        ------
        ValueError
            If a value is not right, or the way back to the platform lacks something.
        """
        chosen = read_preset(self.preset)
        base = parse_options(chosen.options)
        single = SINGLE_FILMS if has_many_pairs else {}
        changed = {**single, **self._outside(is_complete=True), **self.typed}
        if changed.get("consent") and "consent_version" not in changed:
            changed["consent_version"] = ""  # the version names the preset's text
        wanted = options_of(base, changed)
        tops = {name.partition(".")[0] for name in changed} - set(COLUMNS)
        if "scale" not in wanted:
            tops.discard("scale")
        options = parse_options(chosen.overridden_by({name: wanted[name] for name in tops}))
        if options.practice_dataset:
            options = options.with_stage(PRACTICE)
        columns = {name: changed[name] for name in COLUMNS if changed.get(name) is not None}
        return StudyFile.read({"name": "", **columns, "options": options})

    def _outside(self, *, is_complete: bool) -> dict[str, Any]:
        """Return what the platform fills in; incomplete, as far as it was answered."""
        prefix = f"{self.platform}."
        ours = {name.removeprefix(prefix): text for name, text in self.answers.items() if name.startswith(prefix)}
        try:
            filled = self.sends.filled(ours)
        except ValueError:
            if is_complete:
                raise
            filled = dict(self.sends.outside)
        return {f"outside.{name}": list(value) if isinstance(value, tuple) else value for name, value in filled.items()}
