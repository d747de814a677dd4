"""What goes into a video comes out of it, in exactly the frames that were asked for."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from skimage.metrics import structural_similarity

from recon.render.encoding.checked import check_video, holds_checked_frames, write_checked_video
from recon.render.encoding.quality import VideoCheck, luma_of, psnr_of, ssim_of
from recon.render.encoding.video import (
    MASTER,
    Encoding,
    VideoError,
    join_videos,
    probe_video,
    read_luma,
    read_video,
    write_video,
    write_videos,
)

SIZE = (160, 96)


def moving_frames(n: int) -> Iterator[np.ndarray]:
    """A soft gradient with a coloured square that moves."""
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    for k in range(n):
        frame = np.stack([120 + x / 4, 100 + y / 3, 180 - x / 5], axis=2)
        frame[20:50, 10 + k : 60 + k] = (200, 60, 40)
        yield frame.astype(np.uint8)


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "clip.mp4"
    write_video(path, moving_frames(60), size=SIZE, fps=25)
    return path


def packets(path: Path) -> list[str]:
    """One line a packet, as ffmpeg lists them; flags are shown for all but key frames."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-c", "copy", "-f", "framecrc", "-"]
    listed = subprocess.run(command, capture_output=True, check=True, text=True).stdout.splitlines()
    return [line for line in listed if not line.startswith("#")]


def test_a_video_has_exactly_the_frames_asked_for(video: Path) -> None:
    facts = probe_video(video)
    assert (facts.width, facts.height, facts.fps, facts.n_frames, facts.codec) == (*SIZE, 25.0, 60, "h264")
    assert sum(1 for _ in read_video(video)) == 60


@pytest.mark.parametrize("n", [1, 2, 24, 26])
def test_no_frame_is_lost_or_added_around_the_length_of_a_group(n: int, tmp_path: Path) -> None:
    assert write_video(tmp_path / "few.mp4", moving_frames(n), size=SIZE, fps=25).n_frames == n


def test_decoded_frames_are_near_those_that_were_encoded(video: Path) -> None:
    check = check_video(video, moving_frames(60))
    assert check.faults == ()
    assert min(check.psnr_db) > 44
    for before, after in zip(moving_frames(60), read_video(video), strict=True):
        assert np.abs(before[:20].astype(int) - after[:20]).mean() < 2  # colours too, not only luma


def test_a_master_is_nearer_than_what_is_delivered(video: Path, tmp_path: Path) -> None:
    master = tmp_path / "master.mp4"
    write_video(master, moving_frames(60), size=SIZE, fps=25, encoding=MASTER)
    assert min(check_video(master, moving_frames(60)).psnr_db) > max(
        52, min(check_video(video, moving_frames(60)).psnr_db)
    )


def test_the_same_frames_give_the_same_bytes(video: Path, tmp_path: Path) -> None:
    write_video(tmp_path / "again.mp4", moving_frames(60), size=SIZE, fps=25)
    assert (tmp_path / "again.mp4").read_bytes() == video.read_bytes()


def test_groups_are_closed_and_25_frames_long(video: Path) -> None:
    keys = [number for number, line in enumerate(packets(video)) if "F=0x" not in line]
    assert keys == [0, 25, 50]
    assert b"open_gop=0" in video.read_bytes()


def test_the_index_comes_before_the_pictures_and_colours_are_tagged(video: Path) -> None:
    content = video.read_bytes()
    assert content.find(b"moov") < content.find(b"mdat")
    described = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-i", str(video)], capture_output=True, text=True
    ).stderr
    assert re.search(r"yuv420p\(tv, bt709[,)]", described)  # matrix, primaries and transfer: else each has its name


def test_luma_follows_bt709() -> None:
    colours = np.array([[[0, 0, 0], [255, 255, 255], [255, 0, 0], [0, 255, 0], [0, 0, 255]]], dtype=np.uint8)
    assert luma_of(colours).tolist() == [[16, 235, 63, 173, 32]]


def test_stored_luma_is_that_of_flat_frames(tmp_path: Path) -> None:
    grey = np.full((*SIZE[::-1], 3), 100, dtype=np.uint8)
    write_video(tmp_path / "grey.mp4", [grey] * 3, size=SIZE, fps=25)
    for stored in read_luma(tmp_path / "grey.mp4"):
        assert np.abs(stored.astype(int) - luma_of(grey)).max() <= 1


def test_similarity_is_that_of_scikit_image() -> None:
    rng = np.random.default_rng(4)
    image = rng.integers(0, 256, (60, 80), dtype=np.uint8)
    other = np.clip(image + rng.normal(0, 20, image.shape), 0, 255).astype(np.uint8)
    expected = structural_similarity(
        image, other, data_range=255, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    assert ssim_of(image, other) == pytest.approx(expected, abs=1e-4)
    assert ssim_of(image, image) == pytest.approx(1)
    assert psnr_of(image, image) == 100


def test_a_damaged_frame_is_named_by_the_check(video: Path) -> None:
    frames = list(moving_frames(60))
    frames[37] = 255 - frames[37]
    assert any("frame 37" in fault for fault in check_video(video, frames).faults)
    assert VideoCheck((49.0, 47.5), (0.995, 0.995)).faults == ()
    assert len(VideoCheck((47.0, 43.0), (0.98, 0.98)).faults) == 3


@pytest.mark.slow
def test_a_video_and_its_master_are_written_and_checked_in_one_pass(video: Path, tmp_path: Path) -> None:
    asked_for = iter(list(moving_frames(60)))
    master = tmp_path / "master.mp4"
    facts, check = write_checked_video(tmp_path / "one" / "clip.mp4", asked_for, size=SIZE, fps=25, master=master)
    assert (tmp_path / "one" / "clip.mp4").read_bytes() == video.read_bytes()
    assert facts == probe_video(video)
    assert check == check_video(video, moving_frames(60))
    assert min(check_video(master, moving_frames(60)).psnr_db) > 52
    assert sorted(path.name for path in tmp_path.rglob("*.*")) == ["clip.mp4", "master.mp4"]


def test_when_one_of_several_videos_fails_none_is_left(tmp_path: Path) -> None:
    encodings = {tmp_path / "good.mp4": Encoding(18), tmp_path / "bad.mp4": Encoding(-500)}
    with pytest.raises(VideoError, match=r"bad.mp4: could not be encoded"):
        write_videos(encodings, moving_frames(300), size=SIZE, fps=25)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("n", [59, 61])
def test_a_check_refuses_another_number_of_frames(n: int, video: Path) -> None:
    with pytest.raises(VideoError, match=r"clip.mp4: has .* at number"):
        check_video(video, moving_frames(n))


def test_a_video_that_cannot_be_decoded_is_named(video: Path, tmp_path: Path) -> None:
    content = video.read_bytes()
    (tmp_path / "text.mp4").write_text("not a video")
    (tmp_path / "cut.mp4").write_bytes(content[: len(content) * 2 // 3])
    middle = len(content) * 2 // 3
    (tmp_path / "holes.mp4").write_bytes(content[:middle] + bytes(400) + content[middle + 400 :])
    for name in ("absent.mp4", "text.mp4", "cut.mp4", "holes.mp4"):
        with pytest.raises(VideoError, match=name):
            list(read_video(tmp_path / name))


def test_what_cannot_be_encoded_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    frame = np.zeros((96, 160, 3), dtype=np.uint8)
    cases: list[tuple[str, list[np.ndarray], tuple[int, int], str]] = [
        ("odd.mp4", [frame], (161, 96), "must be even"),
        ("none.mp4", [], SIZE, "no frames"),
        ("size.mp4", [frame, frame[:-2]], SIZE, r"frame 1 is uint8 \(94, 160, 3\)"),
        ("kind.mp4", [frame.astype(np.float32)], SIZE, "float32"),
        ("name.avi", [frame], SIZE, "must end in .mp4"),
    ]
    for name, frames, size, message in cases:
        with pytest.raises(VideoError, match=message):
            write_video(tmp_path / name, frames, size=size, fps=25)
    assert list(tmp_path.iterdir()) == []


def test_frames_that_fail_half_way_leave_nothing(tmp_path: Path) -> None:
    def failing() -> Iterator[np.ndarray]:
        yield from moving_frames(5)
        raise RuntimeError("the renderer stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        write_video(tmp_path / "half.mp4", failing(), size=SIZE, fps=25)
    assert list(tmp_path.iterdir()) == []


def test_an_encoder_that_fails_says_why(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"bad.mp4: could not be encoded: .*"):
        write_video(tmp_path / "bad.mp4", moving_frames(300), size=SIZE, fps=25, encoding=Encoding(-500))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_joined_parts_show_every_frame_of_them_once_at_equal_distances(video: Path, tmp_path: Path) -> None:
    frames = list(moving_frames(60))
    parts = [tmp_path / f"a part's {number}.mp4" for number in range(3)]
    crc32: tuple[int, ...] = ()
    for part, (first, last) in zip(parts, [(0, 25), (25, 50), (50, 60)], strict=True):
        crc32 += write_checked_video(part, frames[first:last], size=SIZE, fps=25)[1].crc32
    whole = tmp_path / "whole.mp4"
    assert join_videos(whole, parts) == probe_video(video)
    assert holds_checked_frames(whole, VideoCheck((), (), crc32))
    assert not holds_checked_frames(whole, VideoCheck((), (), crc32[::-1]))
    times = [line.split(",")[2].strip() for line in packets(whole)]
    assert sorted(map(int, times)) == sorted(int(line.split(",")[2]) for line in packets(video))
    again = tmp_path / "again.mp4"
    join_videos(again, parts)
    assert again.read_bytes() == whole.read_bytes()


@pytest.mark.parametrize("fps", [24000 / 1001, 30, 12.5])
def test_parts_join_at_any_frame_rate(tmp_path: Path, fps: float) -> None:
    parts = [tmp_path / f"{number}.mp4" for number in range(3)]
    for part in parts:
        write_video(part, moving_frames(7), size=SIZE, fps=fps)
    facts = join_videos(tmp_path / "whole.mp4", parts)
    assert facts.n_frames == 21
    assert facts.fps == pytest.approx(fps, abs=2e-3)


def test_parts_that_are_missing_or_none_are_named(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match=r"whole\.mp4: there are no videos to join"):
        join_videos(tmp_path / "whole.mp4", [])
    with pytest.raises(VideoError, match=r"gone\.mp4: there is no such file"):
        join_videos(tmp_path / "whole.mp4", [tmp_path / "gone.mp4"])
    assert list(tmp_path.iterdir()) == []
