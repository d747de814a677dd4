"""The form of a command's job: each setting that the command offers to forms, and what lies on shelves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, get_args

from pydantic.fields import FieldInfo

from app.operations.commands import COMMANDS
from app.operations.jobs.fields import Choice, Choices, Field, FrameRange, Names, NewName, Number, Switch, Text
from recon.cli.commands.setting import FRAME_RANGE, NAMES, Setting, bounds, settings_of


def fields_of(command: str, places: Mapping[str, Field]) -> tuple[Field, ...]:
    """Return the fields of a command's job, in the order of its settings.

    Parameters
    ----------
    command : as `COMMANDS` names it
    places : by the setting's name, the field in its place: of entries and names, which the setting knows as paths
    """
    return tuple(_fields(command, places))


def out_option(command: str, places: Mapping[str, Field]) -> str | None:
    """Return the option of a command for the name that a job makes; empty: it is an argument; None: it has none."""
    options = {name: setting.flag(name) for name, _, setting in settings_of(COMMANDS[command])}
    made = [options[name] for name, field in places.items() if isinstance(field, NewName)]
    return made[0] if made else options.get("out")


def _fields(command: str, places: Mapping[str, Field]) -> Iterator[Field]:
    for name, info, setting in settings_of(COMMANDS[command]):
        if (field := places.get(name)) is not None:
            is_given = field.option is not None  # else the kind writes it
            given = {"option": setting.flag(name), "is_required": info.is_required()}
            yield replace(field, **given) if is_given else field  # type: ignore[arg-type]  # of any field
        elif setting.label:
            yield _field(name, info, setting)


def _field(name: str, info: FieldInfo, setting: Setting) -> Field:
    said: dict[str, Any] = {
        "name": name,
        "label": setting.label,
        "help": setting.in_form(info.description or ""),
        "option": setting.flag(name),
        "is_required": info.is_required(),
        "default": _default(info, setting),
    }
    types = (info.annotation, *get_args(info.annotation))
    if bool in types:
        off = f"--no-{name.replace('_', '-')}" if info.default else ""
        return Switch(**said | {"default": info.default, "option": "" if off else said["option"], "off_option": off})
    if setting.choices:
        return (Choices if setting.is_several else Choice)(**said, choices=setting.choices)
    if int in types or float in types:
        low, high = bounds(info)
        is_whole = int in types
        return Number(**said, low=_first(setting.low, low), high=_first(setting.high, high), is_whole=is_whole)
    is_repeated = setting.form == NAMES and list[str] in types
    made = FrameRange if setting.form == FRAME_RANGE else Names if is_repeated else Text
    return made(**said, form=setting.form, example=setting.example)


def _first(*bounds: float | None) -> float:
    return next(bound for bound in bounds if bound is not None)


def _default(info: FieldInfo, setting: Setting) -> Any:
    """Return what a form shows where nothing is given; None: nothing, and the command's own default counts."""
    if info.is_required() or setting.is_blank or setting.is_several or not info.default:
        return None
    shown = info.default[0] if isinstance(info.default, list) else info.default
    return int(shown) if isinstance(shown, float) and shown.is_integer() else shown
