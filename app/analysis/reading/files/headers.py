"""Leave out the rows under a header that are no data: questions, options, import ids and units."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from app.analysis.reading.cells import Column, Table, named, number_or_nan
from app.analysis.reading.phrases import counted
from app.analysis.reading.words import NOT_THERE, VERSUS, pair_in, plain

ANSWERS = ("", "response", "open-ended response")  # under a question of SurveyMonkey's that has no options


def without_units(table: Table) -> Table:
    """Leave out the first row where it has words and its columns numbers: units, or names of columns that lack one."""
    if len(table) < 2 or is_surveymonkey(table):
        return table
    cells = {name: column.text(0) for name, column in table.columns.items()}
    units = {name: word for name, word in cells.items() if word and word not in NOT_THERE}
    if not 0 < len(units) < len(cells):
        return table
    if not all(_is_unit(word, table.columns[name]) for name, word in units.items()):
        return table
    if any(map(_is_unnamed, units)):
        return restate_surveymonkey(table)
    note = f"row {table.row(0)} is left out, as it names units ({named(list(dict.fromkeys(units.values())))})"
    return replace(table.where(np.arange(len(table)) > 0), notes=(*table.notes, note))


def _is_unit(word: str, column: Column) -> bool:
    """Is a text the only one of its column that is no number?"""
    others = [other for other in column.filled if other != word and other not in NOT_THERE]
    return bool(others) and math.isnan(number_or_nan(word)) and not any(map(math.isnan, map(number_or_nan, others)))


def _is_unnamed(name: str) -> bool:
    return not name or name.startswith("Unnamed: ")


def is_qualtrics(table: Table) -> bool:
    """Has a table three rows of headers, of which the third holds import ids?"""
    return len(table) > 1 and any("ImportId" in column.text(1) for column in table.columns.values())


def restate_qualtrics(table: Table) -> Table:
    """Leave out the rows of questions and of import ids; a question that names a pair names its column."""
    columns: dict[str, Column] = {}
    for name, column in table.columns.items():
        question = column.text(0)
        better = question if pair_in(name) is None and (VERSUS.search(question) and pair_in(question)) else name
        columns[better if better not in columns else name] = column
    kept = replace(table, columns=columns).where(np.arange(len(table)) >= 2)  # two rows of three headers
    warnings = []
    for name, words in (("Status", ("survey preview", "spam", "1")), ("Finished", ("false", "0"))):
        if name in columns:
            odd = kept.columns[name].meaning(lambda word, bad=words: word.lower() in bad, bool)  # type: ignore[misc]
            if odd.any():
                warnings.append(f"{name} calls {counted(int(odd.sum()), 'row')} a preview or unfinished; all count")
    note = "the rows of questions and of import ids are left out"
    return replace(kept, notes=(*table.notes, note), warnings=tuple(warnings))


def is_surveymonkey(table: Table) -> bool:
    """Has a table a row of options under its questions, which is nobody's?"""
    people = [column for name, column in table.columns.items() if plain(name) == "respondentid"]
    is_there = bool(people) and len(table) > 1 and any(plain(name) == "collectorid" for name in table.names)
    return is_there and not any(column.text(0) for column in people)


def restate_surveymonkey(table: Table) -> Table:
    """Leave out the row of options, and name the columns by these; by the question, too, where several have them."""
    questions, question = [], ""
    for name in table.names:
        question = question if _is_unnamed(name) else name
        questions.append(question)
    options = [column.text(0) for column in table.columns.values()]
    often = Counter(options)
    names = [
        question
        if option.lower() in ANSWERS
        else option
        if often[option] == 1
        else f"{question.rstrip(' :')}: {option}"
        for question, option in zip(questions, options, strict=True)
    ]
    columns = dict(zip(names, table.columns.values(), strict=True))
    if len(columns) < len(names):  # an option of the same question twice
        columns = dict(table.columns)
    note = "the row of options is left out, and names the columns"
    return replace(replace(table, columns=columns).where(np.arange(len(table)) > 0), notes=(*table.notes, note))
