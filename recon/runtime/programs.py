"""Programs of others, which do a part of the work: files in, files out.

A program runs without a shell, in a folder of its own. What it prints goes to a log file there.
"""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from shutil import rmtree
from typing import ClassVar, TextIO

LOG = "log.txt"
LONGEST_QUOTE = 160  # letters of what a program printed that a sentence quotes

Value = str | int | float | list[str]  # what stands for a name in braces; a list becomes several arguments


class ProgramError(ValueError):
    """A program that could not be started, failed, took too long, or wrote nothing usable."""


@dataclass(frozen=True)
class Program:
    """How to call a program; the kinds of work derive from it, and say which names and formats there are.

    Parameters
    ----------
    command : split into arguments as a shell would; then the names in braces are filled in
    output : format of what it writes, one of `OUTPUTS`
    timeout_s : it is stopped after so many seconds
    folder : what {folder} stands for: that of the methods file

    Raises
    ------
    ValueError
        If the command or a value cannot be used.
    """

    PLACEHOLDERS: ClassVar[tuple[str, ...]] = ()  # names in braces, beside {folder}
    LISTS: ClassVar[tuple[str, ...]] = ()  # those that stand for several arguments
    OUTPUTS: ClassVar[tuple[str, ...]] = ()

    command: str
    output: str
    timeout_s: float = 600.0
    folder: str = "."

    def __post_init__(self) -> None:
        if self.output not in self.OUTPUTS:
            raise ValueError(f"output is {self.output!r}, expected one of {', '.join(self.OUTPUTS)}")
        if not (isfinite(self.timeout_s) and self.timeout_s > 0):
            raise ValueError(f"timeout_s is {self.timeout_s}, expected a positive number of seconds")
        if not self.arguments(dict.fromkeys(self.PLACEHOLDERS, 1) | {name: ["1"] for name in self.LISTS}):
            raise ValueError("command is empty, expected a program and its arguments")

    def arguments(self, values: Mapping[str, Value]) -> list[str]:
        """Return the program and its arguments with the names in braces filled in.

        A list, such as that of {clouds}, must be an argument of its own, and becomes as many as it has entries. A file
        beside the methods file may be named alone.
        """
        lists = {f"{{{name}}}": value for name, value in values.items() if isinstance(value, list)}
        single = {name: value for name, value in values.items() if not isinstance(value, list)}
        filled: list[str] = []
        try:
            for argument in shlex.split(self.command):
                if _is_file(beside := Path(self.folder) / argument):
                    filled.append(str(beside))
                else:
                    filled += lists.get(argument) or [argument.format_map({**single, "folder": self.folder})]
        except (ValueError, LookupError, AttributeError, TypeError) as error:
            names = ", ".join(f"{{{name}}}" for name in (*self.PLACEHOLDERS, *self.LISTS, "folder"))
            alone = "".join(f"; {{{name}}} must be an argument of its own" for name in self.LISTS)
            reason = f"{{{error.args[0]}}} is unknown" if isinstance(error, KeyError) else str(error)
            raise ValueError(
                f"command is {self.command!r}, which cannot be filled in: {reason}; "
                f"expected arguments with {names}{alone}"
            ) from error
        return filled

    def files(self) -> list[Path]:
        """Return the files that the command names, such as a script beside the methods file, or weights after a `=`."""
        named = [text.replace("{folder}", self.folder) for text in shlex.split(self.command)]
        paths = [Path(self.folder) / part for text in named for part in dict.fromkeys((text, text.partition("=")[2]))]
        return [path for path in paths if _is_file(path)]

    def asks_for(self, name: str) -> bool:
        """Return whether the command uses a name in braces."""
        return f"{{{name}}}" in self.command

    def run(self, values: Mapping[str, Value], folder: Path) -> str:
        """Run the program in a folder, and print to its log there; if it is stopped, so is all that it started.

        Returns the last line that it printed, as a clause for messages. A ProgramError says how it failed.
        """
        arguments = self.arguments(values)
        with (folder / LOG).open("w+", encoding="utf-8", errors="replace") as printed:
            print("$", shlex.join(arguments), file=printed, flush=True)
            start = printed.tell()
            try:
                process = subprocess.Popen(
                    arguments,
                    stdin=subprocess.DEVNULL,
                    stdout=printed,
                    stderr=subprocess.STDOUT,
                    cwd=folder,
                    start_new_session=True,
                )
            except (OSError, ValueError) as error:
                reason = getattr(error, "strerror", None) or str(error)
                raise ProgramError(f"the program {arguments[0]} could not be started: {reason.lower()}") from error
            with _killed_at_the_end(process):
                try:
                    ending = _ending(process.wait(self.timeout_s))
                except subprocess.TimeoutExpired:
                    ending = f"was stopped after {self.timeout_s:g} s (its timeout_s)"
            said = _last_words(printed, start)
        if ending:
            raise ProgramError(f"the program {ending}{said}")
        return said


@contextmanager
def workplace(folder: Path) -> Iterator[None]:
    """Empty a folder in which a program is then run and its result read; afterwards it keeps the program's log alone.

    A ValueError within becomes a ProgramError that names the log, and the folder is left as it is, to try by hand.
    """
    rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / LOG
    try:
        yield
    except ValueError as error:
        raise ProgramError(f"{error}; its log is {log}") from error
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            rmtree(path, ignore_errors=True)
        elif path != log:
            path.unlink()


@contextmanager
def _killed_at_the_end(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Kill a program that still runs, with all that it started, when the block or this process ends, even killed.

    The program has a session of its own, so that no signal to this process or its group reaches it. The shell beside it
    reads from a pipe that ends with this process.
    """
    watch = ["sh", "-c", f"read end; kill -KILL -{process.pid}"]
    try:
        with subprocess.Popen(watch, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True) as shell:
            try:
                yield
            finally:
                shell.kill()
    finally:
        if process.returncode is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def check_written(path: Path, said: str) -> None:
    """Raise a ProgramError if a program did not write its file, with the last that it said."""
    if not path.is_file():
        raise ProgramError(f"the program wrote no {path.name}{said}")


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # too long for a name
        return False


def _ending(returncode: int) -> str:
    """Say how a program ended, nothing if well; POSIX gives the number of a signal as a negative exit status."""
    if returncode == 0:
        return ""
    if returncode > 0:
        return f"ended with exit status {returncode}"
    advice = ", which the system sends where memory runs out" if returncode == -signal.SIGKILL else ""
    return f"was ended by signal {-returncode} ({signal.strsignal(-returncode)}){advice}"


def _last_words(log: TextIO, start: int) -> str:
    """Quote the last line of a log after its first `start` bytes, or nothing if there is none."""
    log.seek(start)
    last = "".join(filter(str.isprintable, "".join(deque(filter(str.strip, log), maxlen=1)))).strip()
    if not last:
        return ""
    return f" and said: {last if len(last) <= LONGEST_QUOTE else last[:LONGEST_QUOTE] + '…'}"
