"""Describe the room and the display of a study, as a paper reports them: nothing that the server could measure."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from app.study.options.entries import Entries

LONGEST_NOTE = 500  # characters


@dataclass(frozen=True)
class LabSheet:
    """What an experimenter notes of the laboratory; empty or None where it is not known.

    Parameters
    ----------
    display : make and model
    size_inch : diagonal of the display
    peak_luminance_cd_m2 : of the display's white, cd/m²
    white_point : of the display, such as "5000 K" or "D65"
    room_light : such as "dark, controlled" or "20 lx behind the display"
    distance_cm : from the eyes to the display
    """

    display: str = ""
    size_inch: float | None = None
    peak_luminance_cd_m2: float | None = None
    white_point: str = ""
    room_light: str = ""
    distance_cm: float | None = None

    def as_json(self) -> dict[str, Any]:
        """Return what is noted, which `parse_lab_sheet` reads."""
        noted = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in noted.items() if value not in ("", None)}

    def rows(self) -> list[tuple[str, str]]:
        """Return what is noted as pairs of label and text, to be read."""
        return [
            (LABELS[name], f"{value:g}" if isinstance(value, float) else value)
            for name, value in self.as_json().items()
        ]


LABELS = {
    "display": "Display",
    "size_inch": "Size, inch",
    "peak_luminance_cd_m2": "Peak luminance, cd/m²",
    "white_point": "White point",
    "room_light": "Room light",
    "distance_cm": "Viewing distance, cm",
}
BOUNDS = {"size_inch": (1.0, 500.0), "peak_luminance_cd_m2": (1.0, 10_000.0), "distance_cm": (10.0, 5_000.0)}


def parse_lab_sheet(content: Any) -> LabSheet:
    """Read the table [lab_sheet] of a study file.

    Raises
    ------
    ValueError
        Naming the key, the value and what is expected.
    """
    entries = Entries.of_table(content, "lab_sheet", LABELS)
    read: dict[str, Any] = {
        name: entries.number(name, BOUNDS[name], 0) if name in BOUNDS else entries.text(name, LONGEST_NOTE)
        for name, value in entries.content.items()
        if value is not None
    }
    return LabSheet(**read)
