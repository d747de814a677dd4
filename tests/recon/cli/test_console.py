"""The progress that commands print."""

from __future__ import annotations

import pytest

from recon.cli.console import ProgressLine


class Clock:
    """A clock that the test moves on."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def lines(capsys: pytest.CaptureFixture[str], steps: list[tuple[float, str, int, int]]) -> list[str]:
    """What is printed where standard error is no terminal; each step comes so many seconds after the one before."""
    clock = Clock()
    progress = ProgressLine(clock)
    for seconds, *told in steps:
        clock.now += seconds
        progress(*told)
    return capsys.readouterr().err.splitlines()


def test_a_line_says_how_much_is_done_and_about_how_long_the_rest_takes(capsys: pytest.CaptureFixture[str]) -> None:
    told = lines(capsys, [(0, "clouds", 0, 8), (6, "clouds", 2, 8), (6, "clouds", 4, 8), (12, "clouds", 8, 8)])
    assert told == [
        *("clouds: 0/8 (0 s)", "clouds: 2/8 (6 s)"),
        *("clouds: 4/8 (12 s, about 12 s left)", "clouds: 8/8 (24 s)"),
    ]


@pytest.mark.parametrize(
    ("seconds", "told"),
    [(30, "60 s, about 30 s left"), (200, "7 min, about 3 min left"), (7200, "4.0 h, about 2.0 h left")],
)
def test_durations_are_told_as_people_say_them(seconds: float, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    steps = [(0, "clouds", 0, 3), (seconds, "clouds", 1, 3), (seconds, "clouds", 2, 3)]
    assert lines(capsys, steps)[-1] == f"clouds: 2/3 ({told})"


def test_what_was_done_before_the_first_line_does_not_make_the_estimate_short(
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = lines(capsys, [(0, "models", 10, 15), (10, "models", 11, 15), (10, "models", 12, 15)])
    assert told[1:] == ["models: 11/15 (10 s)", "models: 12/15 (20 s, about 30 s left)"]
    assert lines(capsys, [(0, "models", 0, 2), (9, "films", 1, 2), (8, "films", 2, 2)])[1] == "films: 1/2 (0 s)"


def test_a_line_that_is_being_rewritten_ends_before_an_error_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(progress: ProgressLine) -> None:
        with progress:
            progress("clouds", 1, 8)
            raise ValueError("no points")

    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with pytest.raises(ValueError, match="no points"):
        fail(ProgressLine())
    assert capsys.readouterr().err.endswith("\n")


def test_a_terminal_is_told_the_time_while_nothing_moves(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def wait_for(sentence: str) -> str:
        told = ""
        for _ in range(100_000):
            told += capsys.readouterr().err
            if sentence in told:
                return told
        pytest.fail(f"{sentence!r} is not in {told!r}")

    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setattr("recon.cli.console.BEAT_S", 0.001)
    clock = Clock()
    with ProgressLine(clock) as progress:
        clock.now += 3
        wait_for("\r\x1b[Kworking: 3 s")
        for done in (0, 1, 2):
            progress("clouds", done, 4)
            clock.now += 10
        wait_for("30 s, about 10 s left")
        clock.now += 6
        wait_for("36 s, about 4 s left")
        clock.now += 8
        assert "\n" not in wait_for(" 44 s\r")
        progress("clouds", 4, 4)
        assert "44 s\n" in wait_for("working: 0 s")
        progress.say("Done.")
        wait_for("\r\x1b[KDone.\n")
