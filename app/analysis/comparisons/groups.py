"""Compare the scores of groups of participants: by experience, age, sex, or any other grouping."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from app.analysis.comparisons.comparison import fit_by
from app.analysis.comparisons.factors import ModelTest
from app.analysis.comparisons.homogeneity import Part, parts_differ
from app.analysis.model.likelihood.fit import Fit
from app.analysis.model.settings import AnalysisSettings
from app.analysis.reading.phrases import counted
from app.analysis.reading.votes_table import VotesError, VotesTable, only_compared

Groupings = Mapping[str, Mapping[str, str]]  # grouping -> participant -> group; missing participants have none


@dataclass(frozen=True)
class GroupComparison:
    """The groups of a grouping on a dataset (or `all`).

    Parameters
    ----------
    together : Fit to all votes by members of a group
    groups : group -> its votes and fit
    """

    grouping: str
    dataset: str
    together: Fit
    groups: dict[str, Part]

    @property
    def test(self) -> ModelTest | None:
        """Test whether the groups share one set of scores."""
        return parts_differ(f"group {self.grouping}", "items", self.dataset, self.together, list(self.groups.values()))


def check_groups(votes: VotesTable, groupings: Groupings) -> None:
    """Raise if a grouping does not apply to these participants.

    Raises
    ------
    VotesError
        Naming the grouping: participants are not recorded, or none of them belongs to a group.
    """
    for grouping, group_by_participant in groupings.items():
        if not votes.has_participants:
            raise VotesError(f"the grouping {grouping!r} needs votes whose participants are recorded")
        if not set(group_by_participant).intersection(votes.participants):
            raise VotesError(
                f"none of {counted(len(votes.participants), 'participant')}, e.g. {votes.participants[0]!r}, has a "
                f"value of the grouping {grouping!r}"
            )


def compare_groups(votes: VotesTable, dataset: str, settings: AnalysisSettings) -> Iterator[GroupComparison]:
    """Fit the scores of the groups of each grouping; groupings with a single group among these votes are left out.

    Parameters
    ----------
    votes : VotesTable of the dataset
    dataset : name for the result
    settings : the groupings, and how to fit
    """
    for grouping, group_by_participant in settings.groups.items():
        group = np.array([group_by_participant.get(name, "") for name in votes.participants])[votes.participant]
        names = sorted(set(group.tolist()) - {""})
        if len(names) < 2:
            continue
        parts = {name: only_compared(votes.where(group == name)) for name in names}
        fits = {name: Part(part, fit_by(settings, part)[0]) for name, part in parts.items()}
        yield GroupComparison(grouping, dataset, fit_by(settings, only_compared(votes.where(group != "")))[0], fits)
