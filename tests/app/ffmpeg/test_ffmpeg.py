"""A damaged film is never taken for a whole one, and what is wrong with it is said in words of its owner."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import pytest

from app import ffmpeg
from app.errors import StimuliError
from app.ffmpeg import CUT_OFF, DAMAGED, decode
from tests.app.tiny_stimuli import encode, flat

TORN = """#!/bin/sh
case "$*" in
*level+info*) cat "$0.log" >&2; printf '#tb 0: 1/25\\n#dimensions 0: 64x48\\n0, 0, 0, 1, 4608, 0x0\\n' ;;
*) echo '[in#0/matroska,webm @ 0x1] [error] File ended prematurely' >&2 ;;
esac
"""
LOG = """[info]   Stream #0:0: Video: ffv1, yuv420p, 64x48, 25 fps
[info] Stream mapping:
[Parsed_showinfo_1 @ 0x2] [info] n:   0 pts:      0 fmt:yuv420p cl:left sar:1/1 s:64x48 i:P iskey:1 type:I {}
[Parsed_showinfo_1 @ 0x2] [info] color_range:tv color_space:bt709 color_primaries:bt709 color_trc:bt709
"""


def with_a_gap(content: bytes) -> bytes:
    at = content.index(b"mdat") + 1200  # behind what the encoder says of itself
    return content[:at] + bytes(200) + content[at + 200 :]


def test_a_fault_within_another_line_of_the_log_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program, film = tmp_path / "ffmpeg", tmp_path / "film.mkv"
    program.write_text(TORN, encoding="utf-8")
    program.chmod(0o755)
    film.write_bytes(b"film")
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: str(program))
    (tmp_path / "ffmpeg.log").write_text(LOG.format(""), encoding="utf-8")
    assert decode(film).n_frames == 1
    (tmp_path / "ffmpeg.log").write_text(LOG.format("File ended prematurely"), encoding="utf-8")
    with pytest.raises(StimuliError, match=re.escape(CUT_OFF)):
        decode(film)


@pytest.mark.parametrize("options", [("-c:v", "libx264"), ("-c:v", "ffv1", "-qp", "-1")], ids=["H.264", "FFV1"])
def test_a_usual_film_is_decoded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    encode(tmp_path / "film.mkv", flat("gray"), *options)
    monkeypatch.setattr(ffmpeg, "run_ffmpeg", lambda *_: pytest.fail("decoded again"))
    decode(tmp_path / "film.mkv")


@pytest.mark.parametrize(
    ("name", "spoil", "why"),
    [
        ("film.mp4", lambda content: content[:100], CUT_OFF),
        ("film.mkv", lambda content: content[:-60], CUT_OFF),
        ("film.mp4", lambda _: b"<html>not found</html>", CUT_OFF),
        ("film.mp4", lambda _: b"", "is empty (0 bytes)"),
        ("film.mp4", lambda content: content.replace(b"avc1", b"zzz1"), "its codec is not known here"),
        ("film.mp4", with_a_gap, DAMAGED),
    ],
    ids=["beginning", "no end", "page", "empty", "codec", "middle"],
)
def test_what_is_wrong_with_a_film_is_said_without_ffmpegs_words(
    tmp_path: Path, name: str, spoil: Callable[[bytes], bytes], why: str
) -> None:
    path = tmp_path / name
    encode(path, "testsrc2=size=64x48:rate=25")
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(StimuliError, match=re.escape(why)) as refusal:
        decode(path)
    assert not re.search("moov|EBML|NAL|prematurely|Truncating|decoder found", str(refusal.value))
