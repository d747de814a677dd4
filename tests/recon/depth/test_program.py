"""A pair matched by a program of somebody else: what it is given, which of its disparities count, how it fails."""

from __future__ import annotations

import sys
import time
from contextlib import nullcontext
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.depth import StereoPair
from recon.depth.program import DepthProgram, match_by_program
from recon.runtime.programs import LOG, ProgramError
from tests.recon.depth.called_program import BOX_FILTER, program
from tests.recon.depth.test_matchers import shifted_pair


@pytest.mark.slow
def test_a_program_matches_a_pair_with_a_range_that_begins_below_zero(tmp_path: Path) -> None:
    matched = match_by_program(shifted_pair(-3, min_disparity=-6), program(tmp_path, BOX_FILTER), tmp_path / "a b")
    assert matched.dtype == np.float32
    assert np.mean(matched[:, 8:-8] == -3) > 0.95
    assert [path.name for path in (tmp_path / "a b").iterdir()] == [LOG]
    assert "matched (40, 80)" in (tmp_path / "a b" / LOG).read_text()


@pytest.mark.parametrize("output", ["npy", "pfm", "tiff", "png16"])
def test_every_format_is_read_with_unmatched_pixels_as_nan(tmp_path: Path, output: str) -> None:
    text = """
import sys
import cv2
import numpy as np
disparity = np.full((40, 80), 2.5, np.float32)
disparity[:, :9] = np.nan
path = sys.argv[3]
if path.endswith("npy"):
    np.save(path, disparity)
elif path.endswith("png"):
    cv2.imwrite(path, (np.nan_to_num(disparity) * 256).astype(np.uint16))
elif path.endswith("tiff"):
    cv2.imwrite(path, disparity)
else:
    rows = np.where(np.isnan(disparity), np.inf, disparity)[::-1].astype("<f4")
    open(path, "wb").write(b"Pf\\n80 40\\n-1.0\\n" + rows.tobytes())
"""
    matched = match_by_program(shifted_pair(2), program(tmp_path, text, output=output), tmp_path / "work")
    assert np.isnan(matched[:, :9]).all()
    assert (matched[:, 9:] == 2.5).all()


def test_what_a_program_finds_behind_the_mask_or_outside_the_range_is_dropped(tmp_path: Path) -> None:
    pair = shifted_pair(5)
    mask = np.zeros((40, 80), np.bool_)
    mask[:, :40] = True
    text = "import sys, numpy as np; a = np.full((40, 80), 5.0); a[:20] = -1; np.save(sys.argv[3], a)"
    masked = StereoPair(pair.left, pair.right, 12, left_mask=mask, right_mask=np.ones_like(mask))
    matched = match_by_program(masked, program(tmp_path, text), tmp_path / "work")
    assert np.array_equal(np.isfinite(matched), mask & (np.arange(40) >= 20)[:, None])


@pytest.mark.slow
def test_disparities_that_all_lie_outside_the_range_are_refused(tmp_path: Path) -> None:
    text = "import sys, numpy as np; a = np.full((40, 80), np.nan); a[:20] = -5; a[9] = -7.5; np.save(sys.argv[3], a)"
    sentence = r"all disparities found, -7\.5 to -5, lie outside the range 0 to 11; .* left minus right column"
    with pytest.raises(ProgramError, match=sentence):
        match_by_program(shifted_pair(5), program(tmp_path, text), tmp_path / "work")
    nothing = "import sys, numpy as np; np.save(sys.argv[3], np.full((40, 80), np.nan))"
    assert np.isnan(match_by_program(shifted_pair(5), program(tmp_path, nothing), tmp_path / "work")).all()


def test_a_tiff_of_whole_numbers_is_refused(tmp_path: Path) -> None:
    text = "import sys, cv2, numpy as np; cv2.imwrite(sys.argv[3], np.full((40, 80), 5 * 256, np.uint16))"
    with pytest.raises(ProgramError, match=r"out\.tiff: holds uint16, expected floating numbers"):
        match_by_program(shifted_pair(5), program(tmp_path, text, output="tiff"), tmp_path / "work")


def test_a_program_gets_masks_where_its_command_asks_for_them(tmp_path: Path) -> None:
    pair = shifted_pair(5)
    mask = np.zeros((40, 80), np.bool_)
    mask[5:9, 10:30] = True
    masked = StereoPair(pair.left, pair.right, 12, left_mask=mask)
    asks = DepthProgram("false {left_mask} {right_mask} {out}", "npy")
    for called, names in ((asks, ["left_mask.png", "right_mask.png"]), (DepthProgram("false {out}", "npy"), [])):
        with pytest.raises(ProgramError):
            match_by_program(masked, called, tmp_path / "work")
        assert sorted(path.name for path in (tmp_path / "work").glob("*mask*")) == names
        if names:
            left, right = (cv2.imread(str(tmp_path / "work" / name), cv2.IMREAD_UNCHANGED) for name in names)
            assert left is not None
            assert np.array_equal(left, np.where(mask, 255, 0))
            assert right is not None
            assert (right == 255).all()


def test_a_program_gets_the_pictures_as_they_are(tmp_path: Path) -> None:
    pair = shifted_pair(5)
    with pytest.raises(ProgramError):
        match_by_program(pair, program(tmp_path, "raise SystemExit(1)"), tmp_path / "work")
    for side, expected in (("left", pair.left), ("right", pair.right)):
        picture = np.asarray(cv2.imread(str(tmp_path / "work" / f"{side}.png"), cv2.IMREAD_UNCHANGED))
        assert np.array_equal(picture[..., ::-1], expected)


SAVE = "import sys, numpy as np; np.save(sys.argv[3], {})"
FAILURES = {
    "fails": ("print('no weights'); raise SystemExit(3)", "ended with exit status 3 and said: no weights;"),
    "is killed": (
        "import os; os.kill(os.getpid(), 9)",
        r"was ended by signal 9 \(Killed\), which the system sends where memory runs out",
    ),
    "writes nothing": ("pass", "wrote no out.npy; its log"),
    "says why it writes nothing": ("print('no weights')", "wrote no out.npy and said: no weights; its log"),
    "writes garbage": ("import sys; open(sys.argv[3], 'w').write('garbage')", "is not readable as NPY"),
    "writes a cut-off archive": ("import sys; open(sys.argv[3], 'wb').write(b'PK\\x03\\x04')", "not readable as NPY"),
    "writes text": (SAVE.format("np.full((40, 80), 'a')"), "expected numbers in two dimensions"),
    "writes colours": (SAVE.format("np.zeros((40, 80, 3))"), "expected numbers in two dimensions"),
    "writes another size": (
        SAVE.format("np.zeros((80, 40))"),
        "wrote 40x80 disparities, expected 80x40, as many as the left picture has pixels",
    ),
}


@pytest.mark.parametrize(("text", "sentence"), FAILURES.values(), ids=FAILURES.keys())
def test_how_a_program_failed_is_said_with_its_log(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ProgramError, match=sentence) as raised:
        match_by_program(shifted_pair(5), program(tmp_path, text), tmp_path / "work")
    assert str(raised.value).endswith(f"its log is {tmp_path / 'work' / LOG}")
    assert "\n" not in str(raised.value)
    assert (tmp_path / "work" / LOG).read_text().startswith(f"$ {sys.executable}")


@pytest.mark.parametrize(("status", "refusal"), [(0, None), (3, "exit status 3 and said: cleaned up")])
def test_a_program_may_remove_its_log(tmp_path: Path, status: int, refusal: str | None) -> None:
    """As one does that tidies the folder in which it runs."""
    text = f"import os; os.remove('log.txt'); print('cleaned up'); {SAVE.format('np.full((40, 80), 5)')}; "
    called = program(tmp_path, text + f"sys.exit({status})")
    with nullcontext() if refusal is None else pytest.raises(ProgramError, match=refusal):
        assert (match_by_program(shifted_pair(5), called, tmp_path / "work") == 5).all()


def test_a_program_leaves_its_log_alone_in_its_folder(tmp_path: Path) -> None:
    text = f"import os; os.mkdir('cache'); os.symlink('cache', 'link'); {SAVE.format('np.full((40, 80), 5)')}"
    match_by_program(shifted_pair(5), program(tmp_path, text), tmp_path / "work")
    assert [path.name for path in (tmp_path / "work").iterdir()] == [LOG]


def test_numbers_too_large_for_a_disparity_are_unmatched(tmp_path: Path) -> None:
    text = SAVE.format("np.where(np.arange(80) < 40, 5, 1e300) + np.zeros((40, 1))")
    disparity = match_by_program(shifted_pair(5), program(tmp_path, text), tmp_path / "work")
    assert np.array_equal(np.isfinite(disparity[0]), np.arange(80) < 40)


def test_a_program_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match="no-such-program could not be started: no such file"):
        match_by_program(shifted_pair(5), DepthProgram("no-such-program {left}", "npy"), tmp_path / "work")


def test_a_png_of_8_bits_is_refused_as_png16(tmp_path: Path) -> None:
    text = "import sys, cv2, numpy as np; cv2.imwrite(sys.argv[3], np.full((40, 80), 9, np.uint8))"
    with pytest.raises(ProgramError, match="expected one channel of 16 bits"):
        match_by_program(shifted_pair(5), program(tmp_path, text, output="png16"), tmp_path / "work")


@pytest.mark.slow
def test_a_program_that_hangs_is_stopped_with_all_it_started(tmp_path: Path) -> None:
    text = """
import subprocess
import sys
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print(child.pid, flush=True)
child.wait()
"""
    with pytest.raises(ProgramError, match=r"was stopped after 2 s \(its timeout_s\) and said: \d+; its log"):
        match_by_program(shifted_pair(5), program(tmp_path, text, timeout_s=2.0), tmp_path / "work")
    child = int((tmp_path / "work" / LOG).read_text().splitlines()[1])
    for _ in range(100):
        if not is_running(child):
            return
        time.sleep(0.05)  # until the system has taken its end
    raise AssertionError("the program's child still runs")


def is_running(process: int) -> bool:
    status = Path(f"/proc/{process}/status")
    return status.exists() and "State:\tZ" not in status.read_text()


def test_no_shell_sees_the_command(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match="wrote no"):
        match_by_program(
            shifted_pair(5), DepthProgram("echo $HOME; > {folder}/x", "npy", 9, str(tmp_path)), tmp_path / "w"
        )
    assert "$HOME; >" in (tmp_path / "w" / LOG).read_text().splitlines()[1]
    assert not (tmp_path / "x").exists()
