"""Give out orders of trials: which slot each participant holds, and which slots are given out again."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, Connection, and_, case, exists, false, func, or_, select, update

from app.store.database.steady_clock import running_s_before, this_start
from app.store.database.tables import assignment, participant, session, stage_record, trial, vote
from app.store.participants.exclusions import is_excluded, takes_part_in
from app.store.studies.studies import Study
from app.store.trials.designs import planned_pairs, stimulus_names
from app.study.design.adaptive import adaptive_pairs
from app.study.design.balance import OrderPlan, TakenOrder
from app.study.options.options import parse_options
from app.study.options.recruiting import LimitOptions
from app.study.stages import ENDS, FINISHED, INTERVIEW, SCREENED_OUT, TIMED_OUT, WITHDRAWN
from app.study.trial.trial import MAIN, PlannedPair, PlannedTrial

ALL_VOTED = (INTERVIEW, FINISHED)  # stages in which every trial has a vote


def take_order_slot(connection: Connection, study: Study, now: datetime) -> int:
    """Take the slot for a new participant: the first abandoned one, which its holder loses, or else the next new one.

    Abandoned are the slots of participants who have withdrawn, are excluded or screened out, or have votes missing and
    sent nothing for as many hours as the study's options say, or whose time is over. The caller has locked the study's
    row, so nobody else takes a slot.
    """
    given_up = connection.execute(
        select(participant.c.id, participant.c.order_slot)
        .select_from(participant.join(session))
        .where(participant.c.study_id == study.id, participant.c.released_at.is_(None), _is_given_up(study, now))
        .order_by(participant.c.order_slot)
        .limit(1)
    ).one_or_none()
    if given_up is not None:
        connection.execute(update(participant).where(participant.c.id == given_up.id).values(released_at=now))
        return int(given_up.order_slot)
    highest = select(func.coalesce(func.max(participant.c.order_slot), -1)).where(participant.c.study_id == study.id)
    return int(connection.execute(highest).scalar_one()) + 1


def n_taken_in(connection: Connection, study: Study, now: datetime) -> tuple[int, int]:
    """Count who has finished, and who is under way and has not given up; excluded participants do not count.

    Who has all votes and left before the questionnaire keeps the slot, and is under way no more.
    """
    people = select(func.count()).select_from(participant.join(session)).where(takes_part_in(study.id), ~is_excluded())
    is_going_on = session.c.stage.not_in(ENDS) & ~_is_given_up(study, now) & ~_is_silent(study, now)
    counts = people.where(session.c.stage == FINISHED), people.where(is_going_on)
    n_finished, n_under_way = (int(connection.execute(query).scalar_one()) for query in counts)
    return n_finished, n_under_way


def study_plan(connection: Connection, study: Study) -> OrderPlan:
    """Return the facts of a study that its orders are computed from."""
    pairs = planned_pairs(connection, study.id)
    options = parse_options(study.options)
    names = stimulus_names(connection, study.id)
    is_adaptive = options.adaptive_pairs > 0
    plan = OrderPlan(pairs, study.seed, options.repetition, names, is_adaptive=is_adaptive, protocol=options.protocol)
    return replace(plan, groups=options.groups)


def most_trials(connection: Connection, study: Study) -> int:
    """Count the trials of a new participant, as before any vote; of the group that sees most of them."""
    plan = study_plan(connection, study)
    n_adaptive = parse_options(study.options).adaptive_pairs
    return plan.most_trials(adaptive_pairs(plan.pairs, {}, n_adaptive, study.seed, 0) if n_adaptive else plan.pairs)


def planned_trials(connection: Connection, study: Study, slot: int) -> tuple[str | None, list[PlannedTrial]]:
    """Return the group and the order of trials for a new participant; no group where the study has none."""
    plan = study_plan(connection, study)
    group = plan.group(slot)
    return group.name if group else None, plan.order_of_slot(slot, pairs_to_show(connection, study, slot))


def pairs_to_show(connection: Connection, study: Study, slot: int) -> list[PlannedPair]:
    """Return the pairs for a new participant: all of the study, or those chosen adaptively by the votes so far."""
    pairs = planned_pairs(connection, study.id)
    n_pairs = parse_options(study.options).adaptive_pairs
    return adaptive_pairs(pairs, _pair_votes(connection, study.id), n_pairs, study.seed, slot) if n_pairs else pairs


def _pair_votes(connection: Connection, study_id: int) -> dict[int, tuple[int, int, int]]:
    """Count each pair's votes for the top, for the bottom and for neither.

    Check trials do not count, nor do participants who withdrew or are excluded.
    """
    rows = connection.execute(
        select(assignment.c.pair_id, assignment.c.a_half, vote.c.choice, func.count())
        .select_from(
            vote.join(trial).join(assignment).join(participant).join(session, session.c.id == trial.c.session_id)
        )
        .where(
            takes_part_in(study_id),
            session.c.withdrawn_at.is_(None),
            ~is_excluded(),
            assignment.c.role == MAIN,
        )
        .group_by(assignment.c.pair_id, assignment.c.a_half, vote.c.choice)
    )
    counts: dict[int, tuple[int, int, int]] = {}
    for pair_id, a_half, choice, n in rows:
        top, bottom, neither = counts.get(pair_id, (0, 0, 0))
        if choice == "none":
            neither += n
        elif (choice == "a") == (a_half == "top"):
            top += n
        else:
            bottom += n
        counts[pair_id] = top, bottom, neither
    return counts


def taken_orders(connection: Connection, study: Study, now: datetime) -> list[TakenOrder]:
    """Return the stored order of everybody who has begun, by slot."""
    trials: dict[int, list[PlannedTrial]] = {}
    for row in connection.execute(
        select(
            assignment.c.participant_id,
            assignment.c.pair_id,
            assignment.c.a_half,
            assignment.c.first_shown,
            assignment.c.role,
        )
        .join(participant)
        .where(takes_part_in(study.id))
        .order_by(assignment.c.participant_id, assignment.c.position)
    ):
        planned = PlannedTrial(row.pair_id, row.a_half, row.first_shown, row.role)
        trials.setdefault(row.participant_id, []).append(planned)
    state = case(
        (is_excluded(), "excluded"),
        (session.c.stage.in_(ALL_VOTED), "finished"),
        (session.c.stage == WITHDRAWN, "withdrawn"),
        (_is_given_up(study, now), "abandoned"),
        else_="under way",
    )
    people = connection.execute(
        select(participant.c.id, participant.c.label, participant.c.order_slot, participant.c.released_at, state)
        .select_from(participant.join(session))
        .where(takes_part_in(study.id))
        .order_by(participant.c.order_slot, participant.c.id)
    )
    return [
        TakenOrder(label, slot, state, is_released=released_at is not None, trials=trials.get(key, []))
        for key, label, slot, released_at, state in people
    ]


def is_late(limits: LimitOptions, now: datetime) -> ColumnElement[bool]:
    """SQL condition: the time that a study gives each participant to the last vote is over."""
    if not limits.minutes:
        return false()
    return and_(session.c.stage.not_in((*ALL_VOTED, *ENDS)), _began_before(timedelta(minutes=limits.minutes), now))


def _began_before(passed: timedelta, now: datetime) -> ColumnElement[bool]:
    """SQL condition: a session began so long ago, whatever was done to the wall clock since the machine started."""
    is_of_this_start = and_(session.c.machine_start == this_start(), session.c.machine_start.is_not(None))
    return case(
        (is_of_this_start, session.c.running_s < running_s_before(passed)), else_=session.c.started_at < now - passed
    )


def _is_given_up(study: Study, now: datetime) -> ColumnElement[bool]:
    is_abandoned = and_(session.c.stage.not_in(ALL_VOTED), _is_silent(study, now))
    has_ended = session.c.stage.in_((WITHDRAWN, TIMED_OUT, SCREENED_OUT))
    return or_(has_ended, is_abandoned, is_late(parse_options(study.options).limits, now), is_excluded())


def _is_silent(study: Study, now: datetime) -> ColumnElement[bool]:
    """SQL condition: nothing came from the participant for as many hours as the study's options say."""
    silent = timedelta(hours=parse_options(study.options).abandoned_after_h)
    long_ago = now - silent
    heard_of = (
        exists().where(vote.c.session_id == session.c.id, vote.c.received_at >= long_ago),
        exists().where(stage_record.c.session_id == session.c.id, stage_record.c.completed_at >= long_ago),
    )
    return and_(_began_before(silent, now), *(~signal for signal in heard_of))
