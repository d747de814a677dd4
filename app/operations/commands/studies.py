"""The settings of the commands on stimulus sets and studies."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from app.study.kinds import QUICK, PresetName
from app.study.planning import MOST_PLACES, TYPICAL_TIE_RATE
from recon.cli.commands.setting import OUT, Command, argument, option
from recon.cli.commands.shared import PRACTICE

SET = argument("Folder of the stimulus set, or its manifest.json.", metavar="SET")
SHORT_NAME = "The study's short name, as `study list` shows it."
STUDY = argument(SHORT_NAME, metavar="STUDY")
URL = option(None, "Address of the server, for printed links; default: the public one, where it runs, or port 8000.")


class StimuliCheck(Command):
    """Of `stimuli check`."""

    stimulus_set: Path = SET


class StimuliImport(Command):
    """Of `stimuli import`."""

    folder: Path = argument("Folder with DATASET/CONDITION.mp4; conditions.csv in it gives factors; masters are kept.")
    out: Path = option(..., "New folder for the stimulus set.", flags=OUT)
    conform: bool = option(
        False,
        "Make films of a dataset alike that differ in size, frame rate or length.",
        label="Make unlike films alike",
    )
    untagged_range: Literal["ask", "limited", "full"] = option(
        "ask",
        "Range of films that do not say theirs; ask: refuse those whose values tell that it matters.",
        flags=("--range",),
        label="Brightness range where a film does not say it",
        choices={
            "ask": "refuse films whose values tell that it matters",
            "limited": "16 to 235",
            "full": "0 to 255",
        },
        note="",
    )
    practice: str | None = option(None, "Dataset of two videos for practice; it is not compared.", **PRACTICE)


class StimuliMerge(Command):
    """Of `stimuli merge`."""

    sets: list[Path] = argument("Two or more stimulus sets: from render, import or merge.", metavar="SETS")
    out: Path = option(..., "New folder for the stimulus set of all of them.", flags=OUT)


class StudyCreate(Command):
    """Of `study create`, which also takes a flag for each option of a study."""

    stimulus_set: Path = SET
    name: str = option(..., "The study's name, as participants and experimenters read it.")
    exposure: float | None = option(None, "Seconds that a pair is shown; default: length of the shortest video.")
    seed: int | None = option(None, "Seed of all participants' orders; default: random.", ge=0)
    preset: PresetName = option(
        QUICK, "Options to start from: paper (a laboratory), quick (pairs only) or online (at home)."
    )
    options: Path | None = option(None, "TOML file: optional_stages, consent, questions, …; it overrides the preset.")
    url: str | None = URL


class StudyImport(Command):
    """Of `study import`."""

    file: Path = argument(
        "TOML file: name, stimuli, exposure_s, seed and options; or the zip file of a whole study. `study export` "
        "writes both.",
        metavar="FILE",
    )
    stimuli: Path | None = option(None, "Folder of the stimulus set of a TOML file; default: the file's.")
    name: str = option("", "Name of a study from a zip file; default: the one it had.")
    url: str | None = URL


class StudyExport(Command):
    """Of `study export`."""

    study: str = STUDY
    package: Path | None = option(
        None, "Zip file of the whole study; default: its study file alone.", is_argument=True, metavar="FILE.zip"
    )
    out: Path | None = option(None, "Study file to write; default: standard output.", flags=OUT)
    outside_ids: bool = option(
        False,
        "Zip file with outside ids, completion codes, addresses that lead back and names on invitations.",
        flags=("--outside-ids",),
    )


class StudyInvite(Command):
    """Of `study invite`."""

    study: str = STUDY
    places: int | None = option(None, "How many participants may use it; default: any number.", ge=1, le=MOST_PLACES)
    url: str | None = URL


class StudyAttach(Command):
    """Of `study attach`."""

    results: list[Path] = argument(
        "Folders that `reconstudy validate` and `reconstudy models` wrote, or CSV tables of measures.",
        metavar="RESULTS",
    )
    study: str | None = option(None, "The study's short name; default: the only study.")
    only: list[str] | None = option(None, "Measure to compare with the scores, once for each; default: all of them.")


class StudyDuplicate(Command):
    """Of `study duplicate`."""

    study: str = STUDY
    name: str = option(..., "Name of the new study.")


class StudyDelete(Command):
    """Of `study delete`."""

    study: str = STUDY
    yes: bool = option(False, "Do not ask; there is no way back but a backup.", flags=("--yes",))


class StudyCheck(Command):
    """Of `study check`."""

    study: str = STUDY


class StudyBalance(Command):
    """Of `study balance`."""

    study: str = STUDY


class StudyOpen(Command):
    """Of `study open`."""

    study: str = STUDY


class StudyPause(Command):
    """Of `study pause`."""

    study: str = STUDY


class StudyClose(Command):
    """Of `study close`."""

    study: str = STUDY


class StudyArchive(Command):
    """Of `study archive`."""

    study: str = STUDY


class LanguagesCheck(Command):
    """Of `languages check`."""

    files: list[Path] = argument("Language packs, such as fr.json.", metavar="FILES")


class Simulate(Command):
    """Of `simulate`."""

    study: str = option(..., SHORT_NAME)
    url: str | None = option(
        None, "A running server of this database; default: the one of this folder, else one is started."
    )
    participants: int = option(22, "How many simulated participants take the study.", ge=1)
    abilities: Path | None = option(
        None,
        "JSON file: {condition or dataset/condition: ability in natural log-odds}; default: in the order of the films' "
        "measured likeness to the truth, or else the paper's.",
    )
    tie_rate: float = option(TYPICAL_TIE_RATE, "Chance of no preference between equals.", ge=0, le=0.99)
    seed: int = option(1, "Seed of the choices.", ge=0)
