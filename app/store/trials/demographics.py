"""Sum up who took part in a study, from the questionnaire."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, get_args

from sqlalchemy import Connection, select

from app.store.database.tables import study
from app.store.participants.interviews import questionnaire_records
from app.store.trials.counted_votes import judges_of
from app.study.options.options import parse_options
from app.study.options.wording import asked_questions
from app.study.questions.demographics import demographics

Among = Literal["counted", "everybody"]
AMONG: tuple[Among, ...] = get_args(Among)


def demographic_records(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return the rows of `demographics` among those whose votes count, and among everybody who has not withdrawn."""
    return [row for among in AMONG for row in demographics_among(connection, study_id, among)[1]]


def demographics_among(connection: Connection, study_id: int, among: Among) -> tuple[int, list[dict[str, Any]]]:
    """Sum up the questionnaires of a group of participants.

    Parameters
    ----------
    among : counted: neither excluded nor withdrawn; everybody: the excluded, too

    Returns
    -------
    How many have answered the questionnaire, and the rows of `demographics` with `among`.
    """
    people = {
        judge.label
        for judge in judges_of(connection, study_id).values()
        if not judge.has_withdrawn and (among == "everybody" or judge.reason is None)
    }
    answers = _written_by(connection, study_id, people)
    options = connection.execute(select(study.c.options).where(study.c.id == study_id)).scalar_one()
    rows = demographics(asked_questions(parse_options(options)), answers)
    return len({row["participant"] for row in answers}), [{"among": among, **row} for row in rows]


def _written_by(connection: Connection, study_id: int, people: set[str]) -> Sequence[dict[str, Any]]:
    rows = questionnaire_records(connection, study_id)
    return [row for row in rows if row["source"] == "written" and row["participant"] in people]
