"""The command line as a whole: its commands, their help and wrong use."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from app.cli import _fail, main
from recon.cli.console import ProgressLine
from tests.command_line import Command


def commands_of(*group: str) -> Iterator[tuple[str, ...]]:
    """Every command of the installed program, asked of the program itself."""
    import typer

    from app.cli import app

    def walk(node: Any, path: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
        for name, child in getattr(node, "commands", {}).items():
            yield (*path, name)
            yield from walk(child, (*path, name))

    yield from walk(typer.main.get_command(app), group)


@pytest.mark.slow
@pytest.mark.parametrize("path", [(), *commands_of()], ids=" ".join)
def test_every_command_explains_itself(command: Command, path: tuple[str, ...]) -> None:
    told = command(*path, "--help")
    assert told.code == 0
    usage = re.split(r"\n\s*\n", told.out.partition("Usage: ")[2])[0]
    assert usage
    assert re.findall(r"\{[^}]*\}", usage) == [place.upper() for place in re.findall(r"\{[^}]*\}", usage)]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("analyse x --seed -1", "'--seed': '-1', expected a whole number of at least 0"),
        ("analyse x --seed one", "'--seed': 'one', expected a whole number of at least 0"),
        ("analyse x --by scene", "'--by': 'scene', expected one of dataset, none"),
        ("study create a --name b --exposure long", "'--exposure': 'long', expected a number"),
    ],
)
def test_a_wrong_value_is_told_in_the_words_of_all_refusals(command: Command, arguments: str, sentence: str) -> None:
    told = command(*arguments.split())
    assert told.code == 2
    assert f"Invalid value for {sentence}" in told.err


def test_the_contract_names_its_commands() -> None:
    single = {"demo", "match", "reconstruct", "render", "serve", "simulate", "analyse", "status"}
    groups = {"capture", "stimuli", "study", "admin", "token", "db"}
    assert single | groups <= {path[0] for path in commands_of() if len(path) == 1}


@pytest.mark.slow
def test_help_and_server_load_no_reconstruction_backend() -> None:
    heavy = "{'cv2', 'numba', 'pyrender', 'trimesh', 'skimage', 'open3d'}"
    code = f"import sys, app.cli, app.main; sys.exit(' '.join({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert not done.stderr.strip()


@pytest.mark.parametrize(("is_terminal", "before"), [(True, "\r\x1b[K"), (False, "\n")])
def test_an_error_is_not_written_behind_the_progress(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], is_terminal: bool, before: str
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal)
    ProgressLine()("checking", 1, 2)
    with pytest.raises(SystemExit):
        _fail("broken.mp4: cannot be decoded as a video")
    written = capsys.readouterr().err
    assert "checking: 1/2" in written
    assert written.endswith(f"{before}reconstudy: broken.mp4: cannot be decoded as a video\n")


def test_wrong_use_ends_with_2(command: Command, tmp_path: Path) -> None:
    assert command("reconstruct").code == 2
    assert command("no-such-command").code == 2
    told = command("render", tmp_path, "-o", tmp_path / "set", "--size", "huge")
    assert told.code == 2
    assert "'huge' is not a size" in told.err
    told = command("validate", "sphere", tmp_path, "--radius", 150, "-o", tmp_path / "r", "--viewpoint", "1,nan,3")
    assert told.code == 2
    assert "'1,nan,3' is not a position" in told.err


@pytest.mark.parametrize(("name", "goes_on"), [("reconstruct", True), ("demo", True), ("simulate", False)])
def test_who_stops_a_command_that_goes_on_is_told_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, goes_on: bool
) -> None:
    commands = typer.Typer(pretty_exceptions_enable=False)

    @commands.callback()
    def options() -> None: ...

    @commands.command(name)
    def stopped() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("app.cli.app", commands)
    monkeypatch.setattr(sys, "argv", ["reconstudy", name])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 130
    told = capsys.readouterr().err
    assert "reconstudy: interrupted" in told
    assert ("started again, it goes on" in told) == goes_on


@pytest.mark.parametrize("name", ["demo", "study create", "token add"])
def test_a_flag_is_not_shown_as_if_a_value_followed(command: Command, name: str) -> None:
    told = command(*name.split(), "--help")
    assert "--json" in told.out
    assert "bool" not in told.out
    assert "<" in told.out or "NAME" in told.out  # other options have their type


@pytest.mark.parametrize("name", ["validate films", "analyse", "capture synth", "study attach"])
def test_helps_name_no_types_of_python(command: Command, name: str) -> None:
    shown = command(*name.split(), "--help").out
    assert "<path>" in shown
    assert not re.search(r"<(list|str|int|float|bool|Path)\b", shown)


def test_no_help_loses_words_in_brackets(command: Command) -> None:
    words = " ".join(command("study", "import", "--help").out.split())
    assert "or the zip file of a whole study. `study export` writes both" in words
