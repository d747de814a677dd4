"""The table of settings tells what the code does: every option stands in it, with its choices and bounds."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import pytest

from app.study.option_fields import WITH_FILMS, Setting, is_table, settings_of
from app.study.options.option_table import (
    CHANGES,
    COLUMNS,
    SECTIONS,
    SETTINGS,
    why_fixed,
)
from app.study.options.options import StudyOptions, parse_options

NEEDS = {  # what an option needs beside it, to be right
    ("scale", "*"): {"protocol": "ACR"},
    ("protocol", "ACR-HR"): {"reference": "x"},
    ("protocol", "DCR"): {"reference": "x"},
    ("screening.distance", "fixed"): {"screening": {"distance": "fixed", "distance_cm": 90}},
    ("screening.distance_cm", "*"): {"screening": {"distance": "fixed"}},
    ("questions", "*"): {"optional_stages": []},
}
ELSEWHERE = ("languages", "texts", "groups")  # on pages of their own
OPTIONS = [setting for setting in SETTINGS if setting.name not in COLUMNS]
WITH_CHOICES = [setting for setting in OPTIONS if setting.choices]
WITH_BOUNDS = [setting for setting in OPTIONS if setting.kind in ("whole", "number")]


def name_of(setting: Setting) -> str:
    return setting.name


def content(setting: Setting, value: Any) -> dict[str, Any]:
    """Options with one of them set, and what it needs beside it."""
    needed = NEEDS.get((setting.name, str(value)), NEEDS.get((setting.name, "*"), {}))
    table, _, key = setting.name.rpartition(".")
    return {**needed, table: {**needed.get(table, {}), key: value}} if table else {**needed, key: value}


def test_every_option_stands_in_the_table_once() -> None:
    names = []
    for name, option in StudyOptions.model_fields.items():
        table = option.annotation
        names += [f"{name}.{key}" for key in table.model_fields] if is_table(option) and table else [name]
    listed = [*ELSEWHERE, *(setting.name for setting in OPTIONS)]
    assert sorted(listed) == sorted(names)
    assert set(CHANGES) == {*StudyOptions.model_fields, *COLUMNS}
    assert {setting.section for setting in SETTINGS} == set(SECTIONS)


@pytest.mark.parametrize("setting", WITH_CHOICES, ids=name_of)
def test_every_choice_of_the_table_can_be_chosen(setting: Setting) -> None:
    for key in setting.choices:
        value = int(key) if key.isdecimal() else key
        parse_options(content(setting, [value] if setting.kind == "several" else value))
    with pytest.raises(ValueError, match=setting.name.rpartition(".")[2]):
        parse_options(content(setting, ["nothing such"] if setting.kind == "several" else "nothing such"))


@pytest.mark.parametrize("setting", WITH_BOUNDS, ids=name_of)
def test_the_bounds_of_the_table_are_those_of_the_code(setting: Setting) -> None:
    kind = int if setting.kind == "whole" else float
    for bound, beyond in ((setting.low, -1), (setting.high, 1)):
        if bound is not None:
            parse_options(content(setting, kind(bound)))
            with pytest.raises(ValueError, match=setting.name.rpartition(".")[2]):
                parse_options(content(setting, kind(bound + beyond)))


def test_a_setting_that_cannot_change_says_why() -> None:
    for setting in SETTINGS:
        assert not why_fixed(setting.change, has_begun=False, has_stimuli=True)
        needs_set = why_fixed(setting.change, has_begun=False, has_stimuli=False)
        assert ("stimulus set is not on this server" in needs_set) == (setting.change == WITH_FILMS)
        assert bool(why_fixed(setting.change, has_begun=True, has_stimuli=True)) == (setting.change != "any time")


def test_the_documentation_lists_every_option_with_its_default_and_when_it_may_change() -> None:
    path = Path(__file__).parents[4] / "docs" / "reference.py"
    spec = importlib.util.spec_from_file_location("reference", path)
    assert spec is not None
    assert spec.loader is not None
    reference = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(reference)
    table = reference.settings().partition("## Studies")[2].partition("## Analyses")[0]
    listed = {
        name: (default, change)
        for name, default, change in re.findall(r"^\| `([\w.]+)` \| .* \| ([^|]*) \| ([^|]*) \|$", table, re.MULTILINE)
    }
    assert {name: change for name, (_, change) in listed.items()} == {
        setting.name: setting.change for setting in settings_of(StudyOptions)
    }
    assert [listed[name][0] for name in ("protocol", "break_every", "see_both")] == ["`PC`", "`25`", "`yes`"]


@pytest.mark.parametrize("setting", SETTINGS, ids=name_of)
def test_what_a_setting_expects_is_said_in_words_and_not_as_a_file_writes_it(setting: Setting) -> None:
    assert not re.search(r"[\[\]{}]", setting.expected)
