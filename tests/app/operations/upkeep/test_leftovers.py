"""A server's start clears away what earlier ones were killed at, and nothing else."""

from __future__ import annotations

import shutil
from datetime import timedelta
from pathlib import Path

import pytest

from app import main
from app.files import WorkFolder, whole_file, whole_folder
from app.intake.part_uploads import PartUpload, begin_upload, checking, standing, work_folder
from app.main import running_server
from app.operations.upkeep.leftovers import LEFT_FOR, remove_leftovers
from app.settings import Settings
from app.store.database.keys import utc_now


def killed_at_work(settings: Settings) -> list[Path]:
    """What is left of films, stills, uploads, models, reports, sets and captures never finished, and of a deletion."""
    left = []
    for folder, name in (("pairs", "ab.mp4"), ("stills", "ab-top.jpg"), ("models", "ab.ply")):
        with whole_file(settings.data_dir / folder / name) as temporary:
            temporary.touch()
        temporary.touch()
        temporary.with_name(name).unlink()
        left.append(temporary)
    for folder in (settings.data_dir / "reports" / "ab", settings.sets_dir / "imported"):
        with whole_folder(folder) as temporary:
            (temporary / "table.csv").touch()
        left.append(folder.rename(temporary))
    for folder in ("stimuli", "uploads"):
        path = settings.data_dir / folder / ".upload-x"
        (path / "unpacked").mkdir(parents=True)
        (path / "unpacked" / "film.mp4").touch()
        left.append(path)
    dying, imported = settings.sets_dir / ".tiny.0a1b2c3d.deleted", settings.intake_dir / "captures/.ball.host-1.part"
    for folder in (dying, imported):
        folder.mkdir(parents=True)
    return [*left, dying, imported]


@pytest.mark.parametrize(("later", "are_there"), [(LEFT_FOR + timedelta(hours=1), False), (timedelta(0), True)])
def test_what_was_left_half_written_a_day_ago_is_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, later: timedelta, are_there: bool
) -> None:
    settings = Settings(data_dir=tmp_path)
    left = killed_at_work(settings)
    kept = [settings.media_dir / "ab.mp4", settings.sets_dir / "tiny" / ".notes.part.txt", tmp_path / ".hidden"]
    kept.append(settings.intake_dir / "captures" / ".ball.partial")  # that somebody copies there by hand
    for path in kept:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    monkeypatch.setattr(main, "utc_now", lambda: utc_now() + later)
    with running_server(settings):
        assert [path.exists() for path in left] == [are_there] * len(left)
    assert all(path.exists() for path in kept)


def test_what_a_killed_upload_unpacked_is_removed_at_the_next_start(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path)
    held = WorkFolder(".upload-", tmp_path / "uploads")
    killed = tmp_path / "uploads" / ".upload-killed"
    shutil.copytree(held.name, killed)  # with a lock that nobody holds
    facts = ("captures", "ball", "ball.zip", 3)
    uploads = {name: PartUpload(name * 32, *facts, by="Eva", task="/admin/tasks/1") for name in "ab"}
    for upload in uploads.values():
        begin_upload(settings.intake_dir, upload)
        work_folder(settings.intake_dir, upload.id).mkdir()
    with checking(settings.intake_dir, uploads["a"].id) as received:
        remove_leftovers(settings, utc_now())
        assert received.is_file()
        assert standing(settings.intake_dir, uploads["a"].id).upload.task == "/admin/tasks/1"
    assert (Path(held.name).is_dir(), killed.exists()) == (True, False)
    assert [work_folder(settings.intake_dir, upload.id).is_dir() for upload in uploads.values()] == [True, False]
    held.cleanup()
