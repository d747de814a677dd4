"""Parts of models are sound, and their textures decoded whole, or it is named what is wrong."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from recon.models.part import Part, decode_picture

CORNERS = np.eye(3)
FACE = np.array([[0, 1, 2]])


def test_a_texture_of_more_pixels_than_can_be_read_is_named() -> None:
    content = cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes()
    header = b"IHDR" + struct.pack(">II", 60000, 60000) + content[24:29]
    content = content[:12] + header + struct.pack(">I", zlib.crc32(header)) + content[33:]
    with pytest.raises(ValueError, match="its texture skin announces 60000x60000 pixels, expected at most 268 million"):
        decode_picture(content, "skin")


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_what_a_program_appends_to_a_texture_does_no_harm(suffix: str) -> None:
    content = cv2.imencode(suffix, np.full((16, 16, 3), 90, np.uint8))[1].tobytes()
    assert (decode_picture(content + b"notes" * 50, "skin") == 90).all()
    with pytest.raises(ValueError, match="its texture skin is cut off after"):
        decode_picture(content[:-8], "skin")


def test_a_face_may_name_the_first_and_the_last_vertex_and_no_other_number() -> None:
    assert len(Part(CORNERS, FACE).faces) == 1
    for wrong in ([0, 1, 3], [0, -1, 2]):
        with pytest.raises(ValueError, match=r"face 1 names vertices .*, but there are 3 "):
            Part(CORNERS, np.vstack([FACE, [wrong]]))


@pytest.mark.parametrize("values", [{"normals": CORNERS[:2]}, {"colours": np.zeros((4, 3), np.uint8)}])
def test_what_vertices_bear_is_there_for_each_of_them(values: dict[str, np.ndarray]) -> None:
    with pytest.raises(ValueError, match=r"it has \d .* for 3 vertices"):
        Part(CORNERS, FACE, **values)


def test_coordinates_are_finite_in_space_and_on_the_texture() -> None:
    with pytest.raises(ValueError, match="vertex"):
        Part(np.where(np.eye(3) == 1, np.nan, 0.0), FACE)
    with pytest.raises(ValueError, match="texture coordinate"):
        Part(CORNERS, FACE, uv=np.full((3, 2), np.inf))
