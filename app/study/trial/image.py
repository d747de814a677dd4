"""Check the images that a study shows in its consent and debriefing."""

from __future__ import annotations

import re

LARGEST_IMAGE = 1024 * 1024  # bytes
MOST_IMAGES = 20
IMAGE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}")
MEDIA_TYPES = {
    b"\x89PNG\r\n\x1a\n": "image/png",
    b"\xff\xd8\xff": "image/jpeg",
    b"GIF8": "image/gif",
    b"RIFF": "image/webp",
}


def media_type(content: bytes) -> str | None:
    """Return an image's media type by its first bytes; None if it is none that browsers show safely."""
    known = next((kind for start, kind in MEDIA_TYPES.items() if content.startswith(start)), None)
    return None if known == "image/webp" and content[8:12] != b"WEBP" else known


def check_image(name: str, content: bytes) -> None:
    """Check an image before it is stored.

    Parameters
    ----------
    name : by which texts show it, such as "room.png"
    content : of the file

    Raises
    ------
    ValueError
        If the name cannot stand in a text, the image is too large, or no PNG, JPEG, GIF or WebP.
    """
    if not IMAGE_NAME.fullmatch(name):
        raise ValueError(f"the image's name is {name!r}, expected letters a-z, digits, dots, - and _, such as room.png")
    if len(content) > LARGEST_IMAGE:
        raise ValueError(f"{name} has {len(content)} bytes, expected at most {LARGEST_IMAGE}")
    if media_type(content) is None:
        raise ValueError(f"{name} is no image that browsers show, expected PNG, JPEG, GIF or WebP")
