"""Small files that ask for very much are refused by a sentence, before they take the memory or the time."""

from __future__ import annotations

import io
import json
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import cv2
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from app.analysis.reading.files import tabular
from app.analysis.reading.read_votes import read_votes
from app.errors import InvalidError, TooLargeError
from app.ffmpeg import decode, reading
from app.files import LARGEST_JSON, read_json
from app.films.strips import write_picture
from app.intake import bounds
from app.intake.bounds import in_bounds
from app.intake.models import read_model as read_attached_model
from app.intake.reports import read_report
from app.intake.zips import MOST_FILES, check_zip, unpack
from app.operations.jobs.command import needed_environment
from recon.models.read import Placement, read_model
from tests.app.tiny_stimuli import encode, flat

pytestmark = pytest.mark.slow

MB = 1024 * 1024
LARGEST_MB = 32
ENDS_WITHIN_S = 30
AS_IT_IS = Placement("mm", ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)), 2.0)


def zipped(path: Path, files: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


@pytest.mark.parametrize(
    ("files", "method", "complaint"),
    [
        ({"report.json": b" " * (LARGEST_JSON + 1)}, zipfile.ZIP_STORED, "report.json unpacks to 16.0 MB, far more"),
        ({"a.csv": b"0" * 3 * MB}, zipfile.ZIP_DEFLATED, "a.csv unpacks to 3.0 MB, far more"),
        ({"a.csv": b"0"}, zipfile.ZIP_LZMA, "packed by another method than Deflate"),
        (
            {f"{n}.csv": b"" for n in range(MOST_FILES + 1)},
            zipfile.ZIP_STORED,
            f"holds {MOST_FILES + 1} files; expected",
        ),
        (
            {f"{n}.csv": b"0" * MB for n in range(LARGEST_MB + 1)},
            zipfile.ZIP_DEFLATED,
            f"unpacks to {LARGEST_MB + 1} MB",
        ),
        ({f"{n}.csv": b"0" * MB for n in range(30)}, zipfile.ZIP_DEFLATED, "unpacks to far more than it may"),
    ],
)
def test_an_archive_that_unpacks_to_far_too_much_is_refused(
    tmp_path: Path, files: dict[str, bytes], method: int, complaint: str
) -> None:
    packed = zipped(tmp_path / "packed.zip", files, method)
    with pytest.raises((InvalidError, TooLargeError), match=complaint):
        receive(packed, tmp_path / "out")


def test_an_archive_that_says_to_unpack_to_more_than_the_disk_has_free_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = zipped(tmp_path / "packed.zip", {"a.csv": b"0" * 3 * MB}, zipfile.ZIP_STORED)
    monkeypatch.setattr("shutil.disk_usage", lambda _path: SimpleNamespace(free=2 * MB))
    with pytest.raises(TooLargeError, match="unpacks to 3 MB; the server's disk has 2 MB free"):
        receive(packed, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("names", [("a.csv", "a.csv"), ("a.csv", "a.csv/b.csv")])
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_name_that_is_twice_in_an_archive_is_named_without_a_path_on_the_server(
    tmp_path: Path, names: tuple[str, ...]
) -> None:
    with zipfile.ZipFile(tmp_path / "packed.zip", "w") as archive:
        for name in names:
            archive.writestr(name, "x")
    with pytest.raises(InvalidError, match=f"^{names[1]} is in the zip file twice"):
        receive(tmp_path / "packed.zip", tmp_path / "out")


def test_a_name_that_is_not_in_utf_8_and_a_newer_kind_of_zip_are_refused(tmp_path: Path) -> None:
    packed = tmp_path / "packed.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("ü.csv", "x")
    whole = packed.read_bytes()
    directory = whole.find(b"PK\x01\x02")
    name = whole.rfind("ü".encode())
    for at, instead in ((name, b"\xff\xfe"), (directory + 6, b"\x63")):
        packed.write_bytes(whole[:at] + instead + whole[at + len(instead) :])
        with pytest.raises(InvalidError, match=r"The zip file cannot be read: .*Pack it again"):
            receive(packed, tmp_path / "out")


def receive(packed: Path, out: Path) -> None:
    check_zip(packed, LARGEST_MB)
    unpack(packed, out, LARGEST_MB * MB, (".csv", ".json"), "results")


def test_what_takes_too_much_memory_or_time_ends_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "report.json").write_bytes(b'{"measures": [' + b"[]," * 400_000 + b"1]}")
    monkeypatch.setattr(bounds, "MOST_MB", 64)
    with pytest.raises(TooLargeError, match="more than 64 MB of memory"):
        in_bounds(read_report, tmp_path / "report.json")
    monkeypatch.setattr(bounds, "LONGEST_S", 1)
    with pytest.raises(TooLargeError, match="1 s of computing"):
        in_bounds(sum, range(10**12))
    with pytest.raises(ValueError, match="there is no such report"):
        in_bounds(read_report, tmp_path / "none")


def test_a_reader_ends_with_its_server_however_that_ends() -> None:
    reads = "import time; print('reads', flush=True); time.sleep(600)"
    program = f"from app.intake.bounds import in_bounds; in_bounds(exec, {reads!r})"
    server = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    assert server.stdout.readline() == "reads\n"
    server.kill()
    server.communicate(timeout=ENDS_WITHIN_S)  # the output ends when nobody is left who could write


def png(width: int, height: int) -> bytes:
    """A picture of one colour whose header says how large it is."""
    parts = ((b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)), (b"IDAT", zlib.compress(bytes(4096))))
    chunks = [struct.pack(">I", len(data)) + kind + data + zlib.crc32(kind + data).to_bytes(4) for kind, data in parts]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks) + b"\0\0\0\0IEND\xaeB`\x82"


def ply(n_points: int) -> bytes:
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {n_points}\n"
    return header.encode() + b"property float x\nproperty float y\nproperty float z\nend_header\n" + bytes(36)


def glb(n_points: int, length: int = 0) -> bytes:
    """A GLB whose accessor, or whose header, promises more than there is."""
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": n_points, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", 36) + b"BIN\0" + bytes(36)
    return b"glTF" + struct.pack("<II", 2, length or 12 + len(chunks)) + chunks


def crowd(n: int) -> bytes:
    """A glTF model in which so many nodes have a mesh of so many parts."""
    document = json.loads(glb(3)[20:].partition(b"BIN\0")[0][:-4])
    document["nodes"] *= n
    document["scenes"] = [{"nodes": list(range(n))}]
    document["meshes"][0]["primitives"] *= n
    return json.dumps(document).encode()


def runs(n: int = 2_000_000) -> bytes:
    """A Parquet file of so many equal numbers, which has a few kilobytes."""
    file = io.BytesIO()
    pq.write_table(pa.table({"participant": pa.repeat(pa.scalar(1, pa.int8()), n)}), file)
    return file.getvalue()


def sheet() -> bytes:
    """An Excel file that unpacks to more than it may."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet1.xml", b" " * 3 * MB)
    return file.getvalue()


BOMBS: dict[str, tuple[Callable[[Path], object], Callable[[], bytes], str]] = {
    "points.ply": (lambda path: read_attached_model(path, "cloud"), lambda: ply(10**9), "no whole PLY"),
    "model.ply": (lambda path: read_model(path, AS_IT_IS), lambda: ply(10**9), "promises 1000000000 rows"),
    "count.glb": (lambda path: read_model(path, AS_IT_IS), lambda: glb(10**9), "promises 1000000000 values"),
    "length.glb": (lambda path: read_model(path, AS_IT_IS), lambda: glb(3, 2**31), "is cut off"),
    "crowd.gltf": (lambda path: read_model(path, AS_IT_IS), lambda: crowd(400), "shows 160000 parts, expected at most"),
    "photo.png": (
        lambda path: write_picture(path, path.with_suffix(".jpg"), frame=0, width=240),
        lambda: png(100_000, 100_000),
        "cannot be shown",
    ),
    "large.png": (
        lambda path: write_picture(path, path.with_suffix(".jpg"), frame=0, width=240),
        lambda: png(20_000, 20_000),
        "cannot be shown",
    ),
    "runs.parquet": (read_votes, runs, "more than 1 million cells"),
    "votes.xlsx": (read_votes, sheet, "unpacks to more than 1 MB"),
    "wide.csv": (read_votes, lambda: b",".join(b"%d" % n for n in range(60_000)), "has 60000 columns, expected 20000"),
    "word.csv": (read_votes, lambda: b"x" * 200_000 + b",y\n1,2\n", "its header holds a name of more than 131072"),
    "names.csv": (read_votes, lambda: b",".join(b"%d" % n for n in range(2_000)), "37, 38, 39 and 1960 more"),
    "deep.json": (read_json, lambda: b"[" * 200_000, "too many lists within one another"),
    "large.json": (read_json, lambda: b" " * (LARGEST_JSON + 1), "has 16.0 MB, expected 16 MB at most"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_file_that_promises_too_much_is_named_in_a_sentence(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tabular, "MOST_UNPACKED", MB)
    monkeypatch.setattr(tabular, "MOST_CELLS", 10**6)
    read, content, complaint = BOMBS[name]
    (tmp_path / name).write_bytes(content())
    with pytest.raises(ValueError, match=complaint) as refusal:
        read(tmp_path / name)
    assert name in str(refusal.value)


@pytest.mark.parametrize("place", ["/etc/hostname", "../../study.sqlite"])
def test_a_model_names_no_files_of_others(tmp_path: Path, place: str) -> None:
    (tmp_path / "study.sqlite").write_bytes(bytes(36))
    folder = tmp_path / "models" / "pm"
    folder.mkdir(parents=True)
    document = json.loads(glb(3)[20:].partition(b"BIN\0")[0][:-4]) | {"buffers": [{"byteLength": 36, "uri": place}]}
    (folder / "ball.gltf").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(ValueError, match=f"its buffer {place} lies elsewhere"):
        read_model(folder / "ball.gltf", AS_IT_IS)


def test_a_playlist_that_calls_itself_a_film_leads_nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    film, playlist = tmp_path / "film.mp4", tmp_path / "list.mp4"
    encode(film, flat("gray"))
    assert decode(film).n_frames > 0
    hls = f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{film}\n#EXT-X-ENDLIST\n"
    for content in (hls, "ffconcat version 1.0\nfile film.mp4\n"):
        playlist.write_text(content, encoding="utf-8")
        with pytest.raises(ValueError, match="cannot be decoded as a video"):
            decode(playlist)
    for name, value in needed_environment().items():  # a job's, for OpenCV
        monkeypatch.setenv(name, value)
    assert [cv2.VideoCapture(str(path)).isOpened() for path in (film, playlist)] == [True, False]
    with pytest.raises(ValueError, match=r"ends in \.m3u8, expected one of \.mp4"):
        reading(tmp_path / "list.m3u8")
