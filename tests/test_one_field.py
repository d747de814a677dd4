"""An option is one field: what "Where to add" of the architecture's page promises."""

from __future__ import annotations

from typing import Annotated

import pytest
import typer
from pydantic import Field
from typer.testing import CliRunner

from app.operations.commands import COMMANDS
from app.operations.jobs.fields import Number
from app.operations.jobs.forms import fields_of
from app.study.option_fields import Setting, settings_of
from app.study.options.options import StudyOptions
from recon.cli.commands.reconstruction import Reconstruct
from recon.cli.commands.setting import option
from recon.cli.flags import with_settings


class Louder(StudyOptions):
    loudness: Annotated[int, Setting("Loudness", "of the films", section="trials")] = Field(0, ge=0, le=10)


class Smoothed(Reconstruct):
    smoothing: float = option(1.5, "Radius of smoothing, voxels", ge=0, le=9, label="Smoothing")


def test_a_field_of_a_studys_options_is_read_refused_shown_in_a_form_and_described_by_the_schema() -> None:
    assert Louder.read({"loudness": 3}).as_json()["loudness"] == 3
    with pytest.raises(ValueError, match="loudness is 11, expected a whole number from 0 to 10"):
        Louder.read({"loudness": 11})
    (shown,) = (setting for setting in settings_of(Louder) if setting.name == "loudness")
    assert (shown.label, shown.kind, shown.low, shown.high, shown.section) == ("Loudness", "whole", 0, 10, "trials")
    described = Louder.model_json_schema()["properties"]["loudness"]
    assert (described["title"], described["maximum"], described["default"]) == ("Loudness", 10, 0)


def test_a_field_of_a_commands_settings_is_its_flag_a_field_of_its_job_and_described_by_the_schema(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(COMMANDS, "reconstruct", Smoothed)  # type: ignore[arg-type]  # a dict beneath its Mapping
    (shown,) = (field for field in fields_of("reconstruct", {}) if field.name == "smoothing")
    assert isinstance(shown, Number)
    assert (shown.label, shown.option, shown.low, shown.high) == ("Smoothing", "--smoothing", 0, 9)
    described = Smoothed.model_json_schema()["properties"]["smoothing"]
    assert (described["default"], described["maximum"]) == (1.5, 9)
    given: list[float] = []

    @with_settings(Smoothed)
    def reconstruct(settings: Smoothed, *, as_json: bool) -> None:
        assert not as_json
        given.append(settings.smoothing)

    app = typer.Typer()
    app.command()(reconstruct)
    assert CliRunner().invoke(app, ["capture", "-o", "run", "--smoothing", "2.5"]).exit_code == 0
    assert CliRunner().invoke(app, ["capture", "-o", "run", "--smoothing", "10"]).exit_code == 2
    assert given == [2.5]
