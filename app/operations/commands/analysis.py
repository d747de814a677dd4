"""The settings of the commands that analyse votes and plan a study."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from app.study.planning import CLAIMS, REPORTED, TYPICAL_INCONSISTENCY, TYPICAL_SPREAD, TYPICAL_TIE_RATE, Claim
from app.study.protocols import EXPOSURE_BOUNDS_S, PC, RATED, Protocol
from recon.cli.commands.setting import OUT, Command, argument, option


class Analyse(Command):
    """Of `analyse`."""

    votes: list[Path] = argument("File of votes, or several, or one of ratings: CSV, TSV, Excel, Parquet or JSON.")
    out: Path | None = option(None, "Folder for analysis.json, tables, figures and report.", flags=OUT)
    items: Path | None = option(None, "CSV file: item, then a column for each factor.")
    measures: Path | None = option(
        None, "CSV file of objective measures: measures.csv of `validate`, or dataset, item and a column for each."
    )
    ties: str = option("davidson", "How to treat votes without preference: davidson, rao-kupper, half or drop.")
    factor: list[str] | None = option(None, "Factor of --items to analyse; default: all.")
    participants: Path | None = option(
        None, "CSV file: participant, then a column for each grouping (experience, age, …)."
    )
    group: list[str] | None = option(None, "Grouping of --participants to compare; default: all.")
    penalty: str = option("firth", "Penalty where the likelihood has no maximum: firth or ridge.")
    by: Literal["dataset", "none"] = option(
        "dataset", "dataset: also analyse each dataset by itself; none: only all together."
    )
    order_effect: bool = option(False, "Estimate how much being shown first helps.", flags=("--order-effect",))
    bootstrap: int = option(0, "Bootstrap replicates over participants for the intervals; 0: t intervals.", ge=0)
    seed: int = option(0, "Seed of the bootstrap.", ge=0)
    equivalence: float | None = option(
        None, "Margin in JOD; tests which pairs of conditions differ by less (two one-sided tests)."
    )
    jod_prior: str = option("none", "Prior on distances for the JOD of Thurstone's Case V: none, or pwcmp's.")
    random_effects: str = option(
        "", "Fit the scores also with random effects: participants (other people) or participants,datasets."
    )
    lapses: bool = option(
        False,
        "Fit the scores also with careless answers weighted down, by a lapse rate for each participant.",
        flags=("--lapses",),
    )
    exclude: list[str] | None = option(None, "Participant to leave out; the report says so. May be repeated.")
    planned: int | None = option(
        None, "Participants that the study was planned for; results of fewer are interim.", ge=1
    )
    adaptive_pairs: bool = option(
        False, "The pairs were chosen from the votes so far; the report says so.", flags=("--adaptive-pairs",)
    )
    columns: str | None = option(
        None, "Names of the file's columns where they differ: participant=judge,item_a=type_a+level_a."
    )
    choices: str | None = option(None, "Words of the file's choices where they differ: none=tie,a=1,b=0.")
    layout: str = option(
        "",
        "Name of the file's layout or program, as docs/formats.md lists them; default: recognised.",
        flags=("--format",),
    )
    encoding: str = option("", "Encoding of a text file, e.g. latin-1; default: UTF-8 or marked UTF-16.")
    sheet: str = option("", "Sheet of a workbook (default: the first), or the question whose answers are taken.")
    ratings: Path | None = option(None, "File of ratings of the same items, to put on one scale with the votes.")
    scale: str | None = option(None, "Ends of the ratings' scale, e.g. 1:9 or 0:100; default: 1:5, compared -3:3.")
    width: Literal["one", "two"] = option(
        "two", "Width of the figures: one or two columns of a journal (88 or 181 mm)."
    )
    dry_run: bool = option(False, "Only say how the files are understood; write nothing.", flags=("--dry-run",))


class Plan(Command):
    """Of `plan`. What has a label, the dashboard's Design page asks of a study, and so does REST."""

    conditions: int = option(..., "Conditions of each dataset; with a hidden reference if any.", ge=2, le=1000)
    datasets: int = option(1, "Number of datasets.", ge=1, le=1000)
    participants: int = option(22, "Number of participants.", ge=2, le=10_000, label="Participants", note="")
    protocol: Protocol = option(
        PC, "PC or CCR (every pair is compared), or ACR, ACR-HR, DCR (every film is rated).", flags=("--protocol",)
    )
    effect: float = option(
        0.5,
        "True difference of two conditions: JOD (log-odds / ln 3), or grades where rated.",
        ge=0.001,
        le=10,
        label="True difference",
        note="",
    )
    spread: float | None = option(
        None,
        "How far people's opinions of a condition differ: standard deviation, log-odds "
        f"({TYPICAL_SPREAD} by default), or grades where rated (0).",
        ge=0,
        le=10,
        label="How far people differ",
        note="standard deviation of opinions",
    )
    claim: Claim = option(REPORTED, "What is to be claimed.", choices=CLAIMS, label="Claim", note="")
    tie_rate: float = option(
        TYPICAL_TIE_RATE,
        "Chance of no preference between equals.",
        ge=0,
        le=0.99,
        label="Chance of no preference",
        note="between equals",
    )
    inconsistency: float = option(
        TYPICAL_INCONSISTENCY,
        "Standard deviation of somebody's ratings around the qualities, in grades.",
        ge=0.01,
        le=10,
        label="Inconsistency",
    )
    by_dataset: float = option(
        0.0,
        "The same of opinions that somebody has on one dataset only.",
        ge=0,
        le=10,
        label="How far people differ on one dataset only",
        note="standard deviation",
    )
    dataset_spread: float = option(
        0.0,
        "How far datasets shift the scores: standard deviation, log-odds or grades.",
        ge=0,
        le=10,
        label="How far datasets shift the scores",
        note="standard deviation",
    )
    drop_out: float = option(
        0.0, "Share of people who leave half-way.", ge=0, le=0.99, label="Who leave half-way", note="share of people"
    )
    careless: float = option(
        0.0,
        "Share of people who answer at random.",
        ge=0,
        le=0.99,
        label="Who answer at random",
        note="share of people",
    )
    exposure: float = option(
        15.0,
        "Seconds of a trial's film, for the minutes of a session.",
        ge=EXPOSURE_BOUNDS_S[0],
        le=EXPOSURE_BOUNDS_S[1],
    )
    replicates: int = option(400, "Simulated studies for each power.", ge=10, le=10_000)
    seed: int = option(1, "Seed of the simulation.", ge=0)

    @property
    def is_rated(self) -> bool:
        """Are films rated, rather than pairs compared?"""
        return self.protocol in RATED
