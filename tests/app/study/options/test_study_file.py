"""A study survives being written to a file and read again; a file that is not one says why."""

from __future__ import annotations

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.study.options.options import VOID_ON, StudyOptions, check_minimum_viewing, parse_options
from app.study.options.study_file import StudyFile, parse_study_file, with_line, write_study_file
from app.study.questions.questionnaire import DEFAULT_QUESTIONS
from app.study.screening.screening import ScreeningOptions

SCREENING = {"tests": ["acuity"], "acuity_limit": 0.1, "distance": "fixed", "distance_cm": 90.0, "on_failure": "stop"}
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=30).map(str.strip)
options = st.builds(
    StudyOptions,
    consent=texts,
    debriefing=texts,
    comprehension=st.booleans(),
    both_orders=st.booleans(),
    repeated_pairs=st.integers(0, 9),
    identical_pairs=st.integers(0, 9),
    free_exposure=st.booleans(),
    see_both=st.booleans(),
    minimum_viewing_s=st.floats(0, 600),
    void_on=st.sampled_from([(), VOID_ON, ("hidden", "blur")]),
    full_screen=st.sampled_from(["asked", "required"]),
    minimum_window=st.sampled_from([(), (1280, 720)]),
    phones=st.booleans(),
    pixels=st.sampled_from(["fit", "1:1"]),
    reference=texts,
    without=st.lists(texts, unique=True).map(tuple),
    break_every=st.integers(0, 99),
    abandoned_after_h=st.floats(0.1, 1e6),
    questions=st.sampled_from([(), DEFAULT_QUESTIONS]),
    screening=st.sampled_from([ScreeningOptions(), parse_options({"screening": SCREENING}).screening]),
)
files = st.builds(
    StudyFile,
    name=texts,
    stimuli=st.none() | texts,
    manifest_sha256=st.none() | st.just("0" * 64),
    exposure_s=st.none() | st.floats(0.1, 3600),
    seed=st.none() | st.integers(0, 2**63 - 1),
    options=options,
)


@pytest.mark.slow
@given(files)
def test_a_file_that_was_written_is_read_as_it_was(of: StudyFile) -> None:
    assert parse_study_file(write_study_file(of)) == of


def test_options_that_are_as_by_default_are_not_written() -> None:
    assert (
        write_study_file(StudyFile(name="Temple", seed=3)) == '#:schema study.schema.json\nname = "Temple"\nseed = 3\n'
    )


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("name = 'x'\nparticipants = 3", "'participants' is not known; expected some of name, stimuli"),
        ("seed = 3", "name is None"),
        ("name = 'x'\nseed = '3'", "seed is '3', expected a whole number"),
        ("name = 'x'\nexposure_s = true", "exposure_s is True, expected seconds"),
        ("name = 'x'\noptions = 3", "options is 3, expected a table"),
        ("name = 'x'\n[options]\nbreaks = 3", "option 'breaks' is not known"),
        ("name = x", "Invalid value"),
        (r'name = "x\u0000"', "name holds a NUL character"),
        ("name = 'x'\noptions = " + "[" * 50_000 + "]" * 50_000, "too many lists within one another"),
        ("name = 'x'\n" + "a." * 40_000 + "a = 1", "line 2: more than 32 words are joined by dots"),
        ("[" + "a . " * 20_000 + "a]", "line 1: more than 32 words are joined by dots"),
        ("x = { " + "\"\".'b'." * 13_000 + "a = 1 }", "line 1: more than 32 words are joined by dots"),
    ],
)
def test_a_file_that_is_not_right_says_why(text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_study_file(text)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("name = 'x'\nparticipants = 3", 2),
        ("name = 'x'\n[options]\nbreaks = 3", 3),
        ("name = 'x'\n[options.screening]\n\ndistance = 'far'", 4),
        ("seed = 3", None),  # what is missing stands in no line
    ],
)
def test_a_complaint_names_the_line_of_its_setting(text: str, line: int | None) -> None:
    with pytest.raises(ValueError, match="expected") as refused:
        parse_study_file(text)
    complaint = str(refused.value)
    assert with_line(text, refused.value) == (f"line {line}: {complaint}" if line else complaint)
    error = refused.value.with_traceback(None)
    error.__cause__ = error.__context__ = None  # which Dask hands on, too, where it was loaded
    handed_on = pickle.loads(pickle.dumps(error))  # files are read in a process of their own
    assert (str(handed_on), handed_on.field) == (complaint, refused.value.field)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("both_orders", 1),
        ("repeated_pairs", -1),
        ("identical_pairs", True),
        ("break_every", 2.5),
        ("void_on", "blur"),
        ("void_on", ["bored"]),
        ("minimum_viewing_s", -1),
        ("minimum_viewing_s", float("nan")),
        ("full_screen", "always"),
        ("minimum_window", [1280]),
        ("minimum_window", [1280, 0]),
        ("minimum_window", 1280),
        ("phones", "no"),
        ("pixels", "2:1"),
        ("abandoned_after_h", 0),
        ("abandoned_after_h", float("inf")),
        ("abandoned_after_h", 10**400),  # more than a float holds
        ("reference", ["id"]),
    ],
)
def test_an_option_that_is_not_as_described_is_named(name: str, value: object) -> None:
    with pytest.raises(ValueError, match=name):
        parse_options({name: value})


def test_a_minimum_viewing_time_fits_into_one_showing() -> None:
    check_minimum_viewing(StudyOptions(minimum_viewing_s=7.5), 15.0)
    check_minimum_viewing(StudyOptions(minimum_viewing_s=9.0, free_exposure=True), 15.0)
    with pytest.raises(ValueError, match=r"minimum_viewing_s is 9, .* expected at most half of it, 7.5"):
        check_minimum_viewing(StudyOptions(minimum_viewing_s=9.0), 15.0)


def test_a_required_full_screen_voids_a_look_when_it_is_left() -> None:
    assert StudyOptions(void_on=("blur",)).disturbances == ("blur",)
    assert StudyOptions(void_on=("blur",), full_screen="required").disturbances == ("full screen", "blur")
