"""Bring the tables of survey and experiment programs to one that is recognised like any other."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.cells import Table, column_of, is_numeric, number_or_nan, same, shown
from app.analysis.reading.files.addresses import without_keys
from app.analysis.reading.files.headers import (
    is_qualtrics,
    is_surveymonkey,
    restate_qualtrics,
    restate_surveymonkey,
    without_units,
)
from app.analysis.reading.files.nested import QUESTION
from app.analysis.reading.phrases import counted
from app.analysis.reading.votes_table import VotesError
from app.analysis.reading.words import NOT_THERE, TIGHT_VERSUS, VERSUS, ends_of, is_suspicious, means, pairs_in, plain


@dataclass(frozen=True)
class Program:
    """How a program's table is known, and brought to another.

    Parameters
    ----------
    is_it : is a table one of this program's?
    restate : return it as a plain table; where it asks, of the answers to this question
    says : what its file looks like, for the manual
    asks : may there be answers to several questions?
    """

    is_it: Callable[[Table], object]
    restate: Callable[..., Table]
    says: str
    asks: bool = False


def restated(table: Table, name: str = "", question: str = "") -> Table:
    """Return a table as it is recognised: that of a program, told or known by its columns, brought to a plain one.

    Parameters
    ----------
    table : as a file has it
    name : of a program or layout, as told; empty: recognised
    question : whose answers are taken, where there are several

    Raises
    ------
    VotesError
        If the name is not known, the table is not that program's, or it has answers to several questions.
    """
    if name and name not in KNOWN:
        raise VotesError(f"--format {name} is not known; known are {', '.join(KNOWN)}")
    table = without_keys(_without_missing(without_units(table)))
    if QUESTION in table.columns:
        table = _one_question(table, QUESTION, question)
    for known, program in PROGRAMS.items():
        if name == known and not program.is_it(table):
            raise VotesError(f"is no table of {name}: {program.says}; found {', '.join(table.names[:20])}")
        if name == known or (not name and program.is_it(table)):
            plain_table = program.restate(table, question) if program.asks else program.restate(table)
            return _with_pairs(replace(plain_table, notes=(*plain_table.notes, f"a table of {known}")))
    return _with_pairs(table)


def _without_missing(table: Table) -> Table:
    """Take NA and its like for empty cells in columns of numbers."""
    changed = {}
    for name, column in table.columns.items():
        cleared = column.mapped("" if word in NOT_THERE else word for word in column.words)
        if cleared.words != column.words and is_numeric(cleared):
            changed[name] = cleared
    if not changed:
        return table
    note = f"NA and the like are empty cells in {', '.join(map(shown, changed))}"
    return replace(table, columns={**table.columns, **changed}, notes=(*table.notes, note))


def _shorn(table: Table, is_kept: NDArray[np.bool_], which: str) -> Table:
    """Leave out rows, and note how many, if any."""
    if is_kept.all():
        return table
    kept = table.where(is_kept)
    return replace(kept, notes=(*kept.notes, f"{counted(int((~is_kept).sum()), 'row')} {which}"))


def _one_question(table: Table, column: str, question: str) -> Table:
    """Return the answers to one question, which are told where there are several; the column is left out."""
    asked = table.columns[column].filled
    if question and question not in asked:
        raise VotesError(f"has no answers to {shown(question)}; questions are {', '.join(map(shown, asked))}")
    if len(asked) > 1 and not question:
        raise VotesError(
            f"has answers to several questions ({', '.join(map(shown, asked[:6]))}), which are not the same thing: "
            f"--sheet {asked[0]} takes those to one"
        )
    kept = table.where(table.columns[column].meaning(lambda word: not question or word == question, bool))
    return replace(kept, columns={name: cells for name, cells in kept.columns.items() if name != column})


def _with_pairs(table: Table) -> Table:
    """Give a table whose rows name their pair in one cell, "x vs y", two columns of items."""
    if any(plain(name) in ("itema", "itemb", "winner", "condition", "rating") for name in table.names):
        return table
    if {0, 1} <= {end[2] for name in table.names if (end := ends_of(name))}:
        return table
    for name, column in table.columns.items():
        if column.filled and all(VERSUS.match(word) or TIGHT_VERSUS.match(word) for word in column.filled):
            pairs = pairs_in(column.words)
            a, b = (column.mapped(pairs[word][:2][side] if word else "" for word in column.words) for side in (0, 1))
            kept = {other: cells for other, cells in table.columns.items() if other != name}
            note = f"the column {name!r} names the pair of each row"
            return replace(table, columns={"item_a": a, "item_b": b, **kept}, notes=(*table.notes, note))
    return table


def _has(*names: str) -> Callable[[Table], bool]:
    return lambda table: set(names) <= {plain(name) for name in table.names}


def _renamed(table: Table, names: Mapping[str, str]) -> Table:
    """Rename columns, which `names` has as `plain` spells them -> new name."""
    columns = {names.get(plain(name), name): column for name, column in table.columns.items()}
    return replace(table, columns=columns)


def _psychopy(table: Table) -> Table:
    """Leave out rows of instructions, which show no item, and find the answer among the keys."""
    pairs = [name for name in table.names if (end := ends_of(name)) and end[0]] or [
        name for name in table.names if plain(name) in ("left", "right", "a", "b")
    ]
    shown_names = pairs or [name for name in table.names if means("condition", name)]
    if not shown_names:
        return table
    is_shown = np.logical_and.reduce([table.columns[name].meaning(bool, bool) for name in shown_names])
    kept = _shorn(table, is_shown, "that show no item are left out, as instructions")
    role, endings = ("choice", (".keys", ".clicked_name", ".response")) if pairs else (
        "rating", (".response", ".rating", ".keys"),
    )  # fmt: skip
    answers = [name for name in kept.names if name.lower().endswith(endings) and kept.columns[name].filled]
    if len(answers) != 1 or role in map(plain, kept.names):
        return kept
    columns = {role if name == answers[0] else name: column for name, column in kept.columns.items()}
    return replace(kept, columns=columns, notes=(*kept.notes, f"{role} is the column {answers[0]!r}"))


ANSWER = re.compile(r"^answer[._](q(?:uestion)?_?\d+)$", re.IGNORECASE)


def _crowd_columns(table: Table) -> dict[str, str]:
    """Return columns of answers -> columns of the films that these rate."""
    lower = {name.lower(): name for name in table.names}
    matched = {}
    for name in table.names:
        if match := ANSWER.match(name):
            question = match[1].lower()
            for film in (f"answer.{question}_url", f"input.{question}_url", f"input.{question}"):
                if film in lower:
                    matched[name] = lower[film]
                    break
    return matched


REFERENCE = "reference"  # as item_a of comparisons whose other film is named alone


def _crowd(table: Table) -> Table:
    """Take each answer of a row as a rating of the film that it names; films of traps and gold are left out.

    Where the order is recorded (CCR), an answer says how much better the second film is: `rp` shows the reference
    first, `pr` the film.
    """
    columns = _crowd_columns(table)
    traps = {
        word
        for name in table.names
        if is_suspicious(name.rpartition(".")[2])
        or re.search(r"[._](tp|gold|trap\w*)([._]|$|_url)", name, re.IGNORECASE)
        for word in table.columns[name].filled
        if "/" in word
    }
    who = next((name for name in table.names if plain(name) in ("workerid", "participantid", "prolificpid")), None)
    orders = {answer: name for answer in columns for name in table.names if name.lower() == f"{answer.lower()}_order"}
    rows: list[tuple[int, str, str, str, str]] = []
    n_traps = 0
    for row, (answer, film) in product(range(len(table)), columns.items()):
        url, rating = (table.columns[name].text(row) for name in (film, answer))
        if url in traps:
            n_traps += 1
        elif rating:
            name, order = url.rsplit("/", 1)[-1], table.columns[orders[answer]].text(row) if orders else "rp"
            if order not in ("rp", "pr"):
                raise VotesError(f"row {table.row(row)}: {orders[answer]} is {shown(order)}, expected rp or pr")
            if order == "pr":
                rating = f"{-number_or_nan(rating):g}"
            person = table.columns[who].text(row) if who else ""
            rows.append((row, person, name, rating, REFERENCE if order == "rp" else name))
    names = ("participant", "item_b", "rating", "first_shown") if orders else ("participant", "condition", "rating")
    cells = {name: column_of(row[at] for row in rows) for at, name in enumerate(names, start=1)}
    cells |= {"item_a": same(REFERENCE, len(rows))} if orders else {}
    used = {*columns, *columns.values(), *orders.values(), who, *names}
    place = np.array([row[0] for row in rows], np.intp)
    kept = {name: column.where(place) for name, column in table.columns.items() if name not in used}
    notes = (*table.notes, f"{len(columns)} answers in each row, each a rating of the film that it names")
    warnings = (f"left out: {counted(n_traps, 'answer')} on trapping or gold films",) if n_traps else ()
    return Table({**cells, **kept}, table.how, table.numbers[place], notes, warnings)


def _gorilla(table: Table) -> Table:
    """Leave out rows without a response: each thing on a screen has one."""
    renamed = _renamed(table, {"participantprivateid": "participant"})
    is_there = next(cells for name, cells in renamed.columns.items() if plain(name) == "response").meaning(bool, bool)
    return _shorn(renamed, is_there, "without a response are left out")


def _revisit(table: Table, question: str) -> Table:
    """Leave out rows without an answer, and those that show no item where others do; parameters lose that word."""
    names = {name: re.sub(r"^parameters?_", "", name) for name in table.names}
    columns = {
        (names[name] if names[name] not in table.columns else name): column.mapped(
            "" if word in ("undefined", "null", "[]") else word for word in column.words
        )
        for name, column in table.columns.items()
    }
    answer = next(name for name in columns if plain(name) == "answer")
    shown_names = [name for name in columns if (end := ends_of(name)) and end[0]]
    needed = [name for name in (answer, *shown_names) if columns[name].filled]
    is_there = np.logical_and.reduce([np.ones(len(table), bool), *(columns[n].meaning(bool, bool) for n in needed)])
    kept = _shorn(replace(table, columns=columns), is_there, "without an answer or an item are left out")
    return _rated_trials(_one_question(kept, next(name for name in columns if plain(name) == "responseid"), question))


def _rated_trials(table: Table) -> Table:
    """Take a trial for a condition where the answers of reVISit are numbers and no pair is shown."""
    cells = {plain(name): column for name, column in table.columns.items()}
    names_pairs = any(TIGHT_VERSUS.match(word) or VERSUS.match(word) for word in cells["trialid"].filled)
    if names_pairs or any(ends_of(name) for name in table.names) or not is_numeric(cells["answer"]):
        return table
    return _renamed(table, {"answer": "rating", "trialid": "condition"})


def _avrateng(table: Table, question: str) -> Table:
    """Take the film out of the list of films that names it."""
    if types := [name for name in table.names if plain(name) == "ratingtype"]:
        table = _one_question(table, types[0], question)
    (name,) = [name for name in table.names if plain(name) == "videoname"]
    films = {
        word: re.findall(r"'([^']*)'|\"([^\"]*)\"", word) if word[:1] == "[" else [word]
        for word in table.columns[name].words
    }
    for row, word in enumerate(table.columns[name].texts):
        if len(films[word]) != 1:
            raise VotesError(
                f"row {table.row(row)}: {shown(word)} shows {len(films[word])} films, and nothing says what was rated; "
                "name the films of a comparison in columns item_a and item_b, or one film in each row"
            )
    cells = table.columns[name].compact
    named = {**table.columns, name: cells.mapped("".join(films[word][0]) for word in cells.words)}
    return _renamed(replace(table, columns=named), {"userid": "participant", "videoname": "condition"})


def _webmushra(table: Table, names: Mapping[str, str]) -> Table:
    """Name the columns of webMUSHRA; a person is the session, or what the first page asked for: a mail or a name."""
    plains = {plain(name) for name in table.names}
    person = next((name for name in MUSHRA_PEOPLE if name in plains), "")
    return _renamed(table, {person: "participant", "trialid": "dataset", **names})


OTREE = re.compile(r"^(?:player|group|subsession)\.")
MTURK = re.compile(r"^(?:Input|Answer)\.")


def _without_prefixes(table: Table, prefixes: re.Pattern[str]) -> Table:
    """Cut what a program writes before a column's name, where the rest is no other column's."""
    cut = {name: prefixes.sub("", name) for name in table.names}
    alone = {name for name in cut if [*cut.values()].count(cut[name]) == 1}
    return _renamed(
        replace(table, columns={cut[name] if name in alone else name: table.columns[name] for name in cut}),
        {"participantcode": "participant"},
    )


MUSHRA_PEOPLE = ("sessionuuid", "participantid", "listenerid", "email", "participantemail", "name", "participantname")
# What a paired comparison of webMUSHRA says of the answer: was the reference found?
MUSHRA_WORDS = {"correct": "a", "incorrect": "b", "undecided": "none"}


def _webmushra_pairs(table: Table) -> Table:
    """Say which of the two the answer of a webMUSHRA paired comparison is."""
    answer = next(name for name in table.names if plain(name) == "choiceanswer")
    is_known = table.columns[answer].meaning(lambda word: word.lower() != "unknown", bool)
    noted = replace(table, notes=(*table.notes, "correct is the reference"))
    kept = _shorn(noted, is_known, "without an answer are left out")
    cells = kept.columns[answer].mapped(MUSHRA_WORDS.get(word.lower(), word) for word in kept.columns[answer].words)
    names = {"choicereference": "item_a", "choicenonreference": "item_b", "choiceanswer": "choice"}
    return _webmushra(replace(kept, columns={**kept.columns, answer: cells}), names)


PROGRAMS: dict[str, Program] = {
    "qualtrics": Program(is_qualtrics, restate_qualtrics, "three rows of headers; the third holds ImportId"),
    "surveymonkey": Program(is_surveymonkey, restate_surveymonkey, "Respondent ID, Collector ID; options in row 1"),
    "p910-crowd": Program(
        _crowd_columns,
        _crowd,
        "a row for each worker: answer.q1, answer.q1_url (or input.q1), answer.q2, …; answer.q1_order in CCR",
    ),
    "otree": Program(
        _has("participantcode", "sessioncode"),
        partial(_without_prefixes, prefixes=OTREE),
        "participant.code, session.code, player.…, subsession.round_number",
    ),
    "mturk": Program(
        _has("hitid", "workerid", "assignmentstatus"),
        partial(_without_prefixes, prefixes=MTURK),
        "HITId, WorkerId, AssignmentStatus, Input.…, Answer.…",
    ),
    "webmushra": Program(
        _has("trialid", "ratingstimulus", "ratingscore"),
        partial(_webmushra, names={"ratingstimulus": "condition", "ratingscore": "rating"}),
        "session_uuid (or email, name), trial_id, rating_stimulus, rating_score; the scale is --scale 0:100",
    ),
    "webmushra-pairs": Program(
        _has("trialid", "choicereference", "choicenonreference", "choiceanswer"),
        _webmushra_pairs,
        "email or name, trial_id, choice_reference, choice_non_reference, choice_answer (correct: the reference)",
    ),
    "webmushra-likert": Program(
        _has("trialid", "stimuli", "stimulirating"),
        partial(_webmushra, names={"stimuli": "condition", "stimulirating": "rating"}),
        "email or name, trial_id, stimuli_rating, stimuli",
    ),
    "avrateng": Program(
        _has("userid", "videoname", "rating"),
        _avrateng,
        "rating, rating_type, timestamp, user_ID, video_ID, video_name, semicolons between",
        asks=True,
    ),
    "revisit": Program(
        _has("participantid", "trialid", "responseid", "answer"),
        _revisit,
        "participantId, trialId, responseId, answer, parameters_…",
        asks=True,
    ),
    "psychopy": Program(
        lambda table: any(plain(name) in ("psychopyversion", "expname") for name in table.names),
        _psychopy,
        "expName, psychopyVersion, key_resp.keys, and the columns of the conditions file",
    ),
    "jspsych": Program(
        _has("trialtype", "trialindex", "response"),
        _psychopy,
        "trial_type, trial_index, response, and the columns that the trials' data name",
    ),
    "gorilla": Program(
        _has("participantprivateid", "trialnumber", "response"),
        _gorilla,
        "Participant Private ID, Trial Number, Response, and the columns of the spreadsheet",
    ),
}

# Layouts that a name may ask for, and what they look like; programs come after them.
SHAPES = {
    "votes": "item_a, item_b and a choice in each row; a column for each pair `x vs y`; or winner and loser",
    "ratings": "participant, condition, rating in each row; or a column for each condition, or for each participant",
    "ccr": "item_a, item_b and a grade from -3 to 3 (or much better, …) in each row; or a column for each pair",
    "winner-loser": "winner and loser in each row",
    "wins": "two items and their counts in each row: wins_a, wins_b, ties",
    "matrix": "the same names in the first column and the header; wins of the row over the column",
    "ranking": "participant, item, rank in each row; or rank_1, rank_2, rank_3 naming items; or a column for each item",
    "best-worst": "best, worst, and the items of the set: option1, option2, …",
}
NESTED = {
    "sureal": "JSON or Python (never run) with dis_videos: content_id, asset_id, os (a list, or people -> ratings)",
    "choix": "JSON lists: [winner, loser] or [best, …, worst]; or CSV without a header, when told",
    "label-studio": "JSON: data (model_a, model_b, …) and annotations whose result has `selected`",
    "argilla": "JSON of records: metadata (model_a, model_b, …) and responses with user_id, status and value",
}
KNOWN = {**SHAPES, **{name: program.says for name, program in PROGRAMS.items()}, **NESTED}
