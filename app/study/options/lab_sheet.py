"""Describe the room and the display of a study, as a paper reports them: nothing that the server could measure."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from app.study.option_fields import ANY_TIME, Note, Options, Setting, settings_of


class LabSheet(Options):
    """What an experimenter notes of the laboratory; empty or None where it is not known."""

    display: Annotated[Note, Setting("Display", "make and model", ANY_TIME)] = ""
    size_inch: Annotated[float | None, Setting("Size, inch", "its diagonal", ANY_TIME)] = Field(
        default=None, ge=1, le=500
    )
    peak_luminance_cd_m2: Annotated[float | None, Setting("Peak luminance, cd/m²", "of its white", ANY_TIME)] = Field(
        default=None, ge=1, le=10_000
    )
    white_point: Annotated[Note, Setting("White point", "such as 5000 K or D65", ANY_TIME)] = ""
    room_light: Annotated[Note, Setting("Room light", "such as dark, controlled", ANY_TIME)] = ""
    distance_cm: Annotated[
        float | None,
        Setting("Viewing distance, cm", "from eyes to display; where it is known, nobody types it", ANY_TIME),
    ] = Field(default=None, ge=10, le=5000)

    def as_json(self) -> dict[str, Any]:
        """Return what is noted."""
        return {name: value for name, value in self if value not in ("", None)}

    def rows(self) -> list[tuple[str, str]]:
        """Return what is noted as pairs of label and text, to be read."""
        labels = {setting.name: setting.label for setting in settings_of(LabSheet)}
        return [
            (labels[name], f"{value:g}" if isinstance(value, float) else value)
            for name, value in self.as_json().items()
        ]
