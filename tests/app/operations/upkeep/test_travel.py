"""A study in one zip file, from one server to another."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest
from sqlalchemy import insert, select, update

from app.files import file_digest
from app.operations.database import open_store
from app.operations.studies.attach import attach
from app.operations.upkeep.backup import check
from app.operations.upkeep.erasure import erase_participant
from app.operations.upkeep.travel import export_to_file, import_file
from app.settings import Settings
from app.store.database.engine import Database
from app.store.database.tables import invitation, recruit, session, vote
from app.store.participants.participants import participant_labelled
from app.store.studies.audit import Actor, audit_records
from app.store.studies.images import image_digests, keep_image
from app.store.studies.measurements import measurement_records
from app.store.studies.studies import Study, study_by_slug
from app.store.trials.designs import conditions_of
from app.store.trials.sessions import shown_wordings
from app.store.trials.vote_records import vote_records
from tests.migrated_databases import on_sqlite
from tests.seeded_studies import NOW

PIXEL = b"\x89PNG\r\n\x1a\n" + bytes(20)
CODE = "PAID-42"
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def packed(settings: Settings, taken: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The zip file of a study that four people have taken, with a measure, an image, an outside id and a code."""
    folder = tmp_path_factory.mktemp("packed")
    table = folder / "measures.csv"
    table.write_text(
        "dataset,approach,measure,value,better\nball,id_fa,psnr_y,31.5,higher\nball,pm_fb,psnr_y,33,higher\n"
    )
    with open_store(settings) as database:
        study = study_in(database, taken["slug"])
        attach(settings, database, study, [table], by="Eva", now=NOW)
        with database.writing() as connection:
            keep_image(connection, study.id, "room.png", PIXEL)
            person = participant_labelled(connection, study.id, "P001")
            row = {"study_id": study.id, "participant_id": person.id, "outside_id": "5f1e-outside", "kept": {}}
            connection.execute(insert(recruit).values(**row, completion_code=CODE))
            named = update(invitation).where(invitation.c.study_id == study.id)
            connection.execute(named.values(label="for Anna Example"))
    export_to_file(settings, taken["slug"], folder / "study.zip")
    return folder / "study.zip"


def study_in(database: Database, slug: str) -> Study:
    with database.reading() as connection:
        study = study_by_slug(connection, slug)
    assert study is not None
    return study


def content_of(settings: Settings, slug: str) -> dict[str, Any]:
    """What analysts get of a study."""
    with open_store(settings) as database:
        study = study_in(database, slug)
        with database.reading() as connection:
            return {
                "votes": [{**row, "trial": None} for row in vote_records(connection, study.id)],
                "measures": measurement_records(connection, study.id),
                "conditions": conditions_of(connection, study.id),
                "texts": shown_wordings(connection, study.id),
                "images": image_digests(connection, study.id),
                "options": study.options,
            }


def without_times(content: dict[str, Any]) -> dict[str, Any]:
    measures = [{key: value for key, value in row.items() if key != "attached_at"} for row in content["measures"]]
    return {**content, "measures": measures}


def changed(packed: Path, out: Path, change: Callable[[dict[str, bytes]], None]) -> Path:
    """The zip file with other entries."""
    with ZipFile(packed) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    change(entries)
    with ZipFile(out, "w") as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return out


def files_in(folder: Path) -> list[Path]:
    return sorted(
        path.relative_to(folder)
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith((".lock", "study.sqlite"))
    )


def test_a_study_arrives_on_another_server_with_all_it_had(
    settings: Settings, taken: dict[str, Any], packed: Path, tmp_path: Path, new_migrated_url: Callable[[], str]
) -> None:
    there = Settings(data_dir=tmp_path / "there", database_url=new_migrated_url())
    made = import_file(there, packed)
    assert (made["slug"], made["state"], made["notes"]) == (taken["slug"], "paused", [])
    before, after = (content_of(where, taken["slug"]) for where in (settings, there))
    assert len(after["votes"]) == made["n_votes"] == 24
    assert after["measures"]
    assert after["images"]
    assert without_times(after) == without_times(before)
    assert check(there)["faults"] == []
    with open_store(there) as database:
        study = study_in(database, made["slug"])
        assert study.set_folder is not None
        assert Path(study.set_folder, "manifest.json").is_file()
        assert Path(study.set_folder).is_relative_to(there.sets_dir)
        with database.reading() as connection:
            entries = audit_records(connection, study_id=study.id)
        assert {entry["actor"] for entry in entries} == {"command line", "imported: command line", "imported: Eva"}


@on_sqlite
def test_nobodys_code_travels_and_new_ones_are_made(
    settings: Settings, taken: dict[str, Any], packed: Path, tmp_path: Path
) -> None:
    there = Settings(data_dir=tmp_path / "there")
    import_file(there, packed)
    secrets: list[set[str]] = []
    for where in (settings, there):
        with open_store(where) as database, database.reading() as connection:
            codes = set(connection.scalars(select(invitation.c.code)))
            hashes = set(connection.scalars(select(session.c.token_hash)))
            secrets.append(codes | hashes | set(connection.scalars(select(session.c.resume_hash))))
    with ZipFile(packed) as archive:
        packed_text = b"".join(archive.read(name) for name in archive.namelist() if not name.endswith(".mp4")).decode()
    assert not secrets[0] & secrets[1]
    assert not [secret for secret in secrets[0] if secret in packed_text]
    for private in (taken["invitation"], CODE, "5f1e-outside", "Anna Example", str(settings.data_dir.parent)):
        assert private not in packed_text
    with open_store(there) as database, database.reading() as connection:
        assert connection.execute(select(recruit)).all() == []


@on_sqlite
def test_outside_ids_travel_where_one_says_so(
    settings: Settings, taken: dict[str, Any], packed: Path, tmp_path: Path
) -> None:
    assert packed.is_file()
    export_to_file(settings, taken["slug"], tmp_path / "all.zip", has_outside=True)
    there = Settings(data_dir=tmp_path / "there")
    import_file(there, tmp_path / "all.zip")
    with open_store(there) as database, database.reading() as connection:
        assert [(row.outside_id, row.completion_code) for row in connection.execute(select(recruit))] == [
            ("5f1e-outside", CODE)
        ]
        assert "for Anna Example" in connection.scalars(select(invitation.c.label)).all()


@on_sqlite
def test_a_study_may_come_twice_under_two_names_and_shares_its_films(packed: Path, tmp_path: Path) -> None:
    there = Settings(data_dir=tmp_path / "there")
    import_file(there, packed)
    before = files_in(there.data_dir)
    with pytest.raises(ValueError, match="already a study"):
        import_file(there, packed)
    assert import_file(there, packed, name="Once more")["slug"] == "once-more"
    assert files_in(there.data_dir) == before


@on_sqlite
def test_a_film_of_the_same_name_with_other_content_stays(packed: Path, tmp_path: Path) -> None:
    there = Settings(data_dir=tmp_path / "there")
    with ZipFile(packed) as archive:
        name = next(each for each in archive.namelist() if each.startswith("media/"))
    other = there.media_dir / name.removeprefix("media/")
    other.parent.mkdir(parents=True)
    other.write_bytes(b"of another study")
    import_file(there, packed)
    assert other.read_bytes() == b"of another study"
    assert check(there)["faults"] == []


def lose_a_film(entries: dict[str, bytes]) -> None:
    entries.pop(next(name for name in entries if name.startswith("media/")))


def change_a_film(entries: dict[str, bytes]) -> None:
    name = next(name for name in entries if name.startswith("media/"))
    entries[name] = entries[name][:-1] + b"?"


def exchange_a_film(entries: dict[str, bytes]) -> None:
    """Its digest is right in the list, and not the one that the study's rows have."""
    first, second = [name for name in entries if name.startswith("media/")][:2]
    facts = json.loads(entries["study.json"])
    entries[first], facts["files"][first] = entries[second], facts["files"][second]
    entries["study.json"] = json.dumps(facts).encode()


def change_a_vote(entries: dict[str, bytes]) -> None:
    entries["tables/vote.jsonl"] = entries["tables/vote.jsonl"].replace(b'"choice": "a"', b'"choice": "b"', 1)


def lose_the_facts(entries: dict[str, bytes]) -> None:
    entries.pop("study.json")


def add_a_file(entries: dict[str, bytes]) -> None:
    entries["media/more.mp4"] = b"\0\0\0\x18ftypisom"


def come_from_the_future(entries: dict[str, bytes]) -> None:
    facts = json.loads(entries["study.json"])
    entries["study.json"] = json.dumps({**facts, "revision": "9999_later"}).encode()


def rewrite(entries: dict[str, bytes], table: str, change: Callable[[dict[str, Any]], None]) -> None:
    """Change a table's first row, and its digest with it, as somebody would who writes a file by hand."""
    import hashlib

    lines = entries[f"tables/{table}.jsonl"].splitlines(keepends=True)
    row = json.loads(lines[0])
    change(row)
    lines[0] = json.dumps(row).encode() + b"\n"
    entries[f"tables/{table}.jsonl"] = b"".join(lines)
    facts = json.loads(entries["study.json"])
    facts["tables"][table]["sha256"] = hashlib.sha256(b"".join(lines)).hexdigest()
    entries["study.json"] = json.dumps(facts).encode()


def leave_the_folder(entries: dict[str, bytes]) -> None:
    rewrite(entries, "pair", lambda row: row.update(file="../../evil.mp4"))


def hold_no_number_where_one_stands(entries: dict[str, bytes]) -> None:
    rewrite(entries, "vote", lambda row: row.update(shown_ms=float("inf")))


def refer_to_nobody(entries: dict[str, bytes]) -> None:
    rewrite(entries, "session", lambda row: row.update(participant_id=999_999))


def have_other_options(entries: dict[str, bytes]) -> None:
    rewrite(entries, "study", lambda row: row.update(options={"protocol": "none of ours"}))


@on_sqlite
@pytest.mark.parametrize(
    ("harm", "complaint"),
    [
        (lose_a_film, "is missing"),
        (change_a_film, "is not the file that was packed"),
        (exchange_a_film, "is not the file that the study shows"),
        (change_a_vote, "rows of vote are not those that were written"),
        (lose_the_facts, r"holds no study\.json"),
        (add_a_file, "is not among the files"),
        (come_from_the_future, "a newer one"),
        (leave_the_folder, "expected a plain name"),
        (hold_no_number_where_one_stands, r"vote\.shown_ms is inf, expected a finite number"),
        (refer_to_nobody, "FOREIGN KEY"),
        (have_other_options, "protocol"),
    ],
)
def test_what_is_not_whole_is_refused_and_leaves_nothing(
    packed: Path, tmp_path: Path, harm: Callable[[dict[str, bytes]], None], complaint: str
) -> None:
    there = Settings(data_dir=tmp_path / "there")
    with open_store(there):
        before = files_in(there.data_dir)
    with pytest.raises(ValueError, match=complaint):
        import_file(there, changed(packed, tmp_path / "other.zip", harm))
    assert files_in(there.data_dir) == before
    with open_store(there) as database, database.reading() as connection:
        assert connection.execute(select(session)).all() == []
        assert audit_records(connection) == []


@on_sqlite
def test_who_was_erased_here_is_erased_again(packed: Path, tmp_path: Path, taken: dict[str, Any]) -> None:
    there = Settings(data_dir=tmp_path / "there")
    import_file(there, packed)
    with open_store(there) as database:
        study = study_in(database, taken["slug"])
        with database.reading() as connection:
            person = participant_labelled(connection, study.id, "P001")
        erase_participant(there, database, study, person, Actor(0, "Eva", NOW))
    made = import_file(there, packed, name="Again")
    assert made["erased_again"] == 1
    with open_store(there) as database, database.reading() as connection:
        again = study_by_slug(connection, "again")
        assert again is not None
        assert "P001" not in {row["participant"] for row in vote_records(connection, again.id)}


def test_a_study_travels_without_its_set_where_that_is_gone(stimulus_set: Path, tmp_path: Path) -> None:
    from app.operations.studies.create import create_study

    here, there = Settings(data_dir=tmp_path / "here"), Settings(data_dir=tmp_path / "there")
    shutil.copytree(stimulus_set.parent, tmp_path / "set")
    made = create_study(here, tmp_path / "set", "Alone")
    shutil.rmtree(tmp_path / "set")
    told = export_to_file(here, made["slug"], tmp_path / "study.zip")
    assert "travels without it" in told["notes"][0]
    assert "did not come with it" in import_file(there, tmp_path / "study.zip")["notes"][0]


def test_the_set_arrives_with_its_masks_and_camera_paths(stimulus_set: Path, tmp_path: Path) -> None:
    from app.operations.studies.create import create_study

    here, there = Settings(data_dir=tmp_path / "here"), Settings(data_dir=tmp_path / "there")
    folder = tmp_path / "set"
    shutil.copytree(stimulus_set.parent, folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    entry = manifest["stimuli"][0]
    entry["mask"] = f"{entry['dataset']}/silhouette.mp4"
    shutil.copyfile(folder / entry["video"], folder / entry["mask"])
    (folder / "path.json").write_text("{}")
    path = {"file": "path.json", "sha256": file_digest(folder / "path.json")}
    manifest["provenance"] = {"paths": {entry["dataset"]: path}}
    (folder / "manifest.json").write_text(json.dumps(manifest))
    made = create_study(here, folder, "Masked")
    export_to_file(here, made["slug"], tmp_path / "study.zip")
    import_file(there, tmp_path / "study.zip")
    (arrived,) = there.sets_dir.iterdir()
    assert {file.name for file in arrived.rglob("*.*")} >= {"silhouette.mp4", "path.json"}
    create_study(there, arrived, "Another")


def test_a_missing_film_stops_the_export_and_leaves_no_file(stimulus_set: Path, tmp_path: Path) -> None:
    from app.operations.studies.create import create_study

    here = Settings(data_dir=tmp_path / "here")
    made = create_study(here, stimulus_set, "Torn")
    next(here.media_dir.glob("*.mp4")).unlink()
    with pytest.raises(ValueError, match="is missing, so nothing was exported"):
        export_to_file(here, made["slug"], tmp_path / "study.zip")
    assert not (tmp_path / "study.zip").exists()


@on_sqlite
def test_votes_can_go_on_where_a_study_arrives(packed: Path, tmp_path: Path) -> None:
    there = Settings(data_dir=tmp_path / "there")
    made = import_file(there, packed)
    from app.main import running_server
    from app.operations.studies.manage import add_invitation, add_token, change_study_standing
    from app.simulation.participants import simulate

    change_study_standing(there, made["slug"], "open")
    code = add_invitation(there, made["slug"], places=None)["path"].rpartition("/")[2]
    token = add_token(there, "tests")["token"]
    with running_server(there) as url:
        simulate(url, made["slug"], code, token, 1, {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}, 0.2, seed=4)
    with open_store(there) as database, database.reading() as connection:
        assert len(connection.execute(select(vote.c.id)).all()) == 30
