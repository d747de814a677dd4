"""What the command line asks of the server's side."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from app.errors import StimuliError
from app.operations.studies import create, manage
from app.settings import Settings
from app.store.database.migrate import newest_version
from tests.app import tiny_stimuli


@pytest.mark.slow
def test_a_study_is_as_long_as_its_shortest_video_unless_told(
    study: dict[str, Any], stimulus_set: Path, tmp_path: Path
) -> None:
    made = create.create_study(Settings(data_dir=tmp_path), stimulus_set, "By itself")
    assert made["exposure_s"] == tiny_stimuli.N_FRAMES / tiny_stimuli.FPS
    assert (made["n_datasets"], made["n_conditions"], made["n_pairs"]) == (2, 3, 6)
    assert made["path"] == f"/s/{made['invitation']}"
    assert study["seed"] == 1


@pytest.mark.slow
def test_studies_are_listed_with_progress(stimulus_set: Path, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    assert manage.list_studies(settings) == []
    made = create.create_study(settings, stimulus_set, "One")
    (listed,) = manage.list_studies(settings)
    assert (listed["slug"], listed["invitations"], listed["n_votes"]) == ("one", [made["invitation"]], 0)
    json.dumps(listed)


def test_a_second_study_of_a_name_is_refused(study: dict[str, Any], settings: Settings, stimulus_set: Path) -> None:
    with pytest.raises(ValueError, match="already a study"):
        create.create_study(settings, stimulus_set, study["name"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "complaint"),
    [({"exposure_s": 0.0}, "exposure 0"), ({"exposure_s": float("nan")}, "exposure nan"), ({"seed": -1}, "seed -1")],
)
def test_numbers_out_of_bounds_are_refused(
    stimulus_set: Path, tmp_path: Path, options: dict[str, Any], complaint: str
) -> None:
    settings = Settings(data_dir=tmp_path)
    with pytest.raises(ValueError, match=complaint):
        create.create_study(settings, stimulus_set, "Wrong", **options)
    assert manage.list_studies(settings) == []


def test_a_bad_stimulus_set_leaves_no_study(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    with pytest.raises(StimuliError, match="no such file"):
        create.create_study(settings, tmp_path / "nothing", "Nothing")
    assert manage.list_studies(settings) == []


@pytest.mark.parametrize(
    ("name", "slug"),
    [
        ("Temple, round 2", "temple-round-2"),
        ("Été à Graz", "ete-a-graz"),
        ("Größe ß", "grosse-ss"),
        ("Łódź og Øst", "lodz-og-ost"),
        ("日本", "name-cf2abf0c"),
        ("日本 2", "2-367cd00e"),  # another address than that of "2"
        ("\u062f\u0631\u0627\u0633\u0629 \U0001f469\u200d\U0001f52c", "name-1ac57e49"),  # Arabic, and a joined emoji
        ("New", "new-18fdd549"),  # /admin/studies/new creates a study
    ],
)
def test_a_name_becomes_an_address(name: str, slug: str) -> None:
    assert create.slugify(name) == slug


@pytest.mark.parametrize("name", ["", "---", "x" * 201, "two\nlines", "\x1b[31mred", "safe\u202egnp.exe"])
def test_a_name_that_cannot_be_an_address_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="expected a name"):
        create.slugify(name)


def test_a_tokens_name_is_taken_once(settings: Settings) -> None:
    manage.add_token(settings, "twice")
    with pytest.raises(ValueError, match="already a token"):
        manage.add_token(settings, "twice")


def test_an_invitation_needs_a_study_and_a_place(settings: Settings, study: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="no study 'unknown'"):
        manage.add_invitation(settings, "unknown")
    with pytest.raises(ValueError, match="0 places"):
        manage.add_invitation(settings, study["slug"], places=0)


@pytest.mark.slow
def test_without_a_name_there_has_to_be_one_study(stimulus_set: Path, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    with pytest.raises(ValueError, match="there is no study yet; `reconstudy study create` makes one"):
        manage.attach_results(settings, [])
    for name in ("First", "Second"):
        create.create_study(settings, stimulus_set, name)
    with pytest.raises(ValueError, match="there are several studies: second, first; say which is meant with --study"):
        manage.attach_results(settings, [])


@pytest.mark.slow
def test_another_database_must_be_upgraded_by_hand(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, database_url=f"sqlite:///{tmp_path / 'other.sqlite'}")
    with pytest.raises(ValueError, match="reconstudy db upgrade"):
        manage.list_studies(settings)
    assert manage.upgrade_database(settings) == {"version": newest_version()}
    assert manage.list_studies(settings) == []


@pytest.mark.slow
def test_the_server_loads_nothing_heavy_at_its_start() -> None:
    heavy = "{'open3d', 'cv2', 'numba', 'pyrender', 'altair', 'pandas', 'scipy', 'matplotlib'}"
    code = f"import app.main, sys; print(sorted({heavy} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
