"""The demo's study and front page: what is measured against the truth, which nobody sees, stands beside the votes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from app.experiment.demo import (
    APPROACHES,
    MEASURES,
    demo_analysis,
    demo_front,
    demo_put_in,
    demo_study,
    demo_votes,
)
from app.ffmpeg import no_progress
from app.main import running_server
from app.operations.studies.create import create_study
from app.operations.studies.manage import list_studies
from app.settings import Settings
from tests.app import tiny_stimuli

SHOWN = APPROACHES[:-1]
VALUES = {approach: place % 4 + place / 9 for place, approach in enumerate(APPROACHES)}  # not in the paper's order


@pytest.fixture
def with_truth(tmp_path: Path) -> Path:
    """Films of five approaches and of the truth: a stimulus set's manifest."""
    folder = tmp_path / "stimuli"
    tiny_stimuli.write_set(folder, ["ball"], SHOWN)
    films = [tiny_stimuli.stimulus(folder, "ball", approach) for approach in SHOWN]
    truth = films[0] | {"approach": "truth", "levels": {}}
    factors = {"depth": ["id", "dr", "pm"], "fusion": ["fa", "fb"]}
    return tiny_stimuli.write_manifest(folder, [*films, truth], factors=factors)


@pytest.fixture
def report(tmp_path: Path) -> Path:
    """A report on the films, with a measure more than the demo compares."""
    folder = tmp_path / "validation"
    folder.mkdir()
    facts = {"dataset": "ball", "direction": "more is better", "unit": ""}
    measures = [
        {"approach": approach, "measure": measure, "value": value, **facts}
        for measure in (*MEASURES, "ms_ssim")
        for approach, value in VALUES.items()
    ]
    (folder / "report.json").write_text(json.dumps({"kind": "films", "measures": measures}), encoding="utf-8")
    return folder


@pytest.mark.slow
def test_the_demo_holds_a_few_measures_against_votes_on_all_but_the_truth_beside_studies_of_ones_own(
    tmp_path: Path, with_truth: Path, report: Path
) -> None:
    settings = Settings(data_dir=tmp_path / "study", database_url=None)
    create_study(settings, with_truth, "Mine", exposure_s=0.4)
    for _ in range(2):  # a second start finds everything
        demo_study(settings, with_truth, report, 0.4, no_progress)
    studies = {study["slug"]: study for study in list_studies(settings)}
    assert studies.keys() == {"mine", "demo"}
    assert studies["demo"]["n_conditions"] == len(SHOWN)
    (folder := tmp_path / "front").mkdir()
    paths = demo_front(settings, tmp_path, folder, n_frames=6)
    assert paths["participant"] == f"/s/{studies['demo']['invitations'][0]}"
    with running_server(settings) as url:
        demo_votes(settings, url, 2, tmp_path, no_progress)  # as a start that was stopped
        demo_votes(settings, url, 3, tmp_path, no_progress)
        demo_analysis(settings, url, tmp_path / "analysis")
    assert {study["slug"]: study["n_finished"] for study in list_studies(settings)} == {"mine": 0, "demo": 3}
    analysis = json.loads((tmp_path / "analysis" / "analysis.json").read_text(encoding="utf-8"))
    assert {score["item"] for score in analysis["scores"] if score["comparison"] == "all"} == set(SHOWN)
    assert {row["measure"] for row in analysis["measures"]} == set(MEASURES)
    put_in, came_out = demo_put_in(tmp_path)
    assert re.findall(r"[a-z]{2}_f[ab]_photographs", put_in) == sorted(SHOWN, key=lambda approach: -VALUES[approach])
    assert "in the order of ssim_actor" in put_in
    assert set(re.findall(r"[a-z]{2}_f[ab]_photographs", came_out)) == set(SHOWN)
    demo_front(settings, tmp_path, folder, n_frames=6)
    with running_server(settings, front=folder) as url:
        page = httpx.get(url, timeout=60).text
    best_first = re.findall(r"<td>([a-z]{2}_f[ab]_photographs)</td><td>[+−]\d\.\d\d</td><td>[+−]\d", page)
    assert best_first == sorted(SHOWN, key=lambda approach: -VALUES[approach])


@pytest.fixture
def front(tmp_path: Path, with_truth: Path, report: Path) -> Iterator[tuple[httpx.Client, dict[str, str]]]:
    """A demo that has made its study but has no votes: a client of its server, and where its page leads."""
    settings = Settings(data_dir=tmp_path / "study", database_url=None)
    demo_study(settings, with_truth, report, 0.4, no_progress)
    folder = tmp_path / "front"
    folder.mkdir()
    (folder / "recording_S1.webp").write_bytes(b"picture")
    (tmp_path / "secret.webp").write_bytes(b"secret")
    paths = demo_front(settings, tmp_path, folder, n_frames=6)
    with running_server(settings, front=folder) as url, httpx.Client(base_url=url, timeout=60) as client:
        yield client, paths


@pytest.mark.slow
def test_the_front_page_leads_to_participants_and_experimenters(front: tuple[httpx.Client, dict[str, str]]) -> None:
    client, paths = front
    page = client.get("/")
    assert page.status_code == 200
    assert "Nobody has voted yet" in page.text
    assert all(f"/front/model_{approach}.webp" in page.text for approach in APPROACHES)
    for path in paths.values():
        assert f'href="{path}"' in page.text
        assert client.get(path, follow_redirects=True).status_code == 200
    assert client.get("/?code=abc").headers["location"] == "/s/abc"


@pytest.mark.slow
def test_the_front_page_shows_only_its_own_pictures(front: tuple[httpx.Client, dict[str, str]]) -> None:
    client, _ = front
    assert client.get("/front/recording_S1.webp").content == b"picture"
    for name in ("front.json", "..%2Fsecret.webp", "none.webp"):
        assert client.get(f"/front/{name}").status_code == 404


@pytest.mark.slow
def test_every_file_that_the_front_page_names_is_a_link_and_nothing_of_the_data_folder_is(
    front: tuple[httpx.Client, dict[str, str]], tmp_path: Path
) -> None:
    client, _ = front
    (tmp_path / "validation" / "films").mkdir()
    (tmp_path / "validation" / "films" / "report.html").write_text("Films", encoding="utf-8")
    links = re.findall('href="(/made/[^"]+)"', client.get("/").text)
    assert {f"/made/stimuli/ball/{approach}.mp4" for approach in SHOWN} < set(links)
    assert [link for link in links if client.get(link).status_code != 200] == []
    assert "sandbox" in client.get("/made/validation/films/report.html").headers["content-security-policy"]
    for place in ("study/reconstudy.db", "stimuli/../secret.webp", "stimuli/%2E%2E/secret.webp", "stimuli", "none"):
        assert client.get(f"/made/{place}").status_code == 404
