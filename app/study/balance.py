"""What an experimenter needs to trust the orders: that they follow from the seed, and that they balance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

from app.study.design import LONGEST_RUN, Repetition, longest_run, participant_order, williams_square
from app.study.trial import MAIN, PlannedPair, PlannedTrial

State = Literal["finished", "under way", "abandoned", "withdrawn", "excluded"]
STATES: tuple[State, ...] = ("finished", "under way", "abandoned", "withdrawn", "excluded")


@dataclass(frozen=True)
class TakenOrder:
    """The order of trials of one participant, as it is stored.

    Parameters
    ----------
    participant : the label
    slot : which order it is
    state : how far the participant is
    is_released : whether the slot has been given to somebody else since
    trials : in order, first attempts only
    """

    participant: str
    slot: int
    state: State
    is_released: bool
    trials: Sequence[PlannedTrial]


@dataclass(frozen=True)
class StudyPlan:
    """All that orders follow from, and the names of what is compared.

    Parameters
    ----------
    pairs : all of the study
    seed : the study's
    repetition : what comes besides every pair once
    names : (dataset, condition) by the stimulus' key
    is_adaptive : whether participants see pairs chosen from the votes before them, and not all
    """

    pairs: Sequence[PlannedPair]
    seed: int
    repetition: Repetition
    names: Mapping[int, tuple[str, str]]
    is_adaptive: bool = False

    def order(self, taken: TakenOrder) -> list[PlannedTrial]:
        """The order that follows from seed and slot, and from the pairs that were chosen where not all are shown."""
        shown = {trial.pair for trial in taken.trials}
        pairs = [pair for pair in self.pairs if pair.is_identical or pair.key in shown or not self.is_adaptive]
        return participant_order(pairs, self.seed, taken.slot, self.repetition)

    @cached_property
    def _by_key(self) -> Mapping[int, PlannedPair]:
        return {pair.key: pair for pair in self.pairs}

    def pair(self, trial: PlannedTrial) -> PlannedPair:
        return self._by_key[trial.pair]


@dataclass(frozen=True)
class _Seen:
    """A scored trial by its stimuli."""

    dataset: int
    pair: int
    a: int
    b: int
    first: int


def balance_report(plan: StudyPlan, orders: Sequence[TakenOrder]) -> dict[str, Any]:
    """Whether a study's orders are as its seed says and balanced, and the counts behind it.

    Some rules hold for each participant. Others hold across participants: for those who hold a slot by the design, and
    for those who have finished as soon as all others have finished or given up their slots.

    Returns
    -------
    {"ok": all but the rules of who finished,
    "seed", "participants": {state: n}, "slots": {"missing": […], "released": […]},
    "rules": [{"rule", "of", "worst", "allowed", "ok"}], and of who finished
    "pairs": [{"dataset", "item_1", "item_2", "n_shown", "n_1_is_a", "n_1_is_first"}],
    "datasets": [{"dataset", "position", "n_shown"}]}
    """
    holding = [order for order in orders if not order.is_released]
    finished = [order for order in orders if order.state == "finished"]
    own = _rules_of_each(plan, orders, holding) + _rules_across(plan, holding, "who hold a slot")
    slots = {order.slot for order in holding}
    return {
        "ok": all(rule["ok"] for rule in own),
        "seed": plan.seed,
        "participants": {state: sum(order.state == state for order in orders) for state in STATES},
        "slots": {
            "missing": sorted(set(range(max(slots, default=-1) + 1)) - slots),
            "released": sorted(order.slot for order in orders if order.is_released),
        },
        "rules": own + _rules_across(plan, finished, "who finished"),
        "pairs": _pair_rows(plan, finished),
        "datasets": _dataset_rows(plan, finished),
    }


def _rules_of_each(
    plan: StudyPlan, orders: Sequence[TakenOrder], holding: Sequence[TakenOrder]
) -> list[dict[str, Any]]:
    foreign = sum(list(order.trials) != plan.order(order) for order in orders)
    twice = sum(n > 1 for n in Counter(order.slot for order in holding).values())
    seen = [_seen(plan, order) for order in orders]
    runs = [longest_run([plan.pair(trial).stimuli for trial in order.trials]) for order in orders]
    # In both orders the second half mirrors the first: what was uneven by one may be so twice.
    once = 2 if plan.repetition.both_orders else 1
    return [
        _rule("orders that do not follow from seed and slot", "each", foreign, 0),
        _rule("slots held by two participants", "each", twice, 0),
        _rule("how much oftener a stimulus is A than B", "each", _worst(seen, _as_a), 1),
        _rule("how much oftener A is first than B", "each", _worst(seen, _label_first), once),
        _rule("how much oftener a stimulus is first than second under a label", "each", _worst(seen, _first_as), once),
        _rule("trials in a row with the same stimulus", "each", max(runs, default=0), LONGEST_RUN),
    ]


def _rules_across(plan: StudyPlan, orders: Sequence[TakenOrder], of: str) -> list[dict[str, Any]]:
    ways: Counter[Hashable] = Counter()
    for pair in plan.pairs:
        if not pair.is_identical:
            ways.update({(pair.key, a, first): 0 for a in pair.stimuli for first in pair.stimuli})
    ways.update((one.pair, one.a, one.first) for order in orders for one in _seen(plan, order))
    datasets = list(dict.fromkeys(pair.dataset for pair in plan.pairs))
    rows = [_datasets_in_order(plan, order) for order in orders]
    places: Counter[Hashable] = Counter({(place, one): 0 for place in range(len(datasets)) for one in datasets})
    places.update((place, one) for row in rows for place, one in enumerate(row))
    followers: Counter[Hashable] = Counter({(one, other): 0 for one in datasets for other in datasets if one != other})
    followers.update(neighbours for row in rows for neighbours in pairwise(row))
    uneven = len(williams_square(len(datasets))) // len(datasets)  # within a block of slots that is not full yet
    by_pair = (
        [] if plan.is_adaptive else [_rule("spread of the four ways in which a pair is seen", of, _spread(ways), 1)]
    )
    return [
        *by_pair,
        _rule("spread of the datasets over the positions", of, _spread(places), uneven),
        _rule("spread of which dataset follows which", of, _spread(followers), uneven),
    ]


def _rule(rule: str, of: str, worst: int, allowed: int) -> dict[str, Any]:
    return {"rule": rule, "of": of, "worst": worst, "allowed": allowed, "ok": worst <= allowed}


def _seen(plan: StudyPlan, order: TakenOrder) -> list[_Seen]:
    seen = []
    for trial in order.trials:
        if trial.role == MAIN:
            pair = plan.pair(trial)
            a, b = (pair.top, pair.bottom) if trial.a_half == "top" else (pair.bottom, pair.top)
            seen.append(_Seen(pair.dataset, pair.key, a, b, a if trial.first_shown == "a" else b))
    return seen


Surplus = Callable[[_Seen], Iterable[tuple[Hashable, int]]]


def _as_a(one: _Seen) -> Iterable[tuple[Hashable, int]]:
    return (one.a, 1), (one.b, -1)


def _label_first(one: _Seen) -> Iterable[tuple[Hashable, int]]:
    return (("label", 1 if one.first == one.a else -1),)


def _first_as(one: _Seen) -> Iterable[tuple[Hashable, int]]:
    is_a_first = one.first == one.a
    return (("a", one.a), 1 if is_a_first else -1), (("b", one.b), -1 if is_a_first else 1)


def _worst(seen: Sequence[Sequence[_Seen]], surplus: Surplus) -> int:
    """The largest surplus, of whatever is counted, of any participant."""
    worst = 0
    for trials in seen:
        totals: Counter[Hashable] = Counter()
        for one in trials:
            for of, by in surplus(one):
                totals[of] += by
        worst = max(worst, *map(abs, totals.values()), 0)
    return worst


def _spread(counts: Counter[Hashable]) -> int:
    return max(counts.values(), default=0) - min(counts.values(), default=0)


def _datasets_in_order(plan: StudyPlan, order: TakenOrder) -> list[int]:
    return list(dict.fromkeys(plan.pair(trial).dataset for trial in order.trials))


def _pair_rows(plan: StudyPlan, orders: Sequence[TakenOrder]) -> list[dict[str, Any]]:
    seen = [one for order in orders for one in _seen(plan, order)]
    shown = Counter(one.pair for one in seen)
    as_a = Counter((one.pair, one.a) for one in seen)
    first = Counter((one.pair, one.first) for one in seen)
    rows = []
    for pair in plan.pairs:
        if pair.is_identical:
            continue
        (dataset, item_1), (_, item_2) = plan.names[pair.top], plan.names[pair.bottom]
        rows.append(
            {
                "dataset": dataset,
                "item_1": item_1,
                "item_2": item_2,
                "n_shown": shown[pair.key],
                "n_1_is_a": as_a[pair.key, pair.top],
                "n_1_is_first": first[pair.key, pair.top],
            }
        )
    return rows


def _dataset_rows(plan: StudyPlan, orders: Sequence[TakenOrder]) -> list[dict[str, Any]]:
    names = {pair.dataset: plan.names[pair.top][0] for pair in plan.pairs}
    rows = [_datasets_in_order(plan, order) for order in orders]
    return [
        {"dataset": name, "position": place + 1, "n_shown": sum(row[place] == dataset for row in rows)}
        for dataset, name in names.items()
        for place in range(len(names))
    ]
