"""Define the parts of a report: sections with sentences, tables and figures."""

from __future__ import annotations

import base64
import struct
from collections.abc import Sequence
from dataclasses import dataclass

Row = Sequence[str]


@dataclass(frozen=True)
class Table:
    """A table; `key` is its name in paper.toml, where it has one."""

    key: str
    title: str
    columns: Row
    rows: Sequence[Row]


@dataclass(frozen=True)
class Figure:
    """A figure: SVG text, or pictures as data URLs; with a `name` it is also a file in the folder figures/."""

    caption: str
    name: str = ""
    svg: str = ""
    pictures: Sequence[str] = ()


@dataclass(frozen=True)
class Section:
    title: str
    paragraphs: Sequence[str]
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()


def data_url(picture: bytes, kind: str) -> str:
    """Return a picture as an address that needs no file, such as "data:image/png;base64,..."."""
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode('ascii')}"


def wrapped_picture(address: str) -> str:
    """Return a PNG, given as a data URL, as an SVG of the same size."""
    content = base64.b64decode(address.partition(",")[2])
    width, height = struct.unpack(">II", content[16:24])  # of the header IHDR
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}">'
        f'<image width="{width}" height="{height}" href="{address}"/></svg>'
    )
