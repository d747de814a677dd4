from __future__ import annotations

from typing import Any

import pytest

from app.study.options.options import StudyOptions, parse_options
from app.study.options.study_file import StudyFile, parse_study_file, write_study_file
from app.study.protocols import PROTOCOLS, SCALES, Protocol, Scale, grades_of, stored_scale, texts_of
from app.study.trial.valid_vote import InvalidVoteError, choice_of


@pytest.mark.parametrize(
    ("protocol", "scale", "values", "keys", "named"),
    [
        ("ACR", 5, range(1, 6), "12345", [1, 2, 3, 4, 5]),
        ("DCR", 5, range(1, 6), "12345", [1, 2, 3, 4, 5]),
        ("ACR-HR", 9, range(1, 10), "123456789", [1, 3, 5, 7, 9]),
        ("ACR", 11, range(11), "0123456789X", [1, 3, 5, 7, 9]),
        ("CCR", 5, range(-3, 4), "1234567", [-3, -2, -1, 0, 1, 2, 3]),
    ],
)
def test_grades_are_those_of_p910(protocol: Protocol, scale: Scale, values: range, keys: str, named: list[int]) -> None:
    grades = grades_of(protocol, scale)
    assert grades is not None
    assert [grade.value for grade in grades.steps] == list(values)
    assert "".join(grade.key for grade in grades.steps) == keys
    names = {grade.value: grade.name for grade in grades.steps if grade.name is not None}
    assert names == {value: place for place, value in enumerate(named)}


def test_a_slider_has_ends_and_no_steps() -> None:
    grades = grades_of("ACR", "slider")
    assert grades is not None
    assert (grades.low, grades.high, grades.is_slider, grades.steps) == (0, 100, True, ())


def test_a_study_file_keeps_the_protocol_and_older_ones_compare_pairs() -> None:
    for protocol in PROTOCOLS:
        rated = {"protocol": protocol, "scale": 11} if protocol.startswith(("ACR", "DCR")) else {"protocol": protocol}
        options = parse_options({**rated, "reference": "" if protocol == "ACR" else "scan"})
        text = write_study_file(StudyFile(name="Study", options=options))
        assert parse_study_file(text).options == options
        assert ("protocol" in text) == (protocol != "PC")
    assert parse_options({}) == StudyOptions()
    assert StudyOptions().protocol == "PC"


@pytest.mark.parametrize("scale", SCALES)
def test_a_database_tells_the_scale_as_text(scale: Scale) -> None:
    assert stored_scale(str(scale)) == scale
    assert stored_scale(None) == 5


def test_a_scale_with_a_decimal_point_is_the_whole_number() -> None:
    scale = parse_options({"protocol": "ACR", "scale": 9.0}).scale
    assert stored_scale(str(scale)) == 9


@pytest.mark.parametrize(("rating", "choice"), [(-3, "a"), (-1, "a"), (0, "none"), (1, "b"), (3, "b")])
def test_the_sign_of_a_comparison_names_the_better_one(rating: int, choice: str) -> None:
    assert choice_of(None, rating, "CCR", grades_of("CCR", 5)) == choice
    assert choice_of(None, abs(rating) or 1, "ACR", grades_of("ACR", 5)) is None


@pytest.mark.parametrize(
    ("answer", "protocol"),
    [
        ((None, None), "PC"),
        (("a", 1), "PC"),
        ((None, 4), "CCR"),
        (("b", 1), "CCR"),
        ((None, 0), "DCR"),
        (("a", None), "ACR"),
    ],
)
def test_an_answer_of_another_kind_is_named(answer: Any, protocol: Protocol) -> None:
    with pytest.raises(InvalidVoteError, match=f"protocol {protocol} expects"):
        choice_of(answer[0], answer[1], protocol, grades_of(protocol, 5))


def test_texts_of_a_protocol_replace_only_what_differs() -> None:
    general = {"a.b": "pair", "a.c": "kept"}
    texts = {**general, "protocols.ACR.a.b": "film"}
    assert texts_of(texts, "ACR-HR") == {"a.b": "film", "a.c": "kept"}
    assert texts_of(texts, "PC") == texts_of(texts, "DCR") == general
