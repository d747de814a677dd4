"""Report whether the participants' orders of trials follow from the study's seed and are balanced."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

from app.study.design.design import LONGEST_RUN, Repetition, longest_run, williams_square
from app.study.design.groups import Group, group_of_slot, pairs_of_group
from app.study.design.rating_order import most_neighbours, trials_in_order
from app.study.protocols import PC, RATED, Protocol
from app.study.trial.trial import MAIN, PlannedPair, PlannedTrial

WHO_FINISHED = "who finished"  # of whom rules hold once nobody is under way

State = Literal["finished", "under way", "abandoned", "withdrawn", "excluded"]
STATES: tuple[State, ...] = ("finished", "under way", "abandoned", "withdrawn", "excluded")


@dataclass(frozen=True)
class TakenOrder:
    """A participant's stored order of trials.

    Parameters
    ----------
    participant : the label
    slot : number of the order
    state : of the participant's session
    is_released : was the slot given to another participant since?
    trials : in order, first attempts only
    """

    participant: str
    slot: int
    state: State
    is_released: bool
    trials: Sequence[PlannedTrial]


@dataclass(frozen=True)
class OrderPlan:
    """Everything that determines the orders, and the names of what is compared.

    Parameters
    ----------
    pairs : all pairs of the study
    seed : the study's
    repetition : what is shown besides every pair once
    names : (dataset, condition) by the stimulus' key
    is_adaptive : do participants see pairs chosen from earlier votes, and not all?
    protocol : the study's
    groups : that participants are assigned to; empty: none
    """

    pairs: Sequence[PlannedPair]
    seed: int
    repetition: Repetition
    names: Mapping[int, tuple[str, str]]
    is_adaptive: bool = False
    protocol: Protocol = PC
    groups: Sequence[Group] = ()

    @property
    def is_rated(self) -> bool:
        """Do participants rate films one by one?"""
        return self.protocol in RATED

    @property
    def uneven(self) -> int:
        """The largest imbalance of the design: one, which both orders show twice, the second mirroring the first."""
        return 2 if self.repetition.both_orders else 1

    def order_of_slot(self, slot: int, pairs: Sequence[PlannedPair]) -> list[PlannedTrial]:
        """Return the order of these pairs that follows from seed and slot; of a group, only those that it sees."""
        if (group := self.group(slot)) is not None:
            _, slot = group_of_slot(len(self.groups), self.seed, slot)
            pairs = pairs_of_group(group, pairs, self.names)
        return trials_in_order(self.protocol, pairs, self.seed, slot, self.repetition)

    def group(self, slot: int) -> Group | None:
        """Return the group that a slot belongs to; None: the study has no groups."""
        return self.groups[group_of_slot(len(self.groups), self.seed, slot)[0]] if self.groups else None

    def of_group(self, group: Group) -> OrderPlan:
        """Return the plan of what a group sees."""
        return replace(self, pairs=pairs_of_group(group, self.pairs, self.names), groups=())

    def shared(self, order: TakenOrder) -> TakenOrder:
        """Return an order without trials of other pairs than the plan's, which another rule finds."""
        return replace(order, trials=[trial for trial in order.trials if trial.pair in self._by_key])

    def most_trials(self, pairs: Sequence[PlannedPair]) -> int:
        """Count the trials of a participant who sees these pairs, of the group that sees most of them."""
        return max(len(self.order_of_slot(slot, pairs)) for slot in range(max(1, len(self.groups))))

    def order(self, taken: TakenOrder) -> list[PlannedTrial]:
        """Return the order that follows from seed and slot (in an adaptive study, of the pairs chosen)."""
        shown = {trial.pair for trial in taken.trials}
        pairs = [pair for pair in self.pairs if pair.is_identical or pair.key in shown or not self.is_adaptive]
        return self.order_of_slot(taken.slot, pairs)

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


def balance_report(plan: OrderPlan, orders: Sequence[TakenOrder]) -> dict[str, Any]:
    """Check that a study's orders follow from its seed and are balanced, with the counts behind it.

    Some rules hold for each participant. The others hold across participants: for all who hold a slot by design, and
    for all who finished once every other participant has finished or given up the slot.

    Returns
    -------
    {"ok": whether all rules hold but those of who finished, "seed", "participants": {state: n},
    "slots": {"missing": […], "released": […]}, "rules": [{"rule", "of", "worst", "allowed", "ok"}], and of who finished
    "pairs": [{"dataset", "item_1", "item_2", "n_shown", "n_1_is_a", "n_1_is_first"}],
    "datasets": [{"dataset", "position", "n_shown"}]}
    """
    holding = [order for order in orders if not order.is_released]
    finished = [order for order in orders if order.state == "finished"]
    rules = _rules_of_each(plan, orders, holding) + _rules_across(plan, holding, "who hold a slot")
    slots = {order.slot for order in holding}
    return {
        "ok": all(rule["ok"] for rule in rules),
        "seed": plan.seed,
        "participants": {state: sum(order.state == state for order in orders) for state in STATES},
        "slots": {
            "missing": sorted(set(range(max(slots, default=-1) + 1)) - slots),
            "released": sorted(order.slot for order in orders if order.is_released),
        },
        "rules": rules + _rules_across(plan, finished, WHO_FINISHED),
        "pairs": _pair_rows(plan, finished),
        "datasets": _dataset_rows(plan, finished),
    }


def has_begun(report: Mapping[str, Any]) -> bool:
    """Say of a report whether anybody has begun, so that there are orders to check."""
    return any(report["participants"].values())


def holds(report: Mapping[str, Any], rule: Mapping[str, Any]) -> str:
    """Say of a report's rule whether it holds: "yes", "no", or "not yet" where some have to finish, or all to begin."""
    if not has_begun(report):
        return "not yet"
    return "yes" if rule["ok"] else "not yet" if rule["of"] == WHO_FINISHED else "no"


def _rules_of_each(
    plan: OrderPlan, orders: Sequence[TakenOrder], holding: Sequence[TakenOrder]
) -> list[dict[str, Any]]:
    foreign = sum(list(order.trials) != plan.order(order) for order in orders)
    twice = sum(n > 1 for n in Counter(order.slot for order in holding).values())
    seen = [_seen(plan, order) for order in orders]
    runs = [longest_run(_free_to_change(plan, order)) for order in orders]
    of_slots = [
        _rule("orders that do not follow from seed and slot", "each", foreign, 0),
        _rule("slots held by two participants", "each", twice, 0),
    ]
    if plan.is_rated:
        return [*of_slots, *_rules_of_ratings(plan, orders)]
    return [
        *of_slots,
        _rule("surplus of trials with a stimulus as A over as B", "each", _worst(seen, _as_a), 1),
        _rule("surplus of trials with A first over B first", "each", _worst(seen, _label_first), plan.uneven),
        _rule(
            "surplus of trials with a stimulus first over second, by label",
            "each",
            _worst(seen, _first_as),
            plan.uneven,
        ),
        _rule("trials in a row with the same stimulus", "each", max(runs, default=0), LONGEST_RUN),
    ]


def _rules_of_ratings(plan: OrderPlan, orders: Sequence[TakenOrder]) -> list[dict[str, Any]]:
    """Return the rules of each order in which films are rated one by one."""
    datasets = [[plan.pair(trial).dataset for trial in order.trials] for order in orders]
    surplus = [sum(a == b for a, b in pairwise(row)) - most_neighbours(row) for row in datasets]
    rated = [Counter[Hashable](trial.pair for trial in order.trials if trial.role == MAIN) for order in orders]
    return [
        _rule("trials that needlessly follow one of the same dataset", "each", max(surplus, default=0), 0),
        _rule("spread of how often a film is rated", "each", max(map(_spread, rated), default=0), 0),
    ]


def _rules_across(plan: OrderPlan, orders: Sequence[TakenOrder], group: str) -> list[dict[str, Any]]:
    if plan.is_rated:
        return []  # every order is random by itself
    if plan.groups:
        return _rules_of_groups(plan, orders, group)
    ways: Counter[Hashable] = Counter()
    for pair in plan.pairs:
        if not pair.is_identical:
            ways.update({(pair.key, a, first): 0 for a in pair.stimuli for first in pair.stimuli})
    ways.update((seen.pair, seen.a, seen.first) for order in orders for seen in _seen(plan, order))
    datasets = list(dict.fromkeys(pair.dataset for pair in plan.pairs))
    rows = [_datasets_in_order(plan, order) for order in orders]
    places: Counter[Hashable] = Counter({(place, dataset): 0 for place in range(len(datasets)) for dataset in datasets})
    places.update((place, dataset) for row in rows for place, dataset in enumerate(row))
    followers: Counter[Hashable] = Counter(
        {(first, second): 0 for first in datasets for second in datasets if first != second}
    )
    followers.update(neighbours for row in rows for neighbours in pairwise(row))
    uneven = len(williams_square(len(datasets))) // len(datasets)  # while the last block of slots is not full
    by_pair = (
        []
        if plan.is_adaptive
        else [_rule("spread of the four ways in which a pair is seen", group, _spread(ways), plan.uneven)]
    )
    return [
        *by_pair,
        _rule("spread of the datasets over the positions", group, _spread(places), uneven),
        _rule("spread of which dataset follows which", group, _spread(followers), uneven),
    ]


def _rules_of_groups(plan: OrderPlan, orders: Sequence[TakenOrder], group: str) -> list[dict[str, Any]]:
    """Return the rules across the participants of each of a study's groups, and of the groups' sizes."""
    assigned = {each.name: [order for order in orders if plan.group(order.slot) == each] for each in plan.groups}
    sizes = [len(members) for members in assigned.values()]
    rules = [_rule("spread of the sizes of the groups", group, max(sizes) - min(sizes), 1)]
    for each in plan.groups:
        part = plan.of_group(each)
        members = [part.shared(order) for order in assigned[each.name]]
        rules += _rules_across(part, members, f"{group}, of {each.name}")
    return rules


def _rule(rule: str, group: str, worst: int, allowed: int) -> dict[str, Any]:
    return {"rule": rule, "of": group, "worst": worst, "allowed": allowed, "ok": worst <= allowed}


def _seen(plan: OrderPlan, order: TakenOrder) -> list[_Seen]:
    seen = []
    for trial in order.trials:
        if trial.role == MAIN:
            pair = plan.pair(trial)
            a, b = (pair.top, pair.bottom) if trial.a_half == "top" else (pair.bottom, pair.top)
            seen.append(_Seen(pair.dataset, pair.key, a, b, a if trial.first_shown == "a" else b))
    return seen


def _free_to_change(plan: OrderPlan, order: TakenOrder) -> list[frozenset[int]]:
    """Return the stimuli of each trial, without datasets of two conditions, whose pair is in every trial."""
    shown = [plan.pair(trial) for trial in order.trials]
    seen: dict[int, set[int]] = {}
    for pair in shown:
        seen.setdefault(pair.dataset, set()).update(pair.stimuli)
    return [pair.stimuli for pair in shown if len(seen[pair.dataset]) > 2]


Surplus = Callable[[_Seen], Iterable[tuple[Hashable, int]]]


def _as_a(trial: _Seen) -> Iterable[tuple[Hashable, int]]:
    return (trial.a, 1), (trial.b, -1)


def _label_first(trial: _Seen) -> Iterable[tuple[Hashable, int]]:
    return (("label", 1 if trial.first == trial.a else -1),)


def _first_as(trial: _Seen) -> Iterable[tuple[Hashable, int]]:
    is_a_first = trial.first == trial.a
    return (("a", trial.a), 1 if is_a_first else -1), (("b", trial.b), -1 if is_a_first else 1)


def _worst(seen: Sequence[Sequence[_Seen]], surplus: Surplus) -> int:
    """Return the largest surplus of any participant."""
    worst = 0
    for trials in seen:
        totals: Counter[Hashable] = Counter()
        for trial in trials:
            for what, difference in surplus(trial):
                totals[what] += difference
        worst = max(worst, *map(abs, totals.values()), 0)
    return worst


def _spread(counts: Counter[Hashable]) -> int:
    return max(counts.values(), default=0) - min(counts.values(), default=0)


def _datasets_in_order(plan: OrderPlan, order: TakenOrder) -> list[int]:
    return list(dict.fromkeys(plan.pair(trial).dataset for trial in order.trials))


def _pair_rows(plan: OrderPlan, orders: Sequence[TakenOrder]) -> list[dict[str, Any]]:
    if plan.is_rated:
        return []
    seen = [trial for order in orders for trial in _seen(plan, order)]
    shown = Counter(trial.pair for trial in seen)
    as_a = Counter((trial.pair, trial.a) for trial in seen)
    first = Counter((trial.pair, trial.first) for trial in seen)
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


def _dataset_rows(plan: OrderPlan, orders: Sequence[TakenOrder]) -> list[dict[str, Any]]:
    if plan.is_rated:
        return []
    names = {pair.dataset: plan.names[pair.top][0] for pair in plan.pairs}
    rows = [_datasets_in_order(plan, order) for order in orders]
    return [
        {"dataset": name, "position": place + 1, "n_shown": sum(row[place : place + 1] == [dataset] for row in rows)}
        for dataset, name in names.items()
        for place in range(len(names))
    ]
