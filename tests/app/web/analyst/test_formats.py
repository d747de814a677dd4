"""Tables as files: the same rows in every format, however many they are."""

from __future__ import annotations

import asyncio
import csv
import io
import json
import tracemalloc
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any

import pyarrow.parquet
import pytest
from fastapi.responses import Response, StreamingResponse

from app.web.analyst.columns import JOBS, STUDIES, TABLES, Columns, example_row
from app.web.analyst.formats import IN_MEMORY, ROWS_AT_ONCE, Format, TableRequest, json_bytes, table

COLUMNS = ("participant", "choice", "response_ms")


def votes(n: int) -> Iterator[dict[str, Any]]:
    for number in range(n):
        yield {"participant": f"P{number:07d}", "choice": "ab"[number % 2], "response_ms": number / 2}


def content_of(answer: Response) -> bytes:
    assert isinstance(answer, StreamingResponse)

    async def joined() -> bytes:
        return b"".join([bytes(part) async for part in answer.body_iterator])  # type: ignore[arg-type]  # bytes here

    with ThreadPoolExecutor(1) as pool:  # a browser of other tests has an event loop in this thread
        return pool.submit(lambda: asyncio.run(joined())).result()


def ask(rows: Iterable[Mapping[str, Any]], kind: Format, **changes: Any) -> Response:
    chosen = TableRequest(**{"format": kind, "known": "", "limit": None, "offset": 0} | changes)
    return table(rows, COLUMNS, chosen, "votes")


@pytest.mark.slow
def test_a_table_that_does_not_fit_into_memory_is_whole_in_every_format() -> None:
    n = 3 * ROWS_AT_ONCE + 7
    as_json, as_csv, as_parquet = (content_of(ask(votes(n), kind)) for kind in ("json", "csv", "parquet"))
    assert len(as_json) > IN_MEMORY
    rows = json.loads(as_json)
    assert rows == list(votes(n))
    read = csv.DictReader(io.StringIO(as_csv.decode()))
    assert [(row["participant"], float(row["response_ms"])) for row in read] == [
        (row["participant"], row["response_ms"]) for row in rows
    ]
    assert pyarrow.parquet.read_table(io.BytesIO(as_parquet)).to_pylist() == rows


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["json", "csv"])
def test_memory_does_not_grow_with_the_rows(kind: Format) -> None:
    tracemalloc.start()
    answer = ask(votes(120_000), kind)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(content_of(answer)) == int(answer.headers["content-length"]) > 2 * IN_MEMORY
    assert peak < 4 * IN_MEMORY  # the rows themselves are some 40 MB


def test_a_page_of_a_table_says_how_many_there_are_and_what_is_known_is_not_sent() -> None:
    page = ask(votes(50), "json", limit=3, offset=10)
    content = content_of(page)
    assert [row["participant"] for row in json.loads(content)] == ["P0000010", "P0000011", "P0000012"]
    assert page.headers["x-total-count"] == "50"
    again = ask(votes(50), "json", limit=3, offset=10, known=page.headers["etag"])
    assert (again.status_code, again.body) == (304, b"")
    more = ask(votes(51), "json", limit=3, offset=10, known=page.headers["etag"])
    assert (content_of(more), more.headers["x-total-count"]) == (content, "51")


@pytest.mark.parametrize("columns", [*TABLES.values(), JOBS, STUDIES])
def test_a_column_of_parquet_has_its_type_whatever_its_values_are(columns: Columns) -> None:
    example = example_row(columns)

    def types(rows: list[dict[str, Any]]) -> dict[str, pyarrow.DataType]:
        answer = table(rows, columns, TableRequest("parquet", "", None, 0), "rows")
        return {field.name: field.type for field in pyarrow.parquet.read_schema(io.BytesIO(content_of(answer)))}

    assert types([example]) == types([])


def test_a_column_of_several_kinds_is_text_in_parquet() -> None:
    late = [{"response_ms": None}] * ROWS_AT_ONCE
    for more, expected in (([1, 2.5], [1.0, 2.5]), ([1, "one"], ["1", "one"]), ([None, None], [None, None])):
        rows = [*late, *({"response_ms": value} for value in more)]
        read = pyarrow.parquet.read_table(io.BytesIO(content_of(ask(rows, "parquet"))))
        assert read["response_ms"].to_pylist()[-2:] == expected
    moments = [{"response_ms": datetime(2026, 1, 1, tzinfo=UTC)}]
    read = pyarrow.parquet.read_table(io.BytesIO(content_of(ask(moments, "parquet"))))
    assert read["response_ms"].to_pylist() == [datetime(2026, 1, 1, tzinfo=UTC)]


def test_a_number_that_json_does_not_know_is_not_written_as_if_it_did() -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        json_bytes({"score": float("nan")})
