"""A preset holds options that a study can have; what is given beside it wins."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from app.operations.studies.create import read_options
from app.study.design.design import Repetition
from app.study.kinds import ONLINE, PAPER, PRESETS, QUICK
from app.study.options.options import StudyOptions
from app.study.options.presets import read_preset
from app.study.options.study_file import StudyFile, parse_study_file, write_study_file
from app.study.options.wording import beyond_the_study, own_texts

TEXTS = Path(__file__).parents[4] / "languages"


@pytest.mark.parametrize("name", PRESETS)
def test_a_study_of_a_preset_is_exported_whole(name: str) -> None:
    options = read_options(None, {}, name)
    assert parse_study_file(write_study_file(StudyFile(name="A study", options=options))).options == options


@pytest.mark.parametrize("name", PRESETS)
def test_a_presets_file_holds_nothing_but_options_and_a_summary(name: str) -> None:
    preset = read_preset(name)
    assert preset.summary
    assert set(preset.options) <= set(StudyOptions().as_json())


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("language", ["en", "de"])
def test_a_presets_questions_are_worded_in_every_language(name: str, language: str) -> None:
    texts = json.loads((TEXTS / f"{language}.json").read_text(encoding="utf-8"))["questions"]
    for question in read_options(None, {}, name).questions:
        assert question.text or texts[question.name]["text"]
        if question.kind == "choice":
            assert set(question.options) == set(question.labels or texts[question.name]["options"])


def test_the_papers_preset_has_the_papers_five_stages_and_every_pair_once() -> None:
    options = read_options(None, {}, PAPER)
    assert options.way == ("introduction", "screening", "practice", "trial", "interview", "finished")
    assert options.screening.tests == ("acuity", "colour")
    assert {"age", "sex", "trained"} <= {question.name for question in options.questions}
    assert options.repetition == Repetition()
    assert options.adaptive_pairs == 0
    assert options.spoken_questions
    assert options.consent
    assert options.debriefing


def test_the_online_preset_asks_nothing_aloud_and_measures_the_distance_without_a_tape() -> None:
    options = read_options(None, {}, ONLINE)
    assert options.spoken_questions == ()
    assert options.screening.distance == "blind spot"
    assert options.identical_pairs > 0
    assert not options.phones


def test_the_quick_preset_is_the_shortest_study() -> None:
    assert read_options(None, {}, QUICK) == StudyOptions()


def test_what_is_given_overrides_the_file_and_the_file_the_preset(tmp_path: Path) -> None:
    file = tmp_path / "options.toml"
    file.write_text('break_every = 10\nrepeated_pairs = 3\n[screening]\non_failure = "stop"\n')
    options = read_options(file, {"repeated_pairs": 2}, ONLINE)
    assert (options.break_every, options.repeated_pairs, options.identical_pairs) == (10, 2, 1)
    assert (options.screening.on_failure, options.screening.distance) == ("stop", "blind spot")


def test_a_text_that_is_given_leaves_the_presets_others_and_a_consent_replaces_the_presets_in_every_language() -> None:
    given = {"texts": {"en": {"trial": {"question": "Which?"}}}, "consent": "Ours."}
    options = read_options(None, given, ONLINE)
    assert options.consent == "Ours."
    assert options.debriefing == read_options(None, {}, ONLINE).debriefing
    assert options.texts["en"] == {"trial.question": "Which?"}
    assert set(options.texts["de"]) == {"study.debriefing"}


def test_an_unknown_preset_is_refused_with_the_names_of_those_there_are() -> None:
    with pytest.raises(ValueError, match="'papr' is not known; expected one of paper, quick, online"):
        read_options(None, {}, "papr")


@pytest.mark.parametrize("name", PRESETS)
def test_a_presets_consent_tells_of_nothing_that_its_study_leaves_out(name: str) -> None:
    assert not beyond_the_study(read_options(None, {}, name))


@pytest.mark.parametrize(
    ("stage", "told"), [("screening", "tests of the eyes"), ("practice", "practice"), ("interview", "questions")]
)
@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("name", [PAPER, ONLINE])
def test_a_stage_that_is_left_out_is_missed_where_the_presets_consent_tells_of_it(
    name: str, language: str, stage: str, told: str
) -> None:
    whole = read_options(None, {}, name)
    own = own_texts(whole, language)
    changed = whole.but(languages=[language], texts={}, consent=own["study.consent"])
    stages = [each for each in whole.optional_stages if each != stage]
    assert told in beyond_the_study(changed.but(optional_stages=stages))


def test_phones_that_are_let_in_are_missed_where_the_consent_asks_for_a_computer() -> None:
    assert "a computer" in beyond_the_study(read_options(None, {}, ONLINE).but(phones=True))
