from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.capture import images
from recon.capture.images import CaptureError, is_video, read_image, read_video_frame

N_FRAMES = 8
SIZE = (64, 48)


def grey_of(frame: int) -> int:
    return 20 + 25 * frame


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A lossless video whose frame n has the colour (grey_of(n), 0, 50)."""
    path = tmp_path_factory.mktemp("video") / "left.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"FFV1"), 25.0, SIZE)
    for frame in range(N_FRAMES):
        writer.write(np.full((SIZE[1], SIZE[0], 3), (50, 0, grey_of(frame)), dtype=np.uint8))
    writer.release()
    yield path
    images._open_video.cache_clear()


@given(st.lists(st.integers(0, N_FRAMES - 1), min_size=1, max_size=12))
@settings(deadline=None, max_examples=25)
def test_a_video_frame_is_the_same_in_whatever_order_frames_are_read(video: Path, order: list[int]) -> None:
    for frame in order:
        pixels = read_video_frame(video, frame)
        assert pixels.shape == (SIZE[1], SIZE[0], 3)
        assert np.abs(pixels[0, 0].astype(int) - (grey_of(frame), 0, 50)).max() <= 3


def test_frames_in_order_are_decoded_once_each(video: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images._open_video.cache_clear()
    opened: list[CountingDecoder] = []
    decode = cv2.VideoCapture

    class CountingDecoder:
        def __init__(self, path: str, backend: int) -> None:
            self.decoder, self.calls = decode(path, backend), []
            opened.append(self)

        def __getattr__(self, name: str) -> object:
            self.calls.append(name)
            return getattr(self.decoder, name)

    monkeypatch.setattr(images.cv2, "VideoCapture", CountingDecoder)
    for frame in range(0, N_FRAMES, 2):
        read_video_frame(video, frame)
    (decoder,) = opened
    calls = [call for call in decoder.calls if call in ("grab", "read")]
    assert calls == ["read", *["grab", "read"] * (N_FRAMES // 2 - 1)]


def test_a_video_that_is_too_short_says_how_long_it_is(video: Path) -> None:
    for _ in range(2):
        with pytest.raises(
            CaptureError, match=f"left.avi: ends after {N_FRAMES} frames, frame {N_FRAMES + 1} was asked for"
        ):
            read_video_frame(video, N_FRAMES + 1)
    assert read_video_frame(video, 1)[0, 0, 2] == pytest.approx(50, abs=3)


def test_a_video_that_cannot_be_decoded_or_is_missing_is_named(tmp_path: Path) -> None:
    path = tmp_path / "left.mp4"
    with pytest.raises(CaptureError, match=f"{path}: there is no such video"):
        read_video_frame(path, 0)
    path.write_bytes(b"this is no video" * 100)
    with pytest.raises(CaptureError, match=f"{path}: is not a video that can be decoded"):
        read_video_frame(path, 0)


def test_a_video_that_was_replaced_is_read_anew(video: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.avi"
    copy.write_bytes(video.read_bytes())
    read_video_frame(copy, 0)
    copy.write_bytes(b"x" * 10)
    with pytest.raises(CaptureError, match="decoded"):
        read_video_frame(copy, 0)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("share", [0.0, 0.001, 0.002, 0.3, 0.7, 0.98])
def test_an_image_that_is_cut_off_is_never_read_as_whole(tmp_path: Path, suffix: str, share: float) -> None:
    path = tmp_path / f"whole{suffix}"
    cv2.imwrite(str(path), np.random.default_rng(0).integers(0, 255, (48, 64, 3), dtype=np.uint8))
    assert read_image(path).shape == (48, 64, 3)
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(CaptureError, match=str(path)):
        read_image(path)


def test_a_png_whose_part_announces_more_than_the_file_is_refused_without_room_for_it(tmp_path: Path) -> None:
    path = tmp_path / "damaged.png"
    content = bytearray(cv2.imencode(".png", np.zeros((4, 5, 3), np.uint8))[1].tobytes())
    content[content.index(b"IDAT") - 4] = 0xFF  # of the length: four gigabytes
    path.write_bytes(content)
    with pytest.raises(CaptureError, match="before the end of its picture, or damaged"):
        read_image(path)


def head_of(suffix: str, width: int, height: int) -> bytes:
    """Return a small picture whose head announces another size."""
    small = cv2.imencode(suffix, np.zeros((8, 8, 3), np.uint8))[1].tobytes()
    if suffix == ".png":
        head = b"IHDR" + struct.pack(">II", width, height) + small[24:29]
        return small[:12] + head + struct.pack(">I", zlib.crc32(head)) + small[33:]
    if suffix == ".jpg":
        return small.replace(struct.pack(">HH", 8, 8), struct.pack(">HH", height, width), 1)
    if suffix == ".bmp":
        return small[:18] + struct.pack("<ii", width, height) + small[26:]
    if suffix == ".tif":
        file = BytesIO()
        tifffile.imwrite(file, np.zeros((8, 8), np.uint8))
        whole = file.getvalue()
        for tag, value in ((256, width), (257, height)):
            start = struct.pack("<HHI", tag, 4, 1)
            whole = whole.replace(start + struct.pack("<I", 8), start + struct.pack("<I", value))
        return whole
    return b"P6 %d %d 255 \0" % (width, height)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".tif", ".ppm"])
@pytest.mark.parametrize("size", [(30_000, 20_000), (16_384, 16_385)])
def test_a_small_file_that_announces_very_many_pixels_is_refused_before_they_get_room(
    tmp_path: Path, suffix: str, size: tuple[int, int]
) -> None:
    path = tmp_path / f"huge{suffix}"
    path.write_bytes(head_of(suffix, *size))
    with pytest.raises(CaptureError, match=rf"huge\{suffix}: .*{size[0]}x{size[1]} pixels"):
        read_image(path)


def test_a_missing_image_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"a.png: there is no such image"):
        read_image(tmp_path / "a.png")
    (tmp_path / "b.png").mkdir()
    with pytest.raises(CaptureError, match=r"b.png: cannot be read: Is a directory"):
        read_image(tmp_path / "b.png")


def test_an_orientation_tag_does_not_turn_the_image_away_from_its_calibration(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    cv2.imwrite(str(path), np.zeros((48, 64, 3), dtype=np.uint8))
    entry = struct.pack(">HHIHH", 0x0112, 3, 1, 6, 0)  # tag, type short, count, "turned by a quarter", padding
    exif = b"Exif\0\0MM" + struct.pack(">HIH", 42, 8, 1) + entry + bytes(4)
    quarter_turn = b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif
    content = path.read_bytes()
    path.write_bytes(content[:2] + quarter_turn + content[2:])
    assert cv2.imread(str(path)).shape == (64, 48, 3)
    assert read_image(path).shape == (48, 64, 3)


def test_videos_are_told_by_their_name() -> None:
    assert is_video("S1/Left.MP4")
    assert not is_video("S1/left/{frame:04d}.png")


def test_a_jpeg_may_end_before_its_file_does_but_not_in_its_thumbnail_alone(tmp_path: Path) -> None:
    picture = np.random.default_rng(1).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    encoded = cv2.imencode(".jpg", picture)[1].tobytes()
    thumbnail = b"\xff\xe1" + (len(encoded) + 2).to_bytes(2, "big") + encoded
    whole = encoded[:2] + thumbnail + encoded[2:]
    (tmp_path / "phone.jpg").write_bytes(whole + b"\0\0appended film")
    assert read_image(tmp_path / "phone.jpg").shape == (48, 64, 3)
    (tmp_path / "cut.jpg").write_bytes(whole[:-100])
    with pytest.raises(CaptureError, match="is cut off"):
        read_image(tmp_path / "cut.jpg")


def test_fill_bytes_before_a_jpegs_segments_do_not_make_it_cut_off(tmp_path: Path) -> None:
    encoded = cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()
    filled = encoded[:2] + b"\xff\xff\xff" + encoded[2:]  # as ITU-T T.81, B.1.1.2 allows before any marker
    (tmp_path / "filled.jpg").write_bytes(filled)
    assert (read_image(tmp_path / "filled.jpg") == 90).all()
    (tmp_path / "cut.jpg").write_bytes(filled[:-2])
    with pytest.raises(CaptureError, match="is cut off"):
        read_image(tmp_path / "cut.jpg")


def test_of_16_bits_the_upper_8_are_taken(tmp_path: Path) -> None:
    picture = np.random.default_rng(1).integers(0, 256, (12, 16, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "full.png"), picture[..., ::-1].astype(np.uint16) * 257)
    assert np.array_equal(read_image(tmp_path / "full.png"), picture)


@pytest.mark.parametrize("bits", [8, 10, 12])
@pytest.mark.parametrize("n_channels", [1, 3, 4])
def test_bits_of_a_camera_in_the_lower_ones_of_16_are_not_taken_for_black(
    tmp_path: Path, bits: int, n_channels: int
) -> None:
    picture = np.random.default_rng(1).integers(0, 2**bits, (12, 16, n_channels)).astype(np.uint16)
    picture[0, 0], picture[..., 3:] = 2**bits - 1, 65535
    cv2.imwrite(str(tmp_path / "raw.png"), picture)
    with pytest.raises(CaptureError, match=rf"raw.png: has 16 bits, but no value above {2**bits - 1}, .*; write"):
        read_image(tmp_path / "raw.png")


def test_an_empty_mask_of_16_bits_is_empty(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "mask.png"), np.zeros((12, 16), np.uint16))
    assert not read_image(tmp_path / "mask.png").any()


def write_exr(path: Path, channels: dict[str, float], **windows: tuple[int, int, int, int]) -> Path:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    corners = {name: (np.array(at[:2], np.int32), np.array(at[2:], np.int32)) for name, at in windows.items()}
    pixels = {name: np.full((6, 8), value, np.float32) for name, value in channels.items()}
    with OpenEXR.File(header | corners, pixels) as file:
        file.write(str(path))
    return path


def test_of_an_exr_with_layers_the_picture_is_read_and_no_other_light(tmp_path: Path) -> None:
    combined = {f"View.Combined.{name}": 1.0 for name in "RGBA"}
    others = {f"View.{layer}.{name}": 0.0 for layer in ("Emit", "Zebra") for name in "RGB"}
    assert (read_image(write_exr(tmp_path / "blender.exr", combined | others)) == 255).all()
    plain = dict.fromkeys("RGB", 1.0)
    assert (read_image(write_exr(tmp_path / "plain.exr", plain | others)) == 255).all()


@pytest.mark.parametrize(
    "channels",
    [
        {f"{view}.{name}": 0.5 for view in ("left", "right") for name in "RGB"},
        {"Y": 0.5, "RY": 0.1, "BY": 0.1},
        {"R": 0.5, "G": 0.5},
    ],
)
def test_an_exr_that_has_not_one_light_is_refused_by_its_channels(tmp_path: Path, channels: dict[str, float]) -> None:
    with pytest.raises(CaptureError, match=r"holds the channels .*, expected light in R, G, B or Y, once"):
        read_image(write_exr(tmp_path / "a.exr", channels))


def test_an_exr_that_is_a_part_of_a_picture_is_refused_by_its_place(tmp_path: Path) -> None:
    windows = {"dataWindow": (2, 1, 9, 6), "displayWindow": (0, 0, 15, 11)}
    with pytest.raises(CaptureError, match=r"shows 8x6 pixels from \(2, 1\) on, which are not its whole picture"):
        read_image(write_exr(tmp_path / "a.exr", dict.fromkeys("RGB", 0.5), **windows))
