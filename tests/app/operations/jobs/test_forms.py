"""An option of a command is one field: its flag and its place in the job's form follow."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from app.operations.jobs import forms
from app.operations.jobs.fields import Number
from app.operations.jobs.shared_fields import CAPTURE
from recon.cli.commands.reconstruction import Reconstruct
from recon.cli.commands.setting import option
from recon.cli.flags import with_settings


class Slower(Reconstruct):
    """Reconstructs with one more option."""

    pause: float = option(0.0, "Pause between frames, s.", ge=0, label="Pause", high=60)


def test_a_field_of_a_model_is_a_flag_and_a_field_of_the_form(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forms, "COMMANDS", {"reconstruct": Slower})
    field = forms.fields_of("reconstruct", {"capture": CAPTURE})[-1]
    assert field == Number(name="pause", label="Pause", help="between frames, s", option="--pause", low=0, high=60)

    app, asked = typer.Typer(), []

    @app.command()
    @with_settings(Slower)
    def slower(given: Slower, *, as_json: bool) -> None:
        asked.append((given, as_json))

    assert CliRunner().invoke(app, ["ball", "--out", "run", "--pause", "1.5", "--json"]).exit_code == 0
    assert [(given.pause, given.fusion, as_json) for given, as_json in asked] == [(1.5, "fa,fb", True)]
    refused = CliRunner().invoke(app, ["ball", "--out", "run", "--pause", "-1"])
    assert (refused.exit_code, "--pause" in refused.output) == (2, True)
