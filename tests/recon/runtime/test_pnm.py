from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from recon.runtime.pnm import is_pnm, read_pnm

GREY = np.arange(12, dtype=np.uint8).reshape(3, 4) * 21


def digits(values: np.ndarray, largest: int, end: bytes = b"\n") -> bytes:
    kind = b"P3" if values.ndim == 3 else b"P2"
    rows = b"\n".join(b" ".join(b"%d" % value for value in row.ravel()) for row in values)
    return b"%s\n# by a camera\n%d %d # wide\n%d\n%s%s" % (kind, *values.shape[1::-1], largest, rows, end)


@pytest.mark.parametrize("pixels", [GREY, np.dstack([GREY, GREY[::-1], GREY[:, ::-1]])])
def test_bytes_are_read_as_another_reader_reads_them(pixels: np.ndarray) -> None:
    file = BytesIO()
    Image.fromarray(pixels).save(file, format="PPM")
    expected = np.asarray(Image.open(BytesIO(file.getvalue())).convert("RGB"))
    assert is_pnm(file.getvalue())
    np.testing.assert_array_equal(read_pnm(file.getvalue()), expected)


@pytest.mark.parametrize("end", [b"", b"\n", b" \r\n", b"\n# made by hand"])
@pytest.mark.parametrize("pixels", [GREY, np.dstack([GREY] * 3)])
def test_digits_need_no_newline_at_their_end(pixels: np.ndarray, end: bytes) -> None:
    np.testing.assert_array_equal(read_pnm(digits(pixels, 255, end))[..., 1], GREY)


@given(largest=st.integers(1, 65535), is_digits=st.booleans())
def test_the_largest_value_is_white_and_half_of_it_half_as_bright(largest: int, is_digits: bool) -> None:
    values = np.array([[0, largest // 2, largest]])
    stored = values.astype(">u2" if largest > 255 else np.uint8).tobytes()
    content = digits(values, largest) if is_digits else b"P5 3 1 %d\n%s" % (largest, stored)
    picture = read_pnm(content)
    full = 65535 if largest > 255 else 255
    assert picture.dtype == (np.uint16 if largest > 255 else np.uint8)
    assert picture[0, :, 2].tolist() == [0, round(largest // 2 * (full / largest)), full]


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"P5 4", "does not say its width, height and largest value"),
        (b"P5 4 4 0 ", "up to 0, expected"),
        (b"P5 4 4 70000 ", "up to 70000, expected"),
        (b"P6 2 2 255 12345678901", "is cut off: 11 of 12 bytes are there"),
        (b"P2 2 2 255 1 2 3", "is cut off: 3 of 4 values are there"),
        (b"P2 2 2 255 1 2 3 -4", "no whole numbers"),
        (b"P5 100000 100000 255 1", "announces 100000x100000 pixels, expected at most 268 million"),
    ],
)
def test_what_is_no_whole_picture_is_refused(content: bytes, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        read_pnm(content)
