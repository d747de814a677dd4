"""Assign participants at random to groups, equally many to each; a group may see only some of the datasets.

Everything follows from the study's seed and the participant's slot: of every n slots in a row, one goes to each of the
n groups (permuted blocks). A slot that is given up is given out again, and with it its group.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar

import numpy as np
from pydantic import AfterValidator, Field, StringConstraints

from app.study.option_fields import ListOf, Names, Options, Setting, SettingError
from app.study.trial.trial import PlannedPair

MOST_GROUPS = 20
_GROUPS = 9  # stream of random numbers besides those of `app.study.design.design` and `app.study.design.rating_order`

StimulusNames = Mapping[int, tuple[str, str]]  # (dataset, condition) by the stimulus' key


class Group(Options):
    """A group that participants are assigned to."""

    called: ClassVar[str] = "group"

    name: Annotated[
        str,
        StringConstraints(strip_whitespace=True, min_length=1, max_length=60),
        Setting("Name", "shown to experimenters only", expected="1 to 60 characters"),
    ]
    datasets: Annotated[Names, Setting("Datasets", "those that its participants see; empty: all")] = ()


def _are_several(groups: tuple[Group, ...]) -> tuple[Group, ...]:
    names = [group.name for group in groups]
    if twice := [name for name in names if names.count(name) > 1]:
        raise SettingError("groups", f"{twice[0]!r} is there twice", "groups:")
    if len(groups) == 1:
        raise SettingError("groups", f"there is only {names[0]!r}, expected at least two, or none", "groups:")
    return groups


Groups = Annotated[ListOf[Group], Field(max_length=MOST_GROUPS), AfterValidator(_are_several)]


def check_groups(groups: Sequence[Group], datasets: Sequence[str]) -> None:
    """Check that groups see datasets of the study, and that each dataset is seen.

    Raises
    ------
    ValueError
        Naming the dataset and its fault.
    """
    for group in groups:
        if unknown := [name for name in group.datasets if name not in datasets]:
            known = ", ".join(datasets)
            raise SettingError(
                "groups", f"there is no dataset {unknown[0]!r}; expected some of {known}", f"group {group.name!r}:"
            )
    seen = {name for group in groups for name in group.datasets or datasets}
    if groups and (unseen := [name for name in datasets if name not in seen]):
        raise SettingError(
            "groups", f"nobody would see the dataset {unseen[0]!r}; name it in at least one group", "groups:"
        )


def group_of_slot(n_groups: int, seed: int, slot: int) -> tuple[int, int]:
    """Return the group of a slot, counted from 0, and the slot's place among those of its group.

    Parameters
    ----------
    n_groups : of the study, at least one
    seed : the study's
    slot : the participant's, from 0
    """
    block, turn = divmod(slot, n_groups)
    return int(np.random.default_rng([seed, _GROUPS, block]).permutation(n_groups)[turn]), block


def pairs_of_group(group: Group, pairs: Sequence[PlannedPair], names: StimulusNames) -> list[PlannedPair]:
    """Return the pairs that a group's participants see.

    Parameters
    ----------
    group : the group
    pairs : all of the study
    names : of their stimuli
    """
    return [pair for pair in pairs if not group.datasets or names[pair.top][0] in group.datasets]
