"""Keep and complete what was typed of a study that is not created yet, over what its way fills in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

from app.intake.stimuli import StimulusSet
from app.operations.studies.create import read_options
from app.operations.studies.forecast import SINGLE_FILMS, Forecast, forecast, has_many_pairs
from app.settings import Settings
from app.study.kinds import PRESETS, QUICK
from app.study.languages.language_pack import LanguagePack
from app.study.option_fields import Setting, SettingError
from app.study.options.neutral_words import neutral_words
from app.study.options.option_table import COLUMNS, SETTINGS, SETTINGS_BY_NAME
from app.study.options.options import StudyOptions, parse_options
from app.study.options.platforms import PLATFORMS, WAYS, Platform
from app.study.options.presets import read_preset
from app.study.options.study_file import StudyFile
from app.study.options.wording import check_languages
from app.study.protocols import RATED
from app.study.questions.answers import is_text_of
from app.study.stages import PRACTICE

_LISTS = ("several", "conditions", "names", "spoken")
_EXPECTED: Mapping[str, str] = {  # kinds of settings whose form takes no text
    **dict.fromkeys(_LISTS, "a list of texts"),
    **dict.fromkeys(("whole", "number"), "a number"),
    **dict.fromkeys(("questions", "films"), "a list of tables of texts, numbers and lists of texts"),
    "flag": "true or false",
    "window": "a list of numbers",
}
LARGEST_SHOWN = 2**63  # a seed; neither infinite nor without value


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
    def given(cls, content: Mapping[str, Any]) -> Self:
        """Read a draft that a program sends, which a form must be able to show.

        Raises
        ------
        ValueError
            If it names a preset, a platform or a setting that is not known, or a value is of another kind.
        """
        draft = cls(**content)
        for name, what, known in (("preset", draft.preset, [*PRESETS]), ("platform", draft.platform, [*PLATFORMS])):
            if what not in known:
                raise SettingError(name, f"is {what!r:.60}, expected one of {', '.join(filter(None, known))}")
        for name, value in draft.typed.items():
            if name not in SETTINGS_BY_NAME:
                raise ValueError(f"typed has {name[:60]!r}, which is no setting of a study")
            if not _is_shown(SETTINGS_BY_NAME[name], value):
                raise SettingError(
                    name, f"is {value!r:.60}, expected {_EXPECTED.get(SETTINGS_BY_NAME[name].kind, 'a text')}"
                )
        return draft

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

    def lack(self) -> str:
        """Return what the way back to the platform lacks, in words; empty if nothing."""
        try:
            self._outside(is_complete=True)
        except ValueError as error:
            return str(error)
        return ""

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


def outlook_of(
    settings: Settings, stimulus_set: StimulusSet, draft: Draft, packs: Mapping[str, LanguagePack]
) -> tuple[StudyFile, Forecast]:
    """Return the study that a draft describes, with a name where none was typed yet, and what it will be.

    Raises
    ------
    ValueError
        If it cannot be made so; StudyError if it would be complete in no language.
    """
    named = replace(draft, typed={"name": "New study", **draft.typed})
    wanted = named.study(has_many_pairs=has_many_pairs(stimulus_set))
    outlook = forecast(settings, stimulus_set, wanted.options, wanted.exposure_s)
    check_languages(wanted.options, packs)
    return wanted, outlook


def values_of(study: StudyFile) -> dict[str, Any]:
    """Return the values of all settings by name."""
    options = study.options.as_json()
    values: dict[str, Any] = {name: getattr(study, name) for name in COLUMNS}
    for setting in SETTINGS:
        table, _, key = setting.name.rpartition(".")
        if setting.name not in COLUMNS:
            values[setting.name] = options[table].get(key) if table else options[key]
    return values


def options_of(now: StudyOptions, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return options, as `parse_options` reads them, with what a form gives in place.

    A form also sends fields that have no effect any more: left as they were, they go; typed anew, they stay, and
    `parse_options` refuses them by name.

    Raises
    ------
    ValueError
        If a number is none.
    """
    options = now.as_json()
    for name, value in given.items():
        if name in COLUMNS:
            continue
        table, _, key = name.rpartition(".")
        place = options[table] if table else options
        place[key] = value
        if value is None:
            del place[key]
    before, screened = now.as_json(), options["screening"]
    if screened.get("distance") != "fixed" and screened.get("distance_cm") == before["screening"].get("distance_cm"):
        screened.pop("distance_cm", None)
    if options["protocol"] not in RATED and options["scale"] == before["scale"]:
        options.pop("scale")
    asked = {question["name"] for question in options["questions"]}
    options["texts"] = {
        language: {key: text for key, text in said.items() if is_text_of(key, asked)}
        for language, said in options["texts"].items()
    }
    return options


def _is_shown(setting: Setting, value: object) -> bool:
    """Can the form of a study show a value?"""
    match setting.kind:
        case "flag":
            return isinstance(value, bool)
        case "whole" | "number":
            return _is_number(value) or (value is None and setting.may_be_empty)
        case "window":
            return isinstance(value, list) and all(map(_is_number, value))
        case "questions" | "films":
            known_by = "name" if setting.kind == "questions" else "dataset"
            return isinstance(value, list) and all(_is_row(row, known_by) for row in value)
    if setting.kind in _LISTS:
        return _are_texts(value)
    return isinstance(value, str) or (setting.name == "scale" and _is_number(value))


def _is_row(row: object, known_by: str) -> bool:
    return (
        isinstance(row, dict)
        and isinstance(row.get(known_by), str)
        and all(
            _are_texts(part) if name in ("options", "labels") else isinstance(part, str | bool) or _is_number(part)
            for name, part in row.items()
        )
    )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_SHOWN


def _are_texts(value: object) -> bool:
    return isinstance(value, list) and all(isinstance(each, str) for each in value)
