"""What a study will be is said before it is made, and is so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from app.intake.stimuli import read_manifest
from app.operations.studies import manage
from app.operations.studies.check_films import check_study
from app.operations.studies.create import create_study
from app.operations.studies.forecast import forecast
from app.settings import Settings
from app.study.options.options import parse_options
from tests.app.tiny_stimuli import encode, flat, stimulus, write_manifest, write_set

PLANS: list[dict[str, Any]] = [
    {},
    {"second_codec": "vp9", "fallback": "", "both_orders": True},
    {"identical_pairs": 1, "repeated_pairs": 1, "reference": "pm_fb"},
    {"pair_films": "decoded", "identical_pairs": 1, "fallback": ""},
    {"protocol": "ACR", "lighter_films": True},
    {"protocol": "DCR", "reference": "pm_fb", "identical_pairs": 1, "fallback": ""},
    {"without": ["id_fa"], "practice_dataset": "box", "optional_stages": ["practice"], "fallback": ""},
]


@pytest.mark.slow
@pytest.mark.parametrize("options", PLANS, ids=lambda options: "-".join(options) or "plain")
def test_pairs_trials_and_films_are_as_many_as_was_said(tmp_path: Path, options: dict[str, Any]) -> None:
    settings = Settings(data_dir=tmp_path)
    manage.upgrade_database(settings)
    manifest = write_set(tmp_path / "set", ["ball", "box"], ["id_fa", "id_fb", "pm_fb"])
    wanted = parse_options(options)
    said = forecast(settings, read_manifest(manifest), wanted, None)
    made = create_study(settings, manifest, "Made", options=wanted)
    assert (said.n_pairs, said.n_trials) == (made["n_pairs"], made["n_trials"])
    assert said.n_films == len(list(settings.media_dir.glob("*.mp4")))
    assert check_study(settings, made["slug"])["faults"] == {}
    n_bytes = sum(path.stat().st_size for path in settings.media_dir.glob("*.mp4"))
    assert n_bytes / 3 < said.n_bytes < 3 * n_bytes


@pytest.mark.slow
def test_the_size_is_right_where_films_begin_still_and_scenes_differ(tmp_path: Path) -> None:
    noise = {"still": 0, "wind": 20, "storm": 60}
    stimuli = []
    for dataset, strength in noise.items():
        for seed, approach in enumerate(("id_fa", "id_fb", "pm_fb")):
            moves = f"{flat('gray')},noise=alls={strength}:allf=t:all_seed={seed}:enable='gt(n,20)'"
            encode(tmp_path / "set" / dataset / f"{approach}.mp4", moves, "-frames:v", "100")
            stimuli.append(stimulus(tmp_path / "set", dataset, approach) | {"n_frames": 100})
    settings = Settings(data_dir=tmp_path)
    manage.upgrade_database(settings)
    manifest = write_manifest(tmp_path / "set", stimuli)
    said = forecast(settings, read_manifest(manifest), parse_options({}), None)
    create_study(settings, manifest, "Made")
    n_bytes = sum(path.stat().st_size for path in settings.media_dir.glob("*.mp4"))
    assert n_bytes / 1.5 < said.n_bytes < 1.5 * n_bytes


def test_films_that_cannot_be_encoded_leave_time_and_size_open(tmp_path: Path) -> None:
    manifest = write_set(tmp_path / "set", ["ball"], ["id_fa", "id_fb"])
    for film in (tmp_path / "set").glob("*/*.mp4"):
        film.write_bytes(b"no film")
    said = forecast(Settings(data_dir=tmp_path), read_manifest(manifest), parse_options({}), None)
    assert said.n_films == 3
    assert said.n_bytes != said.n_bytes  # NaN
    assert not said.is_too_large
