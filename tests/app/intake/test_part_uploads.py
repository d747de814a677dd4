"""How far an upload in parts is, and whether its check is under way."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from app.errors import InvalidError
from app.intake.part_uploads import (
    PartUpload,
    Standing,
    appending,
    begin_upload,
    checking,
    note_task,
    standing,
    unfinished,
    work_folder,
)

BALL = PartUpload("b" * 32, "captures", "ball", "ball.zip", 3, by="Eva")
TASK = "/admin/tasks/1"


@pytest.fixture
def complete(tmp_path: Path) -> Path:
    """An intake folder with an upload of which all is there and whose job is noted."""
    begin_upload(tmp_path, BALL)
    with appending(tmp_path, BALL.id, 0) as file:
        file.write(b"zip")
    note_task(tmp_path, BALL, TASK)
    return tmp_path


def facts_of(known: Standing) -> tuple[int, str | None]:
    return known.offset, known.upload.task


@pytest.mark.parametrize("has_unpacked", [False, True])
def test_a_check_whose_process_was_killed_can_be_repeated(complete: Path, has_unpacked: bool) -> None:
    if has_unpacked:
        work_folder(complete, BALL.id).mkdir()
    assert [facts_of(each) for each in unfinished(complete)] == [(3, None)]
    assert facts_of(begin_upload(complete, BALL)) == (3, None)
    with appending(complete, BALL.id, 3):
        pass  # nothing has to be sent again


def test_a_check_under_way_is_told_to_whoever_begins_again(complete: Path) -> None:
    with checking(complete, BALL.id):
        assert facts_of(begin_upload(complete, BALL)) == (3, TASK)
        assert unfinished(complete) == []
    assert facts_of(standing(complete, BALL.id)) == (3, TASK), "whoever asks late is led to the result"
    assert facts_of(begin_upload(complete, BALL)) == (0, None)


@pytest.mark.parametrize(
    ("fault", "n_kept"), [(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), 3), (InvalidError("no zip file"), 0)]
)
def test_a_check_that_fails_keeps_the_file_unless_the_file_is_at_fault(
    complete: Path, fault: Exception, n_kept: int
) -> None:
    with pytest.raises(type(fault)), checking(complete, BALL.id):
        raise fault
    assert facts_of(begin_upload(complete, BALL)) == (n_kept, None)


def test_an_upload_that_could_not_begin_for_want_of_room_begins_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_given: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "touch", full)
        with pytest.raises(OSError, match="No space left"):
            begin_upload(tmp_path, BALL)
    assert facts_of(begin_upload(tmp_path, BALL)) == (0, None), "nothing has arrived"
