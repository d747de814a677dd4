"""Format names, numbers and p-values for sentences."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

MOST_NAMED = 5  # names in a sentence
LOWEST_P = 0.001  # below, the exact value depends on tails that nobody has checked
TIES = {
    "davidson": "by Davidson (1970)",
    "rao-kupper": "by Rao and Kupper (1967)",
    "half": "as half a win for each condition",
    "drop": "left out",
}


def finding(about: str, text: str) -> dict[str, str]:
    """Return a sentence with the word for what it is about."""
    return {"about": about, "text": text}


def listed(names: Sequence[str], most: int = MOST_NAMED) -> str:
    """Return names as in a sentence: "a, b and c"; of many, the first and the number of others."""
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def counted(n: int, noun: str) -> str:
    """Return a number with its noun: "1 vote", "2 votes"."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def p_phrase(p: float) -> str:
    """Return "p = 0.012", or "p < 0.001"."""
    return f"p < {LOWEST_P}" if p < LOWEST_P else f"p = {p:.3f}" if p < 0.1 else f"p = {p:.2f}"


def signed(value: float) -> str:
    """Return a number with sign and two decimals; zero has a plus."""
    return f"{round(value, 2) + 0.0:+.2f}".replace("-", "−")


def unsigned(value: float) -> str:
    """Return a number with two decimals, of which only a negative one has a sign."""
    return f"{round(value, 2) + 0.0:.2f}".replace("-", "−")


def interval(low: str, high: str) -> str:
    """Return "95 % interval 0.20 to 0.80" of its rounded ends."""
    return f"95 % interval {span(low, high)}"


def span(low: str, high: str) -> str:
    """Return "0.20 to 0.80" of rounded ends."""
    return f"{low} to {high}" if low != high else f"{low} at both ends"


def part(n: int, total: int, noun: str) -> str:
    """Return "2 of 5 participants"; of a single one in words.

    Parameters
    ----------
    n, total : how many of how many
    noun : what each of them is
    """
    return f"{n} of {total} {noun}s" if total != 1 else f"the only {noun}" if n else f"none, as there is one {noun}"


def number_with_interval(
    row: Mapping[str, Any], value: str, ends: str = "ci", *, show: Callable[[float], str] = unsigned
) -> str:
    """Return "0.50 (95 % interval 0.20 to 0.80)" of a row; it says so where there is no interval.

    Parameters
    ----------
    row : with the value, and its limits under `ends` + `_low`, `_high`
    value : name of the value
    ends : beginning of the limits' names
    show : how to format a number
    """
    low, high = row.get(f"{ends}_low"), row.get(f"{ends}_high")
    if low is None or high is None:
        return f"{show(row[value])} (no interval)"
    return f"{show(row[value])} ({interval(show(low), show(high))})"


def with_interval(row: Mapping[str, Any], value: str, ends: str) -> str | None:
    """Return "0.50 [0.20, 0.80]" of a row, for a table; None where there is no value.

    Parameters
    ----------
    row : with the value, and its limits under `ends` + `_low`, `_high`
    value : name of the value
    ends : beginning of the limits' names
    """
    low, high = row.get(f"{ends}_low"), row.get(f"{ends}_high")
    if row[value] is None:
        return None
    return unsigned(row[value]) + ("" if low is None or high is None else f" [{unsigned(low)}, {unsigned(high)}]")


def percent(share: float) -> str:
    """Return a share as a percentage; one that is not certain never as 0 or 100 %."""
    if 0 < share <= 0.005:
        return "less than 1 %"
    if 0.995 <= share < 1:
        return "more than 99 %"
    return f"{100 * share:.0f} %"


def outstanding(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the sentence on who stands out, of rows with `participant` and `flags`."""
    flagged = [f"{row['participant']} ({', '.join(row['flags'])})" for row in rows if row["flags"]]
    if not flagged:
        return f"Nobody of {len(rows)} stands out." if len(rows) != 1 else "With one participant, nobody can stand out."
    who, stands = ("Participant", "stands") if len(flagged) == 1 else ("Participants", "stand")
    return f"{who} {listed(flagged)} {stands} out; a reason to look, and nobody was left out for it."
