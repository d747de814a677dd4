"""Run the paper's experiment from the stimulus set on: a study of the videos, its people, their votes and scores.

The people are artificial, and prefer what was measured to be better: the truth that the scores are held against.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from app.ffmpeg import Progress
from app.files import read_json, write_json
from app.intake.reports import Measure, read_report
from app.intake.stimuli import MANIFEST
from app.main import running_server
from app.operations.studies.create import create_study, read_options
from app.operations.studies.manage import attach_results, list_studies, own_token
from app.settings import Settings
from app.simulation.observer import Observer
from app.simulation.participants import Person, simulate_study
from app.simulation.rating import LOG_ODDS_OF_SCALE
from app.study.design.adaptive import FEWEST_CONDITIONS
from app.study.kinds import PAPER, QUICK
from app.study.options.options import StudyOptions

NAME, RATINGS_NAME = "The paper's study", "Ratings of the same videos"
OBJECTIVE_FILE, ANSWERS_FILE = "objective.json", "answers.json"
TABLES = ("analysis", "screening", "questionnaire", "participants")
QUALITY = "novel view SSIM"  # what the artificial people see of a model: its likeness to photographs
COMPARISONS = ("views", "truth", "clouds", "films")  # the reports that compare the approaches
MEASURES = (  # those of all in the reports that are compared with the scores
    QUALITY,
    "novel view PSNR",
    "novel view coverage",
    "accuracy",
    "completeness",
    "d1_psnr_db",
    "pointssim_colour",
    "ssim_actor",
    "vmaf",
    "flicker",
)
TRUTH = "truth"  # filmed to be measured against, not to be voted on
# The noise that is put in: a model that is less unlike the photographs by a tenth of an octave wins 400 : 1. The
# paper's people made no circular triad, so each was sure of what he preferred; simulated like this, about 2 % of the
# triads are circular. People differ from each other instead, by their taste.
LOG_ODDS_PER_OCTAVE = 60.0
SENSITIVITY_SPREAD = 0.3  # between people: standard deviation of the logarithm of how much quality moves them
TASTE_SPREAD = 1.5  # between people: standard deviation of their liking for an approach apart from quality, log-odds
TIE_RATE = 0.15
N_PEOPLE = 22  # table 3
N_MEN, N_TRAINED = 9, 11
AGES = (19, 59)
LACKING = 8  # how many people come before the one who lacks a cone
SEED = 1
TIMEOUT_S = 300.0

# Besides the preset of the paper's study: who fails goes no further, so that nobody has to exclude votes. Slips alone
# never miss more than 2 of 5 plates.
SCREENING = {"on_failure": "stop", "colour_misses": 2}
# Of each scene, where there are enough approaches to choose from: as many comparisons as the paper's.
ADAPTIVE_PAIRS = 15
RATINGS = {  # absolute ratings of every video, by people whom a recruiting platform sends
    "protocol": "ACR",
    "outside": {
        "id": "PROLIFIC_PID",
        "random_codes": True,
        "complete_url": "https://app.prolific.com/submissions/complete?cc={code}",
    },
}


@dataclass(frozen=True)
class StudyPart:
    """The study of an experiment's folder.

    Parameters
    ----------
    out : the experiment's folder, with the stimulus set and what was measured
    has_ratings : whether as many other people rate every video, too
    """

    out: Path
    has_ratings: bool = False

    def settings(self) -> Settings:
        """Return settings whose folder contains the inputs' digest, so another experiment never overwrites votes."""
        return Settings(data_dir=self.out / f"study-{self.digest()[:8]}", database_url=None, media_url=None)

    def digest(self) -> str:
        """Return the SHA-256 of everything that the votes and their comparison with measures depend on."""
        manifest = read_json(self.out / "stimuli" / MANIFEST)
        shown = [(entry["dataset"], entry["approach"], entry["sha256"]) for entry in manifest["stimuli"]]
        measured = [(*measure.place, measure.value) for measure in self.measures()]
        model = [LOG_ODDS_PER_OCTAVE, SENSITIVITY_SPREAD, TASTE_SPREAD, TIE_RATE, N_PEOPLE, LACKING, SEED]
        studies = [study_options(self.n_approaches()).as_json(), *([RATINGS] if self.has_ratings else [])]
        return hashlib.sha256(json.dumps([shown, measured, model, *studies]).encode()).hexdigest()

    def n_approaches(self) -> int:
        """Count the approaches that people compare."""
        return len(read_json(self.out / OBJECTIVE_FILE)["levels"])

    def reports(self) -> list[Path]:
        """List the validation reports that compare the approaches."""
        listed = read_json(self.out / OBJECTIVE_FILE)["reports"]
        return [self.out / name for name in listed if name.split("/")[1] in COMPARISONS]

    def measures(self) -> list[Measure]:
        """Read what was measured of the approaches: the few measures that are compared with the scores."""
        read = [measure for report in self.reports() for measure in read_report(report).measures]
        return [measure for measure in read if measure.measure in MEASURES]

    def take(self, progress: Progress) -> None:
        """Create the study, let the people take it, and keep what they answered, unless that was done before."""
        settings = self.settings()
        answers = settings.data_dir / ANSWERS_FILE
        if answers.is_file():
            return
        for file in settings.data_dir.glob("study.sqlite*"):  # of a start that was interrupted; films stay
            file.unlink()
        planned = {NAME: study_options(self.n_approaches())}
        if self.has_ratings:
            planned[RATINGS_NAME] = read_options(None, {**RATINGS, "without": [TRUTH]}, QUICK)
        for name, options in planned.items():
            create_study(settings, self.out / "stimuli", name, seed=SEED, options=options, progress=progress)
        studies = {study["name"]: study for study in list_studies(settings)}
        slug, abilities = studies[NAME]["slug"], true_abilities(self.measures())
        with running_server(settings) as url:
            crowd = people(abilities)
            result = simulate_study(settings, url, slug, crowd, abilities, TIE_RATE, SEED, progress=progress)
            attach_results(settings, self.reports(), slug, only=MEASURES)
            content = {"abilities": abilities, "study": studies[NAME], "votes": result["votes"]}
            content |= fetched(settings, url, slug, TABLES)
            if self.has_ratings:
                slug = studies[RATINGS_NAME]["slug"]
                simulate_study(settings, url, slug, raters(crowd), abilities, TIE_RATE, SEED + 1, progress=progress)
                content["ratings"] = fetched(settings, url, slug, ("analysis",))["analysis"]
        write_json(answers, content)

    def answers(self) -> dict[str, Any]:
        """Read what the people answered, and the truth that was put in."""
        return read_json(self.settings().data_dir / ANSWERS_FILE)


def study_options(n_approaches: int) -> StudyOptions:
    """Return the options of the paper's study, without the truth, and with a screening that stops those who fail.

    Of many approaches, each participant compares the most informative pairs, as many as the paper's.
    """
    changes: dict[str, Any] = {"screening": SCREENING, "without": [TRUTH]}
    if has_adaptive_pairs(n_approaches):
        changes["adaptive_pairs"] = ADAPTIVE_PAIRS
    return read_options(None, changes, PAPER)


def has_adaptive_pairs(n_approaches: int) -> bool:
    """Return whether the approaches are too many for everybody to compare all pairs."""
    return n_approaches >= FEWEST_CONDITIONS


def true_abilities(measures: Sequence[Measure]) -> dict[str, float]:
    """Return natural log-odds by "dataset/approach", sum zero in each dataset: better where more like the photographs.

    Raises
    ------
    ValueError
        If nothing was measured of the quality that people see.
    """
    octaves = {
        (measure.dataset, measure.approach): -np.log2(max(1.0 - measure.value, 1e-6))
        for measure in measures
        if measure.measure == QUALITY
    }
    if not octaves:
        raise ValueError(f"the reports hold no {QUALITY!r}, on which the artificial people's preferences depend")
    means = {
        dataset: float(np.mean([value for (scene, _), value in octaves.items() if scene == dataset]))
        for dataset, _ in octaves
    }
    return {
        f"{dataset}/{approach}": round(LOG_ODDS_PER_OCTAVE * (float(value) - means[dataset]), 4)
        for (dataset, approach), value in octaves.items()
    }


def people(abilities: Mapping[str, float]) -> list[Person]:
    """Make as many people as in the paper, men and women, trained and not, and one more who fails the screening."""
    rng = np.random.default_rng(SEED)
    approaches = sorted({name.split("/")[1] for name in abilities})
    sexes = rng.permutation(["male"] * N_MEN + ["female"] * (N_PEOPLE - N_MEN)).tolist()
    trained = rng.permutation(["yes"] * N_TRAINED + ["no"] * (N_PEOPLE - N_TRAINED)).tolist()
    ages = np.rint(np.linspace(*AGES, N_PEOPLE)).astype(int)
    crowd = []
    for sex, is_trained, age in zip(sexes, trained, rng.permutation(ages).tolist(), strict=True):
        sensitivity = float(rng.lognormal(0.0, SENSITIVITY_SPREAD))
        taste = dict(zip(approaches, rng.normal(0.0, TASTE_SPREAD, len(approaches)).tolist(), strict=True))
        preferred = {name: sensitivity * ability + taste[name.split("/")[1]] for name, ability in abilities.items()}
        observer = Observer(acuity=float(rng.uniform(-0.2, 0.0)))
        crowd.append(Person(preferred, observer, {"age": age, "sex": sex, "trained": is_trained}))
    crowd.insert(LACKING, Person(observer=Observer(lacks="deutan", slips=0.0)))
    return crowd


def raters(crowd: Sequence[Person]) -> list[Person]:
    """Return those who see all colours, with preferences that span the scale from bad to excellent."""
    preferences = [person.abilities for person in crowd if person.abilities]
    span = max(max(abilities.values()) - min(abilities.values()) for abilities in preferences)
    scale = LOG_ODDS_OF_SCALE / span
    return [Person({name: scale * ability for name, ability in abilities.items()}) for abilities in preferences]


def fetched(settings: Settings, url: str, slug: str, tables: Sequence[str]) -> dict[str, Any]:
    """Fetch tables of a study over REST, as an analyst does."""
    with (
        own_token(settings, "results") as token,
        httpx.Client(base_url=url, headers={"Authorization": f"Bearer {token}"}, timeout=TIMEOUT_S) as client,
    ):
        return {name: client.get(f"/api/v1/studies/{slug}/{name}").raise_for_status().json() for name in tables}
