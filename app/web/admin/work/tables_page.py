"""Show how a table of votes or ratings from elsewhere is read, let people change that, and analyse it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any
from urllib.parse import urlencode

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response

from app.ffmpeg import Progress
from app.intake.shelves import free_path
from app.operations.foreign_tables import Understood, analyse_table, understand
from app.operations.tasks import start_task
from app.store.studies.audit import Entry, record_alone
from app.web.admin.background import task_address
from app.web.admin.layout import page, see
from app.web.admin.work.files_page import Name, entry_address
from app.web.analyst.upload_routes import Said, edits_of
from app.web.gates import Store, settings
from app.web.roles import Acting, Looking
from app.web.uploads import entry_of

SHELF = "votes"
ROLES = {  # of columns, in the words of the page
    "participant": "participant",
    "dataset": "dataset (scene)",
    "item_a": "first item of a pair",
    "item_b": "second item of a pair",
    "choice": "choice between them",
    "condition": "condition that is rated",
    "rating": "rating",
    "first_shown": "item shown first",
    "practice": "practice",
    "excluded": "does not count",
    "reason": "why it does not count",
    "count": "how often the row counts",
    "trial": "trial",
    "response_ms": "time of the answer, ms",
    "reference": "is the reference",
    "protocol": "protocol",
    "role": "kind of trial",
    "winner": "preferred item",
    "loser": "other item",
    "wins_a": "times the first won",
    "wins_b": "times the second won",
    "ties": "times nobody won",
    "rank": "rank",
    "best": "best of several",
    "worst": "worst of several",
    "options": "items to choose from",
}

CHOICES = {"a": "for the first item", "b": "for the second", "none": "for neither", "by": "as what a cell names"}
FIELDS = {"format": "Layout", "encoding": "Encoding", "sheet": "Sheet", "scale": "Scale of ratings"}
OPTION = re.compile(rf'--(columns|choices|{"|".join(FIELDS)}) (?:"([^"]*)"|([^\s;()]*[^\s;(),.]))')
COMMANDS_ONLY = "Map other names"  # begins what a refusal says of options; the page has a field for each column

router = APIRouter(prefix=f"/admin/files/{SHELF}/{{name}}", include_in_schema=False)


@router.get("/reading")
def reading_page(request: Request, person: Looking, name: Name, said: Said) -> Response:
    """Show how a table is read: its columns, the three lists, warnings, and questions."""
    from app.analysis.reading.recognise import LAYOUTS

    path = entry_of(settings(request), SHELF, name)
    understood = _in_words_of_the_page(understand(path, said.told, said.scale))
    base = f"{entry_address(SHELF, name)}/reading"
    context = {
        "name": name,
        "entry": entry_address(SHELF, name),
        "understood": understood,
        "roles": ROLES,
        "said": said.text,
        "formats": LAYOUTS,
        "readings": [(text, f"{base}?{urlencode(_more(said.text, told))}") for text, told in understood.readings],
    }
    return page(request, "table_reading", person, context)


@router.post("/analyse")
def analyse(
    request: Request,
    actor: Acting,
    name: Name,
    store: Store,
    columns: Annotated[str, Form(max_length=2000)] = "",
    choices: Annotated[str, Form(max_length=2000)] = "",
    layout: Annotated[str, Form(alias="format", max_length=40)] = "",
    encoding: Annotated[str, Form(max_length=200)] = "",
    sheet: Annotated[str, Form(max_length=200)] = "",
    scale: Annotated[str, Form(max_length=200)] = "",
) -> Response:
    """Analyse a table as it is read now, in the background; the report comes to the files that jobs made."""
    path, intake = entry_of(settings(request), SHELF, name), settings(request).intake_dir
    said = edits_of(columns, choices, layout, encoding, sheet, scale)
    out = next(free for free in _names(name) if not (intake / "runs" / free).exists())

    def work(_tell: Progress) -> str:
        try:
            analyse_table(path, said.told, free_path(intake, "runs", out), said.scale)
        except ValueError as error:
            raise ValueError(in_words_of_the_page(str(error))) from None
        record_alone(store, actor.name, Entry("table analysed", subject=f"{SHELF}/{name}", detail=said.text), actor.now)
        return entry_address("runs", out)

    return see(task_address(start_task(store, actor, f"Analysing {name}", work)))


def _names(name: str) -> Any:
    stem = name.partition(".")[0].strip() or "table"
    yield f"{stem}-analysis"
    yield from (f"{stem}-analysis-{number}" for number in range(2, 10_000))


def _more(said: dict[str, str], told: Any) -> dict[str, str]:
    """Return the fields of a link that says more than what is said already."""
    joined = {key: ",".join(filter(None, (said[key], told[key]))) for key in ("columns", "choices")}
    return {
        key: value for key, value in {**said, **joined, "format": told["format"] or said["format"]}.items() if value
    }


def _in_words_of_the_page(understood: Understood) -> Understood:
    lists, warnings = (tuple(map(in_words_of_the_page, said)) for said in (understood.lists, understood.warnings))
    return replace(understood, lists=lists, warnings=warnings, refusal=in_words_of_the_page(understood.refusal))


def in_words_of_the_page(sentence: str) -> str:
    """Return a sentence on a table with the page's fields in place of a command's options."""
    said, is_general, _ = sentence.partition(COMMANDS_ONLY)
    return OPTION.sub(_field, said + "Choose below what each column is" if is_general else said)


def _field(option: re.Match[str]) -> str:
    name, value = option[1], option[2] or option[3]
    return f"“{value}” as {FIELDS[name]} below" if name in FIELDS else ", ".join(_chosen(name, value)) + " below"


def _chosen(option: str, value: str) -> Iterator[str]:
    for pair in value.split(","):
        ours, _, theirs = pair.partition("=")
        yield (
            f"“{ROLES.get(ours, ours)}” for {theirs}" if option == "columns" else f"{theirs} {CHOICES.get(ours, ours)}"
        )
