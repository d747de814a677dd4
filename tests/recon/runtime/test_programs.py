"""Programs of others: how their commands are filled in. How they fail is tested with matchers and fusions."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest

from recon.runtime.programs import Program, ProgramError


@dataclass(frozen=True)
class Joining(Program):
    PLACEHOLDERS: ClassVar[tuple[str, ...]] = ("out",)
    LISTS: ClassVar[tuple[str, ...]] = ("parts",)
    OUTPUTS: ClassVar[tuple[str, ...]] = ("txt",)


def test_a_list_becomes_several_arguments() -> None:
    program = Joining("join {parts} '-o {out}' {folder}/x", "txt", folder="/home")
    assert program.arguments({"parts": ["a b", "c"], "out": "d"}) == ["join", "a b", "c", "-o d", "/home/x"]


def test_a_list_within_an_argument_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\{parts\} must be an argument of its own"):
        Joining("join --parts={parts} {out}", "txt")


def test_a_file_beside_the_methods_file_may_be_named_alone(tmp_path: Path) -> None:
    (tmp_path / "match.py").touch()
    (tmp_path / "d").touch()
    program = Joining("python match.py other.py {out} --model=match.py", "txt", folder=str(tmp_path))
    arguments = program.arguments({"out": "d"})
    assert arguments == ["python", str(tmp_path / "match.py"), "other.py", "d", "--model=match.py"]


def test_the_files_that_a_command_names_are_found(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere/tool"
    for path in (tmp_path / "fuse me.py", tmp_path / "w.bin", tmp_path / "v.bin", elsewhere):
        path.parent.mkdir(exist_ok=True)
        path.touch()
    command = f"{elsewhere} 'fuse me.py' {{folder}}/w.bin --more={{folder}}/v.bin --none= elsewhere {{out}} 3"
    names = ["tool", "fuse me.py", "w.bin", "v.bin"]
    assert [path.name for path in Joining(command, "txt", folder=str(tmp_path)).files()] == names


def test_an_argument_longer_than_a_file_name_is_no_file() -> None:
    assert Joining(f"run {300 * 'x'}", "txt").arguments({}) == ["run", 300 * "x"]


def test_a_failure_says_the_last_that_the_program_printed(tmp_path: Path) -> None:
    noisy = (
        "print(9 * 10**6 * ' ' + 'loading'); print(chr(7) + 'no weights: ' + 999 * 'x' + chr(10)); raise SystemExit(3)"
    )
    command = shlex.join([sys.executable, "-c", noisy])
    with pytest.raises(ProgramError, match=r"exit status 3 and said: no weights: x+…$") as raised:
        Joining(command, "txt").run({}, tmp_path)
    assert len(str(raised.value)) < 300


def test_a_program_that_crashed_is_told_by_its_signal(tmp_path: Path) -> None:
    command = shlex.join([sys.executable, "-c", "import os; os.abort()"])
    with pytest.raises(ProgramError, match=r"^the program was ended by signal 6 \(Aborted\)$"):
        Joining(command, "txt").run({}, tmp_path)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_a_program_ends_with_the_process_that_runs_it_however_that_ends(tmp_path: Path, number: int) -> None:
    os.mkfifo(tmp_path / "told")  # which ends when the last process that writes to it does
    program = (
        "import time; told = open('told', 'w'); print('on', file=told, flush=True); time.sleep(20); print(file=told)"
    )
    runner = "from tests.recon.runtime.test_programs import Joining; from pathlib import Path; import signal, sys\n"
    runner += "signal.signal(signal.SIGHUP, signal.SIG_DFL)  # which nohup ignores\n"
    runner += "Joining(sys.argv[1], 'txt').run({}, Path(sys.argv[2]))"
    shell = shlex.join(["sh", "-c", f"{shlex.join([sys.executable, '-c', program])} & wait"])  # and what it started
    runs = subprocess.Popen([sys.executable, "-c", runner, shell, str(tmp_path)])
    with (tmp_path / "told").open(encoding="utf-8") as told:
        assert told.readline() == "on\n"
        runs.send_signal(number)
        assert runs.wait() == -number
        assert told.read() == ""


def test_a_program_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match=r"^the program joinn could not be started: no such file or directory$"):
        Joining("joinn 1", "txt").run({}, tmp_path)


def test_a_failure_without_a_word_says_no_more(tmp_path: Path) -> None:
    command = shlex.join([sys.executable, "-c", "import sys\nsys.exit(3)"])
    with pytest.raises(ProgramError, match=r"exit status 3$"):
        Joining(command, "txt").run({}, tmp_path)


def test_a_command_tells_which_names_it_uses() -> None:
    program = Joining("join {parts}", "txt")
    assert program.asks_for("parts")
    assert not program.asks_for("out")
