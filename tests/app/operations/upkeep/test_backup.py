"""Backups are taken and brought back row by row, from either kind of database into either."""

from __future__ import annotations

import re
import shutil
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest
from sqlalchemy import delete, insert, select, text, update

from app.operations.database import open_store
from app.operations.studies import create, manage
from app.operations.upkeep.backup import back_up, check, restore
from app.settings import Settings
from app.store.database.engine import Database, open_database
from app.store.database.migrate import newest_version, version_of
from app.store.database.tables import metadata, pair, session, trial, vote
from app.store.studies.images import keep_image
from app.store.studies.studies import study_by_id
from app.store.trials.admission import begin_preview
from tests.app.web.admin import small_models
from tests.migrated_databases import on_sqlite
from tests.postgresql import PostgresServer
from tests.seeded_studies import NOW, seed_voters


@pytest.fixture
def here(tmp_path: Path, new_migrated_url: Callable[[], str]) -> Settings:
    """A server's settings, on either kind of database, with votes in it."""
    settings = Settings(data_dir=tmp_path / "here", database_url=new_migrated_url())
    database = open_database(settings.url)
    seed_voters(database, 3, 4)
    with database.writing() as connection:
        trials = connection.execute(select(trial.c.id, trial.c.session_id)).all()
        rows = [vote_row(number, *row) for number, row in enumerate(trials[:-1])]
        connection.execute(insert(vote), rows)
        connection.execute(update(trial).where(trial.c.id == trials[-1].id).values(served_at=None))
    database.dispose()
    return settings


def vote_row(number: int, trial_id: int, session_id: int) -> dict[str, Any]:
    return {
        "client_id": f"vote {number}",
        "session_id": session_id,
        "trial_id": trial_id,
        "choice": ("a", "b", "none")[number % 3],
        "first_shown": "a",
        "n_switches": 1,
        "shown_ms": 1 / 3 + number,
        "response_ms": 0.1,
        "viewing": {"switches": [{"to": "b", "at_ms": 1.5}], "first_shown": "a"},
        "received_at": NOW.replace(microsecond=number),
    }


def modes_of_attached(settings: Settings) -> set[int]:
    return {(settings.data_dir / folder).stat().st_mode & 0o777 for folder in ("reports", "models")}


def rows_of(settings: Settings) -> dict[str, list[Any]]:
    database = open_database(settings.url)
    with database.reading() as connection:
        found = {
            table.name: [tuple(row) for row in connection.execute(select(table).order_by(*table.primary_key))]
            for table in metadata.sorted_tables
        }
    database.dispose()
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_every_row_comes_back_on_either_kind_of_database(
    here: Settings, kind: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    with open_store(here) as database, database.writing() as connection:
        keep_image(connection, 1, "room.png", bytes(range(256)))
    back_up(here, tmp_path / "backup.zip")
    url = None if kind == "sqlite" else request.getfixturevalue("postgres").new_database(f"restored_{id(here)}")
    there = Settings(data_dir=tmp_path / "there", database_url=url)
    restored = restore(there, tmp_path / "backup.zip")
    before = rows_of(here)
    assert rows_of(there) == before
    assert len(before["vote"]) == 17
    assert check(there)["faults"] == [f"{there.media_dir / 'file.mp4'}: is missing"]
    assert restored["missing_videos"] == 1
    database = open_database(there.url)
    (new_id,) = seed_ids(database)
    assert new_id == 1 + max(row[0] for row in before["trial"])
    database.dispose()


def seed_ids(database: Database) -> list[int]:
    """The next id that the database gives out."""
    with database.writing() as connection:
        first = connection.execute(select(trial.c.session_id, trial.c.assignment_id)).first()
        assert first is not None
        row = {"session_id": first.session_id, "assignment_id": first.assignment_id, "attempt": 2, "public_id": "new"}
        return list(connection.scalars(insert(trial).values(**row).returning(trial.c.id)))


@pytest.mark.slow
def test_a_backup_is_of_one_moment_while_votes_come_in(here: Settings, tmp_path: Path) -> None:
    ended = threading.Event()
    database = open_database(here.url)

    def write() -> None:
        """Always both or neither of two rows in two tables."""
        turn = 0
        while not ended.is_set():
            turn += 1
            with database.writing() as connection:
                connection.execute(text(f"UPDATE session SET stage = 'turn {turn}'"))
                connection.execute(text(f"UPDATE study SET name = 'turn {turn}'"))

    writer = threading.Thread(target=write)
    writer.start()
    try:
        for number in range(5):
            back_up(here, tmp_path / f"{number}.zip")
    finally:
        ended.set()
        writer.join()
        database.dispose()
    for number in range(5):
        there = Settings(data_dir=tmp_path / f"there_{number}")
        restore(there, tmp_path / f"{number}.zip")
        found = open_database(there.url)
        with found.reading() as connection:
            name = connection.scalar(text("SELECT name FROM study"))
            assert set(connection.scalars(select(session.c.stage))) == {name if name != "Test" else "trial"}
        found.dispose()


@pytest.mark.slow
def test_studies_are_not_replaced_unless_one_says_so(here: Settings, tmp_path: Path) -> None:
    back_up(here, tmp_path / "backup.zip")
    before = rows_of(here)
    with pytest.raises(ValueError, match=r"holds 1 study\b.*--replace"):
        restore(here, tmp_path / "backup.zip")
    database = open_database(here.url)
    with database.writing() as connection:
        connection.execute(delete(vote))
    restore(here, tmp_path / "backup.zip", replace=True)
    with database.reading() as connection:  # a server that ran all the time
        assert len(connection.execute(select(vote)).all()) == 17
    assert version_of(database) == newest_version()
    database.dispose()
    assert rows_of(here) == before


def test_tables_of_another_program_are_never_dropped(here: Settings, tmp_path: Path) -> None:
    back_up(here, tmp_path / "backup.zip")
    before = rows_of(here)
    database = open_database(here.url)
    with database.writing() as connection:
        connection.execute(text("CREATE TABLE bookings (day INTEGER)"))
        connection.execute(text("INSERT INTO bookings VALUES (7)"))
    with pytest.raises(ValueError, match=r"bookings.*database of its own"):
        restore(here, tmp_path / "backup.zip", replace=True)
    with database.reading() as connection:
        assert connection.scalars(text("SELECT day FROM bookings")).all() == [7]
    database.dispose()
    assert rows_of(here) == before


def test_another_programs_database_with_a_table_of_the_same_name_is_left_alone(
    here: Settings, tmp_path: Path, new_database_url: Callable[[], str]
) -> None:
    back_up(here, tmp_path / "backup.zip")
    there = Settings(data_dir=tmp_path / "there", database_url=new_database_url())
    database = open_database(there.url)
    with database.writing() as connection:
        connection.execute(text("CREATE TABLE session (cookie INTEGER)"))
    with pytest.raises(ValueError, match=r"session.*database of its own"):
        restore(there, tmp_path / "backup.zip", replace=True)
    with database.reading() as connection:
        assert connection.scalars(text("SELECT cookie FROM session")).all() == []
    database.dispose()


@pytest.mark.slow
@on_sqlite
def test_people_and_tokens_are_not_dropped_unless_one_says_so(
    here: Settings, tmp_path: Path, new_database_url: Callable[[], str]
) -> None:
    back_up(here, tmp_path / "backup.zip")
    there = Settings(data_dir=tmp_path / "there", database_url=new_database_url())
    manage.upgrade_database(there)
    manage.set_up_path(there)  # nobody has used it yet
    restore(there, tmp_path / "backup.zip")
    database = open_database(there.url)
    with database.writing() as connection:
        for table in reversed(metadata.sorted_tables):
            connection.execute(delete(table))
    database.dispose()
    manage.add_experimenter(there, "Eva Example")
    manage.add_token(there, "tests")
    with pytest.raises(ValueError, match=r"holds 1 experimenter, 1 token, 2 entries of the audit log.*--replace"):
        restore(there, tmp_path / "backup.zip")
    restore(there, tmp_path / "backup.zip", replace=True)
    assert rows_of(there) == rows_of(here)


@pytest.mark.slow
@on_sqlite
def test_a_damaged_backup_changes_nothing(here: Settings, tmp_path: Path) -> None:
    back_up(here, tmp_path / "backup.zip")
    with ZipFile(tmp_path / "backup.zip") as whole, ZipFile(tmp_path / "damaged.zip", "w") as damaged:
        for name in whole.namelist():
            content = whole.read(name)
            damaged.writestr(name, content.replace(b"vote 3", b"vote X") if "vote.jsonl" in name else content)
    before = rows_of(here)
    with pytest.raises(ValueError, match="rows of vote are not those"):
        restore(here, tmp_path / "damaged.zip", replace=True)
    assert rows_of(here) == before
    (tmp_path / "no.zip").write_bytes(b"something else")
    with pytest.raises(ValueError, match="is not a backup"):
        restore(here, tmp_path / "no.zip")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"tables/vote.jsonl": None}, "the rows of vote are missing"),
        ({"backup.json": b"{"}, "backup.json is not readable as JSON"),
        ({"backup.json": b"[1]"}, "backup.json lists no tables"),
        ({"tables/session.jsonl": b'{"id": 1}\n'}, "the rows of session are not those"),
        ({"tables/session.jsonl": b"[1]\n"}, "the rows of session are not those"),
    ],
)
def test_a_backup_that_is_not_whole_is_named_with_what_is_wrong(
    tmp_path: Path, change: dict[str, bytes | None], complaint: str
) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    manage.add_experimenter(settings, "Ada")
    back_up(settings, tmp_path / "backup.zip")
    with ZipFile(tmp_path / "backup.zip") as whole, ZipFile(tmp_path / "changed.zip", "w") as changed:
        for name in whole.namelist():
            if (content := change.get(name, whole.read(name))) is not None:
                changed.writestr(name, content)
    with pytest.raises(ValueError, match=rf"changed\.zip: {re.escape(complaint)}"):
        restore(settings, tmp_path / "changed.zip", replace=True)
    assert [person["name"] for person in manage.list_experimenters(settings)] == ["Ada"]


@pytest.mark.slow
def test_whatever_byte_of_a_backup_is_damaged_the_refusal_says_so(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    manage.upgrade_database(settings)
    back_up(settings, tmp_path / "backup.zip")
    content = bytearray((tmp_path / "backup.zip").read_bytes())
    at = content.rindex(b"PK\x01\x02")  # of the last entry, backup.json: what a reader of the archive goes by
    for offset, value in ((6, 99), (8, 1), (10, 77), (46, ord("X"))):  # version, encryption, compression, name
        damaged = content.copy()
        damaged[at + offset] = value
        (tmp_path / "damaged.zip").write_bytes(damaged)
        with pytest.raises(ValueError, match=r"damaged\.zip: (is damaged|is not a backup|holds no backup\.json)"):
            restore(settings, tmp_path / "damaged.zip")


@pytest.mark.slow
def test_a_backup_replaces_an_earlier_one_and_no_other_file(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    manage.add_experimenter(settings, "Ada")
    backup = tmp_path / "nightly.zip"
    backup.touch()  # as mktemp makes it
    assert back_up(settings, backup)["replaced"] is True
    manage.add_experimenter(settings, "Eva")
    assert back_up(settings, backup)["replaced"] is True
    assert back_up(settings, tmp_path / "other.zip")["replaced"] is False
    (tmp_path / "notes.txt").write_text("of the study")
    for name in ("notes.txt", "data/study.sqlite", "data"):
        with pytest.raises(ValueError, match="is there and is no backup"):
            back_up(settings, tmp_path / name)
    assert (tmp_path / "notes.txt").read_text() == "of the study"
    there = Settings(data_dir=tmp_path / "there")
    restore(there, backup)
    assert [person["name"] for person in manage.list_experimenters(there)] == ["Ada", "Eva"]


@pytest.mark.slow
@pytest.mark.parametrize("address", ["sqlite+pysqlite:///{}", "sqlite:///{}?timeout=5"])
def test_a_database_is_found_by_any_address_that_sqlite_takes(tmp_path: Path, address: str) -> None:
    settings = Settings(data_dir=tmp_path, database_url=address.format(tmp_path / "elsewhere.sqlite"))
    manage.upgrade_database(settings)
    manage.add_experimenter(settings, "Ada")
    assert back_up(settings, tmp_path / "backup.zip")["tables"]["experimenter"] == 1
    assert check(settings)["faults"] == []


@pytest.mark.slow
def test_a_backup_is_not_replaced_by_that_of_an_empty_database(tmp_path: Path) -> None:
    """Who types `backup` for `restore` on a new server keeps what there is to restore."""
    settings, new = Settings(data_dir=tmp_path / "data"), Settings(data_dir=tmp_path / "new")
    manage.add_experimenter(settings, "Ada")
    back_up(settings, tmp_path / "backup.zip")
    assert manage.set_up_path(new) is not None  # a server has started
    with pytest.raises(ValueError, match="is a backup, and the database is empty"):
        back_up(new, tmp_path / "backup.zip")
    restore(new, tmp_path / "backup.zip")
    assert [person["name"] for person in manage.list_experimenters(new)] == ["Ada"]


@pytest.mark.parametrize("name", ["media/", "media/..", "media/../votes.mp4", "media/a\\b.mp4", "media/.hidden.mp4"])
def test_a_video_whose_name_is_a_path_is_refused(tmp_path: Path, name: str) -> None:
    with ZipFile(tmp_path / "backup.zip", "w") as archive:
        archive.writestr(name, b"")
    settings = Settings(data_dir=tmp_path / "server")
    with pytest.raises(ValueError, match=r"holds a video named .*, expected plain names"):
        restore(settings, tmp_path / "backup.zip")
    assert not settings.media_dir.exists()


@pytest.mark.slow
@on_sqlite
def test_a_backup_with_a_damaged_film_changes_nothing(here: Settings, tmp_path: Path) -> None:
    film = here.media_dir / "file.mp4"
    film.parent.mkdir(parents=True)
    film.write_bytes(b"what the film was then")
    back_up(here, tmp_path / "backup.zip", with_media=True)
    content = (tmp_path / "backup.zip").read_bytes()
    (tmp_path / "damaged.zip").write_bytes(content.replace(b"what the film was then", b"what the film was thex"))
    film.write_bytes(b"what the film is now")
    database = open_database(here.url)
    with database.writing() as connection:
        connection.execute(delete(vote))
    database.dispose()
    before = rows_of(here)
    with pytest.raises(ValueError, match=r"is damaged.*file\.mp4"):
        restore(here, tmp_path / "damaged.zip", replace=True)
    assert rows_of(here) == before
    assert files_below(here.media_dir) == {"file.mp4": b"what the film is now"}
    with pytest.raises(ValueError, match="--replace"):
        restore(here, tmp_path / "backup.zip")
    assert files_below(here.media_dir) == {"file.mp4": b"what the film is now"}
    restore(here, tmp_path / "backup.zip", replace=True)
    assert files_below(here.media_dir) == {"file.mp4": b"what the film was then"}


@pytest.mark.slow
def test_a_restore_gives_way_to_what_the_server_has_begun(tmp_path: Path, postgres: PostgresServer) -> None:
    settings = Settings(data_dir=tmp_path / "here", database_url=postgres.new_database("in_use"))
    manage.upgrade_database(settings)
    database = open_database(settings.url)
    seed_voters(database, 1, 2)
    back_up(settings, tmp_path / "backup.zip")
    waits = text("SELECT count(*) FROM pg_locks WHERE NOT granted AND mode = 'AccessExclusiveLock'")
    with ThreadPoolExecutor(1) as pool:
        with database.writing() as connection:
            connection.execute(update(trial).values(void_reason="here"))
            restored = pool.submit(restore, settings, tmp_path / "backup.zip", replace=True)
            with database.reading() as looking:
                looking = looking.execution_options(isolation_level="AUTOCOMMIT")
                while not looking.scalar(waits):
                    assert not restored.done()
            connection.execute(text("UPDATE study SET name = 'Other'"))  # which the restore has taken by then
            connection.execute(text("UPDATE vote SET choice = 'a'"))
        assert restored.result()["tables"]["study"] == 1
    with database.reading() as connection:
        assert connection.scalar(text("SELECT name FROM study")) == "Test"
    database.dispose()


def files_below(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_videos_travel_with_a_backup_and_are_checked(stimulus_set: Path, tmp_path: Path) -> None:
    here, there = (Settings(data_dir=tmp_path / name) for name in ("here", "there"))
    create.create_study(here, stimulus_set, "Whole")
    assert check(here) == {
        "faults": [],
        "videos": 12,
        "attached": 0,
    }  # a film of both halves for six pairs, and six single ones
    report = tmp_path / "report"
    report.mkdir()
    (report / "report.json").write_text('{"kind": "sphere", "measures": []}', encoding="utf-8")
    (report / "curve.csv").write_text("threshold\n1\n", encoding="utf-8")
    manage.attach_results(here, [report, small_models.write_folder(tmp_path / "models")])
    assert modes_of_attached(here) == {0o700}, "before a server has ever run"
    saved = back_up(here, tmp_path / "backup.zip", with_media=True)
    assert (saved["videos"], saved["attached"]) == (12, 5)
    assert restore(there, tmp_path / "backup.zip")["missing_videos"] == 0
    assert modes_of_attached(there) == {0o700}
    for folder in ("reports", "models"):
        assert files_below(there.data_dir / folder) == files_below(here.data_dir / folder) != {}
    assert check(there) == {"faults": [], "videos": 12, "attached": 5}
    first, second, *_ = sorted(there.media_dir.glob("*.mp4"))
    first.unlink()
    second.write_bytes(b"")
    assert check(there)["faults"] == [f"{first}: is missing", f"{second}: is not the file that was prepared"]
    with pytest.raises(ValueError, match=r"is missing.*`reconstudy db check` names all .*without --media"):
        back_up(there, tmp_path / "backup.zip", with_media=True)
    assert restore(there, tmp_path / "backup.zip", replace=True)["videos"] == 12, "the earlier backup is still there"
    assert check(there)["faults"] == []
    shutil.rmtree(next((there.data_dir / "reports").iterdir()))
    with pytest.raises(ValueError, match=r"reports.*is missing.*`reconstudy db check` names all"):
        back_up(there, tmp_path / "other.zip", with_media=True)
    assert not (tmp_path / "other.zip").exists()


@pytest.mark.slow
@on_sqlite
def test_attached_models_and_reports_are_checked(here: Settings, tmp_path: Path) -> None:
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "report.json").write_text('{"kind": "sphere", "measures": []}', encoding="utf-8")
    (tmp_path / "report" / "curve.csv").write_text("threshold\n1\n", encoding="utf-8")
    models = small_models.write_folder(tmp_path / "models")
    for old, new in (("id_fa", "a_0"), ("pm_fb", "a_1")):
        for path in models.rglob(f"{old}.ply"):
            path.rename(path.with_stem(new))
    manage.attach_results(here, [tmp_path / "report", models])
    video = f"{here.media_dir / 'file.mp4'}: is missing"  # of a study in name only
    assert check(here) == {"faults": [video], "videos": 1, "attached": 5}
    first, second, *_ = sorted((here.data_dir / "models").iterdir())
    first.unlink()
    second.write_bytes(second.read_bytes() + b"x")
    (report,) = (here.data_dir / "reports").iterdir()
    (report / "curve.csv").write_text("threshold\n2\n", encoding="utf-8")
    assert check(here)["faults"] == [
        video,
        f"{first}: is missing",
        f"{second}: is not the file that was attached",
        f"{report}: is not the report that was attached",
    ]


@on_sqlite
def test_contradictions_are_found(here: Settings) -> None:
    database = open_database(here.url)
    with database.writing() as connection:
        connection.execute(update(session).values(stage="finished"))
        connection.execute(update(trial).where(trial.c.id == 1).values(voided_at=NOW))
        connection.execute(update(pair).values(file="file.mp4"))
    database.dispose()
    faults = check(here)["faults"]
    assert "1 votes on trials that were interrupted" in faults
    assert "1 finished sessions with trials without a vote" in faults


@on_sqlite
def test_a_preview_that_skipped_its_trials_is_no_fault(here: Settings) -> None:
    with open_store(here) as database:
        with database.reading() as connection:
            study = study_by_id(connection, 1)
        assert study is not None
        begin_preview(database, study, NOW, "finished")
    assert not [fault for fault in check(here)["faults"] if "finished" in fault]


def test_only_their_owner_reads_the_database_and_its_backup(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", database_url=None)
    open_store(settings).dispose()
    back_up(settings, tmp_path / "backup.zip")
    files = [*(tmp_path / "data").glob("study.sqlite*"), tmp_path / "backup.zip"]
    assert len(files) >= 2
    assert {file.stat().st_mode & 0o077 for file in files} == {0}
