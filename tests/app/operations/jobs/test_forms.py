"""An option of a command is one field: its flag and its place in the job's form follow."""

from __future__ import annotations

import pytest
import typer
from typer.testing import CliRunner

from app.operations.jobs import forms
from app.operations.jobs.fields import Entries, Entry, Field, Number, Text
from app.operations.jobs.kinds import KINDS
from app.operations.jobs.shared_fields import CAPTURE
from app.settings import Settings
from recon.cli.commands.reconstruction import Reconstruct
from recon.cli.commands.setting import option
from recon.cli.flags import with_settings

FIELDS = {f"{kind.name} {field.name}": field for kind in KINDS.values() for field in kind.fields}


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


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
def test_a_field_takes_what_its_form_shows_and_gives_as_example(field: Field) -> None:
    shown = [] if isinstance(field, Entry | Entries) or field.default is None else [field.default]
    if isinstance(field, Text):
        assert field.example
        shown += field.example.split(" or ")
    for value in shown:
        assert field.read(value, Settings()) is not None


@pytest.mark.parametrize("field", FIELDS.values(), ids=FIELDS)
def test_a_form_says_nothing_that_only_a_command_line_has(field: Field) -> None:
    assert "--" not in field.help
    assert field.help[:1].isalnum() or not field.help
