"""Measures of films by programs of others: they get the two films, and print a number.

A methods file declares them as tables ``[film.NAME]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from recon.runtime.programs import workplace
from recon.validation.cloud_quality.programs import MeasureProgram, declared_programs, folder_name
from recon.validation.films.kinds import KINDS, Kind
from recon.validation.films.stimuli import Pair
from recon.validation.measures import BETTER


@dataclass(frozen=True)
class FilmPrograms:
    """What is measured by programs.

    Parameters
    ----------
    programs : by the names of their measures
    folder : where they run, each film in a folder of its own that keeps the log
    """

    programs: Mapping[str, MeasureProgram] = field(default_factory=dict)
    folder: Path = Path()

    @property
    def kinds(self) -> dict[str, Kind]:
        """What the measures are."""
        direction = {word: direction for direction, word in BETTER.items()}
        return {
            name: Kind(name, direction[program.better], program.unit, is_of_film=True)
            for name, program in self.programs.items()
        }

    def value(self, pair: Pair, name: str) -> float:
        """Measure a film; a ProgramError, which names the log, says that the program failed in any way."""
        place = self.folder.resolve() / name / folder_name(pair.film.name)
        with workplace(place):
            films = {"reference": pair.reference.video.resolve(), "distorted": pair.film.video.resolve()}
            return self.programs[name].measure(films, place)


def film_programs(path: Path | None, folder: Path) -> FilmPrograms:
    """Read the measures of films of a methods file; none without a file.

    Raises
    ------
    ValueError
        If the file cannot be read, or a name or a value in it cannot be used.
    """
    return FilmPrograms(declared_programs(path, "film", KINDS), folder)
