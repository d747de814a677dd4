"""One translator tells what is wrong in any file that users write."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired

import pytest
from pydantic import AfterValidator, Field, ValidationError
from typing_extensions import TypedDict

from ground.fields import Expected, plain
from ground.file_models import FilePart, WholeFile, faults_of, shown, without


def even(number: int) -> int:
    if number % 2:
        raise ValueError(f"{number} is odd; write the next one")
    return number


class Lens(FilePart):
    f_mm: Annotated[float, Field(gt=0)]


class Shop(WholeFile):
    name: Annotated[str, Field(max_length=5)]
    unit: Literal["mm", "m"] = "mm"
    lenses: Annotated[list[Lens], Field(min_length=1)] = Field(default_factory=list)
    by_name: dict[str, Lens] = Field(default_factory=dict)
    corner: Annotated[list[float] | None, Field(min_length=3, max_length=3), Expected("three numbers")] = None
    pairs: Annotated[int, AfterValidator(even)] = 2


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"name": 3}, "name is 3, expected a text of at most 5 characters"),
        ({"unit": "in"}, "unit is 'in', expected one of mm, m"),
        ({"lenses": []}, "lenses is [], expected a list of at least 1"),
        ({"lenses": [{"f_mm": 1}, {"f_mm": 0}]}, "lenses.1.f_mm is 0, expected a positive number"),
        ({"lenses": [{}]}, "lenses.0.f_mm is missing"),
        ({"by_name": {"a": {"f_mm": 1, "f": 1}}}, "by_name.a.f is unknown, expected one of f_mm"),
        ({"corner": [1, "2", 3]}, "corner.1 is '2', expected a number"),
        ({"corner": [1, 2]}, "corner is [1, 2], expected three numbers"),
        ({"corner": [1, 2, float("nan")]}, "corner.2 is nan, expected a number"),
        ({"pairs": 3}, "pairs: 3 is odd; write the next one"),
        ({"nam": "x"}, "nam is unknown, expected one of name, unit, lenses, by_name, corner, pairs"),
        ({"name": "x" * 500}, f"name is '{'x' * 119}…, expected a text of at most 5 characters"),
    ],
)
def test_a_fault_is_told_with_its_place_what_was_found_and_what_is_expected(
    change: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(ValidationError) as raised:
        Shop.model_validate({"name": "a", **change})
    assert [str(fault) for fault in faults_of(raised.value, Shop)] == [sentence]


def test_all_faults_are_told_and_a_file_that_is_no_object_is_one() -> None:
    with pytest.raises(ValidationError) as raised:
        Shop.model_validate({"unit": 1, "pairs": "2"})
    assert [fault.place for fault in faults_of(raised.value, Shop)] == [("name",), ("unit",), ("pairs",)]
    with pytest.raises(ValidationError) as raised:
        Shop.model_validate([])
    assert [str(fault) for fault in faults_of(raised.value, Shop)] == ["the file is [], expected an object with keys"]


class Box(TypedDict):
    side: Annotated[float, Field(ge=0, le=86_400_000)]
    lid: NotRequired[Literal["flat", "round"] | Literal["none"]]


@pytest.mark.parametrize(
    ("kind", "place", "words"),
    [
        (Box, ["side"], "a number from 0 to 86400000"),
        (Box, ["lid"], "one of flat, round or none"),
        (Box, [], "an object with keys"),
        (Annotated[str, Field(min_length=1, max_length=9)], [], "a text of 1 to 9 characters"),
        (Annotated[str | None, Field(pattern="^[a-z]$")], [], "a text that matches ^[a-z]$"),
        (Annotated[list[int], Field(max_length=3)], [], "a list of at most 3"),
        (list[Box], [2, "side"], "a number from 0 to 86400000"),
        (int | bool | None, [], "a whole number or true or false or nothing"),
        (Path | None, [], "a file or folder"),
    ],
)
def test_what_is_expected_is_told_of_every_type(kind: Any, place: list[str | int], words: str) -> None:
    assert plain(kind).at(place).words == words


def test_bytes_are_not_shown_to_who_sent_them() -> None:
    assert shown(b"--boundary\x00") == "11 bytes"
    assert shown("text") == "'text'"


def test_a_file_may_name_its_schema() -> None:
    assert Shop.model_validate({"$schema": "shop.schema.json", "name": "a"}).schema_file == "shop.schema.json"


def test_keys_are_left_out_by_their_places() -> None:
    content = {"a": [{"b": 1, "c": 2}], "d": 3}
    assert without(content, [("a", 0, "b"), ("d",)]) == {"a": [{"c": 2}]}
    assert content == {"a": [{"b": 1, "c": 2}], "d": 3}
