"""Which films participants practise with."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from app.errors import StimuliError
from app.films.practice import choose_practice, most_different
from app.intake.stimuli import StimulusSet, read_stimulus_set
from app.study.options.options import parse_options
from app.study.options.practice import PracticeFilms
from tests.app import tiny_stimuli

APPROACHES = ("id_fa", "id_fb", "pm_fb")  # grey levels in this order


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    tiny_stimuli.write_set(folder, ("ball", "box"), APPROACHES)
    return folder


@pytest.fixture
def stimulus_set(folder: Path) -> StimulusSet:
    return read_stimulus_set(folder)


def names(pairs: object) -> list[str]:
    return [f"{a.name} {b.name}" for a, b in pairs]  # type: ignore[attr-defined]


def test_the_most_different_films_are_those_farthest_apart_in_grey(stimulus_set: StimulusSet) -> None:
    first, last = most_different(stimulus_set, stimulus_set.of_dataset("box"))
    assert (first.approach, last.approach) == ("id_fa", "pm_fb")


def test_a_dataset_for_practice_is_in_no_trial_and_needs_no_note(stimulus_set: StimulusSet) -> None:
    practice = choose_practice(stimulus_set, "box", ())
    assert names(practice.pairs) == ["box/id_fa box/pm_fb"]
    assert practice.compared.datasets == ("ball",)
    assert practice.films == (PracticeFilms(dataset="box", a="id_fa", b="pm_fb"),)
    assert practice.notes == ()


def test_films_chosen_by_hand_are_shown_and_a_note_says_that_they_are_compared_too(stimulus_set: StimulusSet) -> None:
    wanted = [PracticeFilms(dataset="ball", a="id_fa", b="id_fb"), PracticeFilms(dataset="box", a="pm_fb", b="id_fa")]
    practice = choose_practice(stimulus_set, "box", wanted)
    assert names(practice.pairs) == ["ball/id_fa ball/id_fb", "box/pm_fb box/id_fa"]
    (note,) = practice.notes
    assert note.startswith("The practice shows ball/id_fa and ball/id_fb, and the trials compare these two films, too")


def test_a_set_with_nothing_to_spare_lends_the_most_different_films_of_its_first_dataset(
    stimulus_set: StimulusSet,
) -> None:
    practice = choose_practice(stimulus_set, "", ())
    assert names(practice.pairs) == ["ball/id_fa ball/pm_fb"]
    assert practice.compared == stimulus_set
    assert len(practice.notes) == 1


def test_the_reference_is_not_practised_with(stimulus_set: StimulusSet) -> None:
    assert names(choose_practice(stimulus_set, "box", (), "pm_fb").pairs) == ["box/id_fa box/id_fb"]


def test_where_films_are_rated_against_a_reference_each_is_practised_after_the_studys_own(folder: Path) -> None:
    stimulus_set = read_stimulus_set(folder)

    def practised(reference: str, *wanted: PracticeFilms) -> list[str]:
        return names(choose_practice(stimulus_set, "", wanted, reference, is_rated_against=True).pairs)

    assert practised("pm_fb") == ["ball/pm_fb ball/id_fa"], "the reference comes first, whichever films differ most"
    assert practised("id_fb") == ["ball/id_fb ball/id_fa", "ball/id_fb ball/pm_fb"]
    named = PracticeFilms(dataset="box", a="id_fa", b="pm_fb")
    assert practised("pm_fb", named) == ["box/pm_fb box/id_fa"]
    assert practised("original", named) == ["box/id_fa box/pm_fb"], "the scene has no reference"
    again = choose_practice(stimulus_set, "", (), "id_fb", is_rated_against=True)
    assert practised("id_fb", *again.films) == names(again.pairs), "as in the exported study"


def test_films_that_the_set_names_for_practice_come_before_those_of_the_trials(folder: Path) -> None:
    content = json.loads((folder / "manifest.json").read_text())
    box = [entry for entry in content["stimuli"] if entry["dataset"] == "box"]
    content |= {"stimuli": [entry for entry in content["stimuli"] if entry["dataset"] == "ball"], "practice": box[:2]}
    manifest = folder / "spare.json"
    manifest.write_text(json.dumps(content))
    spare = read_stimulus_set(manifest)
    practice = choose_practice(spare, "", ())
    assert (names(practice.pairs), practice.notes) == (["box/id_fa box/id_fb"], ())
    assert choose_practice(spare, "", practice.films).pairs == practice.pairs, "as in the exported study"


@pytest.mark.parametrize(
    ("dataset", "wanted", "complaint"),
    [
        ("bux", (), "the dataset for practice is 'bux', expected one of ball, box"),
        ("", (PracticeFilms(dataset="box", a="id_fa", b="pm_fx"),), "box/pm_fx .* of box it has id_fa, id_fb, pm_fb"),
        ("", (PracticeFilms(dataset="bux", a="id_fa", b="pm_fx"),), "of bux it has none"),
    ],
)
def test_what_the_set_lacks_is_named(
    stimulus_set: StimulusSet, dataset: str, wanted: tuple[PracticeFilms, ...], complaint: str
) -> None:
    with pytest.raises(StimuliError, match=complaint):
        choose_practice(stimulus_set, dataset, wanted)


def test_the_only_dataset_cannot_be_for_practice_alone(folder: Path) -> None:
    alone = read_stimulus_set(folder).without_dataset("box")
    with pytest.raises(StimuliError, match="ball is the only dataset"):
        choose_practice(alone, "ball", ())


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("ball", "practice_pairs is 'ball', expected at most 10 pairs, each a dataset and two of its conditions"),
        ([{"dataset": "ball", "a": "x"}], "b is None, expected a condition's name"),
        ([{"dataset": "ball", "a": "x", "b": "x"}], "names 'x' twice"),
        ([{"dataset": "ball", "a": "x", "b": 3}], "b is 3, expected a condition's name"),
    ],
)
def test_pairs_to_practise_with_are_checked(content: object, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_options({"practice_pairs": content})
