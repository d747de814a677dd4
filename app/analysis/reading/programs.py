"""Bring the tables of survey and experiment programs to one that is recognised like any other."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from app.analysis.reading.cells import Column, Table, column_of, is_numeric, shown
from app.analysis.reading.votes_table import VotesError
from app.analysis.reading.words import TIGHT_VERSUS, VERSUS, ends_of, is_suspicious, pair_in, plain


@dataclass(frozen=True)
class Program:
    """How a program's table is known, and brought to another.

    Parameters
    ----------
    is_it : is a table one of this program's?
    restate : return it as a plain table
    says : what its file looks like, for the manual
    """

    is_it: Callable[[Table], bool]
    restate: Callable[[Table], Table]
    says: str


def restated(table: Table, name: str = "") -> Table:
    """Return a table as it is recognised: that of a program, told or known by its columns, brought to a plain one.

    Raises
    ------
    VotesError
        If the name is not known, or the table is not that program's.
    """
    if name in PROGRAMS:
        if not PROGRAMS[name].is_it(table):
            raise VotesError(f"is no table of {name}: {PROGRAMS[name].says}; found {', '.join(table.names[:20])}")
        return _with_pairs(PROGRAMS[name].restate(table))
    if name and name not in KNOWN:
        raise VotesError(f"--format {name} is not known; known are {', '.join(KNOWN)}")
    for known, program in PROGRAMS.items():
        if not name and program.is_it(table):
            matched = program.restate(table)
            return _with_pairs(replace(matched, notes=(*matched.notes, f"a table of {known}")))
    return _with_pairs(table)


def _with_pairs(table: Table) -> Table:
    """Give a table whose rows name their pair in one cell, "x vs y", two columns of items."""
    if any(plain(name) in ("itema", "itemb", "winner", "condition", "rating") for name in table.names):
        return table
    if {0, 1} <= {end[2] for name in table.names if (end := ends_of(name))}:
        return table
    for name, column in table.columns.items():
        if column.filled and all(VERSUS.match(word) or TIGHT_VERSUS.match(word) for word in column.filled):
            pairs = {word: pair_in(word) or ("", "") for word in column.words}
            items = [column_of(pairs[word][side] for word in column.texts) for side in (0, 1)]
            kept = {other: cells for other, cells in table.columns.items() if other != name}
            note = f"the column {name!r} names the pair of each row"
            return table.with_columns({"item_a": items[0], "item_b": items[1], **kept}, notes=(*table.notes, note))
    return table


def _has(*names: str) -> Callable[[Table], bool]:
    return lambda table: set(names) <= {plain(name) for name in table.names}


def _renamed(table: Table, names: Mapping[str, str], note: str = "") -> Table:
    """Rename columns, which `names` has as `plain` spells them -> new name."""
    columns = {names.get(plain(name), name): column for name, column in table.columns.items()}
    return table.with_columns(columns, notes=(*table.notes, *([note] if note else [])))


def _is_qualtrics(table: Table) -> bool:
    return len(table) > 1 and any("ImportId" in column.text(1) for column in table.columns.values())


def _qualtrics(table: Table) -> Table:
    """Leave out the rows of questions and of import ids; a question that names a pair names its column."""
    columns, notes = {}, ["the rows of questions and of import ids are left out"]
    for name, column in table.columns.items():
        question = column.text(0)
        better = question if pair_in(name) is None and (VERSUS.search(question) and pair_in(question)) else name
        columns[better if better not in columns else name] = column
    kept = table.with_columns(columns).where(np.arange(len(table)) >= 2)  # two rows of three headers
    warnings = []
    for name, words in (("Status", ("survey preview", "spam", "1")), ("Finished", ("false", "0"))):
        if name in columns:
            odd = kept.columns[name].meaning(lambda word, bad=words: word.lower() in bad, bool)  # type: ignore[misc]
            if odd.any():
                warnings.append(
                    f"{name} says of {int(odd.sum())} rows that they are previews or unfinished; they count"
                )
    return replace(kept, notes=(*table.notes, *notes), warnings=tuple(warnings))


def _psychopy(table: Table) -> Table:
    """Leave out rows of instructions, which show no item, and find the answer among the keys."""
    pairs = [name for name in table.names if (end := ends_of(name)) and end[0]] or [
        name for name in table.names if plain(name) in ("left", "right", "a", "b")
    ]
    shown_names = pairs or [
        name for name in table.names if plain(name) in ("condition", "stimulus", "stim", "image", "video", "item")
    ]
    if not shown_names:
        return table
    is_shown = np.logical_and.reduce([table.columns[name].meaning(bool, bool) for name in shown_names])
    kept, notes = table.where(is_shown), list(table.notes)
    if not is_shown.all():
        notes.append(f"{int((~is_shown).sum())} rows that show no item are left out, as instructions")
    columns = dict(kept.columns)
    for ending, role in (
        ((".keys", ".clicked_name", ".response"), "choice") if pairs else ((".response", ".rating", ".keys"), "rating"),
    ):
        answers = [name for name in columns if name.lower().endswith(ending) and columns[name].filled]
        if len(answers) == 1 and role not in {plain(name) for name in columns}:
            columns = {role if name == answers[0] else name: column for name, column in columns.items()}
            notes.append(f"{role} is the column {answers[0]!r}")
    return kept.with_columns(columns, notes=tuple(notes))


ANSWER = re.compile(r"^answer[._](q(?:uestion)?_?\d+)$", re.IGNORECASE)


def _is_crowd(table: Table) -> bool:
    return bool(_crowd_columns(table))


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


def _crowd(table: Table) -> Table:
    """Take each answer of a row as a rating of the film that it names; films of traps and gold are left out."""
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
    rows: list[tuple[int, str, str, str]] = []
    n_traps = 0
    for row in range(len(table)):
        for answer, film in columns.items():
            url, rating = table.columns[film].texts[row], table.columns[answer].texts[row]
            if url in traps:
                n_traps += 1
            elif rating:
                rows.append((row, (who and table.columns[who].texts[row]) or "", url.rsplit("/", 1)[-1], rating))
    place = np.array([row[0] for row in rows], np.intp)
    names = ("participant", "condition", "rating")
    cells = {name: column_of(row[at] for row in rows) for at, name in enumerate(names, start=1)}
    used = {*columns, *columns.values(), who}
    kept = {
        name: column.where(place) for name, column in table.columns.items() if name not in used and name not in names
    }
    notes = (*table.notes, f"{len(columns)} answers in each row, each a rating of the film that it names")
    warnings = (f"{n_traps} answers on trapping or gold films are left out",) if n_traps else ()
    return Table({**cells, **kept}, table.how, table.numbers[place], notes, warnings)


def _revisit(table: Table) -> Table:
    """Leave out rows without an answer; columns of parameters lose that word."""
    names = {name: re.sub(r"^parameters?_", "", name) for name in table.names}
    columns = {
        names[name] if names[name] not in table.columns else name: column for name, column in table.columns.items()
    }
    answer = table.columns[next(name for name in table.names if plain(name) == "answer")]
    is_answered = answer.meaning(bool, bool)
    kept = table.with_columns(columns).where(is_answered)
    notes = [f"{int((~is_answered).sum())} rows without an answer are left out"] if not is_answered.all() else []
    response = next(
        (column for name, column in kept.columns.items() if plain(name) == "responseid"),
        Column(np.array([], np.int32), ()),
    )
    if len(response.filled) > 1:
        raise VotesError(
            f"has answers to several questions (responseId {', '.join(map(shown, response.filled[:4]))}), which are "
            "not the same thing; leave the rows of one"
        )
    return replace(_rated_trials(kept), notes=(*table.notes, *notes))


def _rated_trials(table: Table) -> Table:
    """Take a trial for a condition where the answers of reVISit are numbers and no pair is shown."""
    cells = {plain(name): column for name, column in table.columns.items()}
    names_pairs = any(TIGHT_VERSUS.match(word) or VERSUS.match(word) for word in cells["trialid"].filled)
    if names_pairs or any(ends_of(name) for name in table.names) or not is_numeric(cells["answer"]):
        return table
    return _renamed(table, {"answer": "rating", "trialid": "condition"})


MUSHRA = {"sessionuuid": "participant", "trialid": "dataset"}  # of webMUSHRA


def _webmushra_pairs(table: Table) -> Table:
    """Say which of the two the answer of a webMUSHRA paired comparison is."""
    words = {"reference": "a", "non_reference": "b", "nonreference": "b", "non-reference": "b"}
    answer = next(name for name in table.names if plain(name) == "choiceanswer")
    cells = column_of(words.get(word.lower(), word) for word in table.columns[answer].texts)
    names = {"choicereference": "item_a", "choicenonreference": "item_b", "choiceanswer": "choice"}
    return _renamed(table.with_columns({**table.columns, answer: cells}), MUSHRA | names)


PROGRAMS: dict[str, Program] = {
    "qualtrics": Program(_is_qualtrics, _qualtrics, "three rows of headers; the third holds ImportId"),
    "p910-crowd": Program(
        _is_crowd, _crowd, "a row for each worker: answer.q1, answer.q1_url (or input.q1), answer.q2, …"
    ),
    "webmushra": Program(
        _has("sessionuuid", "trialid", "ratingstimulus", "ratingscore"),
        partial(_renamed, names=MUSHRA | {"ratingstimulus": "condition", "ratingscore": "rating"}),
        "session_uuid, trial_id, rating_stimulus, rating_score; the scale is --scale 0:100",
    ),
    "webmushra-pairs": Program(
        _has("sessionuuid", "trialid", "choicereference", "choicenonreference", "choiceanswer"),
        _webmushra_pairs,
        "session_uuid, trial_id, choice_reference, choice_non_reference, choice_answer",
    ),
    "webmushra-likert": Program(
        _has("sessionuuid", "trialid", "stimuli", "stimulirating"),
        partial(_renamed, names=MUSHRA | {"stimuli": "condition", "stimulirating": "rating"}),
        "session_uuid, trial_id, stimuli, stimuli_rating",
    ),
    "avrateng": Program(
        _has("userid", "videoname", "rating"),
        partial(_renamed, names={"userid": "participant", "videoname": "condition"}),
        "user_ID, video_ID, video_name, rating_type, rating",
    ),
    "revisit": Program(
        _has("participantid", "trialid", "responseid", "answer"),
        _revisit,
        "participantId, trialId, responseId, answer, parameters_…",
    ),
    "psychopy": Program(
        lambda table: any(plain(name) in ("psychopyversion", "expname") for name in table.names),
        _psychopy,
        "expName, psychopyVersion, key_resp.keys, and the columns of the conditions file",
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
