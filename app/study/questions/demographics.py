"""Sum up who took part, as the table of participants in a paper does: counts of answers, mean and range of numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean, stdev
from typing import Any

from app.study.questions.answers import LEFT_OUT, AskedQuestion

# Questions that the presets ask, in the order in which papers report them; others follow in the study's own order.
WELL_KNOWN = ("age", "sex", "gender", "glasses", "trained", "experience")
CLOSED = ("choice", "scale", "number")

Row = dict[str, Any]


def demographics(asked: Mapping[str, AskedQuestion], answers: Iterable[Mapping[str, Any]]) -> list[Row]:
    """Sum up the answers to every closed question.

    Parameters
    ----------
    asked : the study's questions, by name
    answers : rows with `participant`, `question` and `answer`, which is None where left out

    Returns
    -------
    Rows of question (its name), text, answer, n, share, mean, sd, minimum, maximum: one for each option or step, with n
    and share; one without an answer for a number or scale, with the others. `sd` is of the sample, None for one answer.
    """
    given: dict[str, list[Any]] = {name: [] for name, each in asked.items() if each.question.kind in CLOSED}
    for row in answers:
        if row["question"] in given:
            given[row["question"]].append(row["answer"])
    known = [name for name in WELL_KNOWN if name in given]
    order = [*known, *(name for name in given if name not in known)]
    return [row for name in order if given[name] for row in _summed_up(asked[name], given[name])]


def demographic_sentence(n_people: int, rows: Sequence[Row]) -> str:
    """Say who took part in one sentence, for a paper's text.

    Parameters
    ----------
    n_people : participants
    rows : of `demographics`
    """
    people = f"{n_people} {'participant' if n_people == 1 else 'participants'} took part"
    parts = [_counted(name, rows) for name in ("sex", "gender")]
    parts += [f"aged {_range(row)}" for row in rows if row["question"] == "age" and row["mean"] is not None]
    parts += [_counted(name, rows, before) for name, before in (("glasses", "vision aid: "), ("trained", "trained: "))]
    parts += [
        f"experience {_range(row)}" for row in rows if row["question"] == "experience" and row["mean"] is not None
    ]
    said = [part for part in parts if part]
    return f"{people}: {'; '.join(said)}." if said else f"{people}."


def _summed_up(asked: AskedQuestion, answers: Sequence[Any]) -> list[Row]:
    given = [answer for answer in answers if answer is not None]
    rows = []
    if asked.question.kind in ("number", "scale") and given:
        values = [float(answer) for answer in given]
        spread = {"mean": fmean(values), "sd": stdev(values) if len(values) > 1 else None}
        rows.append(_row(asked, None, len(values)) | spread | {"minimum": min(values), "maximum": max(values)})
    counts = Counter(given)
    rows += [
        _row(asked, asked.label(answer), counts[answer]) | {"share": counts[answer] / len(answers)}
        for answer in _steps(asked)
    ]
    if n_left_out := len(answers) - len(given):
        rows.append(_row(asked, LEFT_OUT, n_left_out) | {"share": n_left_out / len(answers)})
    return rows


def _row(asked: AskedQuestion, answer: str | None, n: int) -> Row:
    nothing = dict.fromkeys(("share", "mean", "sd", "minimum", "maximum"))
    return {"question": asked.question.name, "text": asked.text, "answer": answer, "n": n, **nothing}


def _steps(asked: AskedQuestion) -> Sequence[Any]:
    """Return all answers that a question allows; none of a number, which has too many."""
    if asked.question.kind == "scale":
        return range(1, int(asked.question.maximum or 0) + 1)
    return asked.question.options


def _counted(name: str, rows: Sequence[Row], before: str = "") -> str:
    counts = [f"{row['n']} {row['answer']}" for row in rows if row["question"] == name and row["n"]]
    return before + ", ".join(counts) if counts else ""


def _range(row: Row) -> str:
    if row["minimum"] == row["maximum"]:
        return f"{row['minimum']:g}"
    sd = f", SD {row['sd']:.1f}" if row["sd"] is not None else ""
    return f"{row['minimum']:g} to {row['maximum']:g} (mean {row['mean']:.1f}{sd})"
