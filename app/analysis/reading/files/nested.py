"""Flatten what programs nest in JSON and Python: sureal, choix, Label Studio, Argilla. Python is never run."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from app.analysis.reading.cells import shown
from app.analysis.reading.votes_table import VotesError

Row = dict[str, Any]
Notes = tuple[str, ...]
UNNAMING = ("id", "status", "_server_id")  # what Argilla says of each record
QUESTION = "question of the export"  # the column of what an answer is to, where a program may ask several
FEWEST_RANKED = 3  # of a list: two are a winner and a loser


def rows_of_json(content: Any) -> tuple[list[Row], Notes]:
    """Return the rows of a JSON document, and what was left out or restated.

    Raises
    ------
    VotesError
        If it holds nothing that is known.
    """
    if isinstance(content, dict):
        if "dis_videos" in content:
            return _sureal(content)
        content = content.get("votes")
    if not isinstance(content, list):
        raise VotesError("holds no list of votes, expected [{…}, …] or {'votes': [{…}, …]}")
    if content and all(isinstance(row, list) for row in content):
        return _choix(content)
    for number, row in enumerate(content, start=1):
        if not isinstance(row, dict):
            raise VotesError(f"row {number}: {shown(row)} is not an object with named values")
    if content and all("annotations" in row and "data" in row for row in content):
        return _label_studio(content)
    if content and all(_has_responses(row) for row in content):
        return _argilla(content)
    return content, ()


def rows_of_python(text: str) -> tuple[list[Row], Notes]:
    """Return the rows of a dataset file of sureal, whose values are taken as literals.

    Raises
    ------
    VotesError
        Naming the line of what is no literal.
    """
    try:
        statements = ast.parse(text).body
    except (SyntaxError, ValueError, RecursionError) as error:
        raise VotesError(f"is not readable as Python: {error}") from error
    values: dict[str, Any] = {}
    for statement in statements:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            name = statement.targets[0].id
            if name in ("dis_videos", "ref_videos", "dataset_name", "ref_score"):
                values[name] = _literal(statement.value, name)
    if "dis_videos" not in values:
        raise VotesError("has no list dis_videos, expected a dataset file of sureal (a Python file is read, never run)")
    return _sureal(values)


UNREAD = {"path", "yuv_fmt", "width", "height"}  # may be put together by a program; nothing is read from it


def _literal(node: ast.expr, name: str) -> Any:
    """Return the value of a literal; a path that the file would put together is left empty."""
    try:
        if isinstance(node, ast.List | ast.Tuple):
            items = [_literal(item, name) for item in node.elts]
            return items if isinstance(node, ast.List) else tuple(items)
        if isinstance(node, ast.Dict):
            keys = [key and _literal(key, name) for key in node.keys]
            values = zip(keys, node.values, strict=True)
            return {key: _path(item) if key in UNREAD else _literal(item, name) for key, item in values}
        return ast.literal_eval(node)
    except VotesError:
        raise
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError) as error:
        raise VotesError(
            f"line {node.lineno}: {name} is put together by a program, which is not run; write its values out (as JSON)"
        ) from error


def _path(node: ast.expr) -> str:
    """Return the last text of what makes a path: the file's name."""
    words = [part.value for part in ast.walk(node) if isinstance(part, ast.Constant) and isinstance(part.value, str)]
    return words[-1] if words else ""


def _sureal(content: Mapping[str, Any]) -> tuple[list[Row], Notes]:
    """Return the ratings of sureal's `os`: a list in the order of people, or people's names -> one or several."""
    contents = {video.get("content_id"): video.get("content_name") for video in content.get("ref_videos") or ()}
    rows: list[Row] = []
    is_listed = False
    videos = content["dis_videos"]
    if not isinstance(videos, list) or not all(isinstance(video, dict) for video in videos):
        raise VotesError("dis_videos is no list of films, expected [{'content_id': …, 'asset_id': …, 'os': …}, …]")
    for video in videos:
        name = str(video.get("path") or "").replace("\\", "/").rsplit("/", 1)[-1]
        condition = str(video["asset_id"]) if "asset_id" in video else name
        if not condition:
            raise VotesError("a film of dis_videos has neither asset_id nor path")
        scores = video.get("os")
        if scores is None:
            raise VotesError(
                f"the film {shown(condition)} has no ratings (os); mean scores (groundtruth) say nothing of people"
            )
        is_listed = is_listed or isinstance(scores, list | tuple)
        people = scores if isinstance(scores, dict) else dict(enumerate(scores, start=1))
        content_id = video.get("content_id", "")
        dataset = str(contents.get(content_id) or content_id)
        if isinstance(scores, dict) and scores and all(isinstance(person, tuple) for person in scores):
            rows += [{"participant": str(person), "dataset": dataset, "winner": condition, "loser": str(other),
                      "count": _times(value, condition)} for (person, other), value in scores.items()]  # fmt: skip
            continue
        names = {"dataset": dataset, "condition": condition}
        rows += [
            {"participant": str(person), **names, "rating": rating}
            for person, value in people.items()
            for rating in _each(value)
        ]
    if any("winner" in row for row in rows):
        if not all("winner" in row for row in rows):
            raise VotesError("some films of dis_videos have ratings and others comparisons; keep one kind")
        return rows, ("paired comparisons of sureal: items are asset_ids, preferred to what their votes name",)
    notes = ("a dataset of sureal: condition is the asset_id, dataset the content",)
    return rows, (*notes, "people are told apart by their place in each list") if is_listed else notes


def _times(value: Any, film: str) -> int:
    if not isinstance(value, int | float) or value < 0 or value != int(value):
        raise VotesError(f"a vote for the film {shown(film)} is {value}, expected a whole number of votes")
    return int(value)


def _each(value: Any) -> Iterator[Any]:
    """Yield somebody's one or several ratings of a film, without those that are missing."""
    for rating in value if isinstance(value, list | tuple) else (value,):
        if rating is not None and not (isinstance(rating, float) and math.isnan(rating)):
            yield rating


def _choix(content: Sequence[Sequence[Any]]) -> tuple[list[Row], Notes]:
    """Return pairs as winner and loser, longer lists as rankings, best first."""
    lengths = {len(row) for row in content}
    if lengths == {2}:
        rows = [{"winner": winner, "loser": loser} for winner, loser in content]
        return rows, ("lists of a winner and a loser, as choix has them",)
    if min(lengths) < 2:  # a pair
        raise VotesError(f"row {[len(row) for row in content].index(min(lengths)) + 1}: a list of fewer than two items")
    rows = [{f"rank_{place}": item for place, item in enumerate(row, start=1)} for row in content]
    return rows, ("lists of items, the best first, as choix has them",)


def _label_studio(tasks: Sequence[Row]) -> tuple[list[Row], Notes]:
    """Return a row for each annotation that chose one of two; the data's columns name the items."""
    rows, n_cancelled, n_gold = [], 0, 0
    for task in tasks:
        for annotation in task["annotations"]:
            if annotation.get("was_cancelled"):
                n_cancelled += 1
                continue
            for result in annotation.get("result") or ():
                value = result.get("value") or {}
                chosen = value.get("selected") or (value.get("choices") or [None])[0] or value.get("rating")
                if chosen is not None:
                    kind = "rating" if "rating" in value else "choice"
                    who = annotation.get("completed_by", "")
                    who = who.get("email") or who.get("id") if isinstance(who, dict) else who
                    question = {QUESTION: result.get("from_name", "")}
                    rows.append({**_scalars(task["data"]), "participant": who, kind: chosen, **question})
                    n_gold += bool(annotation.get("ground_truth"))
    gold = [f"{n_gold} annotations are marked as ground truth; they count"] if n_gold else []
    notes = [*gold, f"{n_cancelled} cancelled annotations are left out"] if n_cancelled else gold
    return rows, ("an export of Label Studio, a row for each annotation", *notes)


def _scalars(values: Mapping[str, Any]) -> Row:
    return {name: value for name, value in values.items() if not isinstance(value, dict | list)}


def _has_responses(row: Row) -> bool:
    return isinstance(row.get("responses"), dict | list) or any(name.endswith(".responses") for name in row)


def _argilla(records: Sequence[Row]) -> tuple[list[Row], Notes]:
    """Return a row for each submitted response; the metadata names the items."""
    rows, n_left_out = [], 0
    for record in records:
        cells = _scalars(record | (record.get("metadata") or {}))
        known = {name.removeprefix("metadata."): value for name, value in cells.items() if name not in UNNAMING}
        known = {name: value for name, value in known.items() if "." not in name}
        names_two = "preference" in str(known) or any(re.search(r"(_|-)?(a|1|left)$", name) for name in known)
        for question, who, status, value in _responses(record):
            if status not in ("submitted", None):
                n_left_out += 1
            elif value is not None:
                kind = "rating" if isinstance(value, int | float) and not names_two else "choice"
                rows.append({**known, "participant": who, kind: value, QUESTION: question})
    notes = [f"{n_left_out} responses that were not submitted are left out"] if n_left_out else []
    return rows, ("an export of Argilla, a row for each response", *notes)


def _responses(record: Row) -> Iterator[tuple[str, Any, Any, Any]]:
    """Yield the question, who responded, the status, and what was chosen."""
    responses = record.get("responses")
    if isinstance(responses, dict):
        for question, values in responses.items():
            for response in values:
                yield question, response.get("user_id"), response.get("status"), _chosen(response.get("value"))
    elif isinstance(responses, list):
        for response in responses:
            for question, value in (response.get("values") or {}).items():
                yield question, response.get("user_id"), response.get("status"), _chosen(value.get("value"))
    else:
        for name in [name for name in record if name.endswith(".responses")]:
            values = record[name] or ()
            users = record.get(f"{name}.users") or [None] * len(values)
            states = record.get(f"{name}.status") or [None] * len(values)
            for value, who, status in zip(values, users, states, strict=True):
                yield name.removesuffix(".responses"), who, status, _chosen(value)


def _chosen(value: Any) -> Any:
    """Return the preferred of a ranking of two, or a value such as "response-1" as the side that it ends in."""
    if isinstance(value, list) and value and all(isinstance(place, dict) for place in value):
        best = min(place["rank"] for place in value)
        first = [place["value"] for place in value if place["rank"] == best]
        if len(value) >= FEWEST_RANKED:
            raise VotesError(
                "a ranking of three or more responses of Argilla is not read; export it as a table of ranks"
            )
        value = first[0] if len(first) == 1 else "tie"
    if isinstance(value, str):
        return re.sub(
            r"^(response|completion|answer|option|generation)s?[-_ ]?(?=(1|2|a|b)$)", "", value, flags=re.IGNORECASE
        )
    return value
