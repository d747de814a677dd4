"""Hold the settings of an analysis, which are recorded with its results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from app.analysis.model.likelihood.penalised import PENALTIES
from app.analysis.model.likelihood.ties import TIE_MODELS
from app.study.options.options import RANDOM_EFFECTS

LEVEL = 0.95  # confidence level of every interval
JOD_PRIORS = ("none", "pwcmp")


@dataclass(frozen=True)
class AnalysisSettings:
    """Settings of an analysis.

    Parameters
    ----------
    ties : `davidson`, `rao-kupper`, `half` or `drop`
    order_effect : estimate the advantage of the item shown first
    bootstrap : replicates over participants; 0 for none
    seed : for the bootstrap
    factors : factor -> item -> level, all factors of the items
    analysed_factors : the factors to report on; all by default
    measures : objective measure -> dataset -> item -> value
    better : objective measure -> `higher` or `lower`, where it is known
    groups : grouping -> participant -> group, whose scores are compared
    penalty : the estimate where no maximum exists: `firth` or `ridge`
    equivalence_margin : JOD; pairs of items are tested for differing by less than this
    jod_prior : `pwcmp` fits the JOD of Thurstone's Case V with the prior on distances of that package
    random_effects : fit the scores also with `participants`, or with `participants,datasets`, as random effects
    lapses : fit the scores also with careless answers weighted down, by a lapse rate for each participant
    by_dataset : also analyse every dataset alone
    planned_participants : how many the study is planned for; results of fewer are interim
    adaptive_pairs : were pairs chosen from the votes so far? Intervals then hold a little less than they say
    exclude : participants left out by a recorded decision; the results with them are given too
    """

    ties: str = "davidson"
    order_effect: bool = False
    bootstrap: int = 0
    seed: int = 0
    factors: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    analysed_factors: tuple[str, ...] | None = None
    measures: Mapping[str, Mapping[str, Mapping[str, float]]] = field(default_factory=dict)
    better: Mapping[str, str] = field(default_factory=dict)
    groups: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    penalty: str = "firth"
    equivalence_margin: float | None = None
    jod_prior: str = "none"
    random_effects: str = ""
    lapses: bool = False
    by_dataset: bool = True
    exclude: tuple[str, ...] = ()
    planned_participants: int | None = None
    adaptive_pairs: bool = False

    def __post_init__(self) -> None:
        if self.ties not in TIE_MODELS:
            raise ValueError(f"ties is {self.ties!r}, expected one of {', '.join(TIE_MODELS)}")
        if self.penalty not in PENALTIES:
            raise ValueError(f"penalty is {self.penalty!r}, expected one of {', '.join(PENALTIES)}")
        if self.jod_prior not in JOD_PRIORS:
            raise ValueError(f"jod_prior is {self.jod_prior!r}, expected {' or '.join(JOD_PRIORS)}")
        if self.random_effects not in RANDOM_EFFECTS:
            expected = " or ".join(RANDOM_EFFECTS[1:])
            raise ValueError(f"random_effects is {self.random_effects!r}, expected {expected}, or nothing")
        for measure, better in self.better.items():
            if better not in ("higher", "lower"):
                raise ValueError(f"better of the measure {measure!r} is {better!r}, expected higher or lower")
        if self.bootstrap < 0:
            raise ValueError(f"bootstrap is {self.bootstrap}, expected 0 or a number of replicates")
        if self.equivalence_margin is not None and not 0 < self.equivalence_margin < float("inf"):
            raise ValueError(f"equivalence_margin is {self.equivalence_margin}, expected a number of JOD above 0")
        if self.planned_participants is not None and self.planned_participants < 1:
            raise ValueError(f"planned_participants is {self.planned_participants}, expected 1 or more")
        unknown = [factor for factor in self.analysed_factors or () if factor not in self.factors]
        if unknown:
            raise ValueError(f"the factor {unknown[0]!r} is not among {', '.join(self.factors) or 'none'}")

    @property
    def comparisons(self) -> tuple[str, ...]:
        """The factors to report on."""
        return tuple(self.factors) if self.analysed_factors is None else self.analysed_factors

    def as_dict(self) -> dict[str, Any]:
        """Return the settings as they are written to analysis.json."""
        changes = {"analysed_factors": list(self.comparisons), "exclude": list(self.exclude), "interval_level": LEVEL}
        return asdict(self) | changes
