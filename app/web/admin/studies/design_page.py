"""Show a study's design: pairs, balance of the orders, duration, and the number of participants it needs."""

from __future__ import annotations

import json
from datetime import datetime
from functools import lru_cache, partial
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from app.store.database.engine import Database
from app.store.participants.participants import session_state
from app.store.studies.studies import Study
from app.store.trials.counted_votes import vote_state
from app.store.trials.designs import conditions_of
from app.store.trials.orders import most_trials, study_plan, taken_orders
from app.study.design.balance import balance_report, holds
from app.study.options.duration import stage_minutes
from app.study.options.options import parse_options
from app.study.protocols import TYPICAL_INCONSISTENCY
from app.web.admin.layout import study_page
from app.web.admin.listing import listed
from app.web.gates import Now, Store
from app.web.once import Latest, Shared
from app.web.roles import AStudy, Person

PAIR_COLUMNS = ("dataset", "item_1", "item_2", "n_shown", "n_1_is_a", "n_1_is_first")
REPLICATES = 200  # simulated studies; gives the power to about 3 %
PATIENCE_S = 0.4  # checking the orders of 10 000 participants takes minutes
_reports: Shared[dict[str, Any]] = Shared(16)
_latest_report: Latest[dict[str, Any]] = Latest("reconstudy-balance")

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)


@router.get("/design")
def design_page(
    request: Request,
    person: Person,
    study: AStudy,
    database: Store,
    now: Now,
    participants: Annotated[int | None, Query(ge=2, le=500)] = None,
    effect: Annotated[float, Query(ge=0.05, le=4, allow_inf_nan=False)] = 0.5,
    spread: Annotated[float | None, Query(ge=0, le=3, allow_inf_nan=False)] = None,
) -> Response:
    with database.reading() as connection:
        plan = study_plan(connection, study)
        n_trials = most_trials(connection, study)
        conditions = conditions_of(connection, study.id)
    report, _ = _latest_report.get(
        (str(database.engine.url), study.id), partial(_checked_orders, database, study, now), PATIENCE_S
    )
    minutes = stage_minutes(parse_options(study.options), n_trials, study.exposure_s)
    n_datasets = len({pair.dataset for pair in plan.pairs})
    size = (len(conditions), n_datasets, participants or 22, effect)
    spread = (0.0 if plan.is_rated else 0.4) if spread is None else spread
    power = _power(*size, spread, is_rated=plan.is_rated) if participants else None
    context = {
        "report": report,
        "holds": holds,
        "pairs": listed(request, report["pairs"] if report else [], PAIR_COLUMNS, prefix="pairs_"),
        "conditions": conditions,
        "factors": study.factors,
        "n_trials": n_trials,
        "is_rated": plan.is_rated,
        "inconsistency": TYPICAL_INCONSISTENCY,
        "minutes": round(sum(minutes.values())),
        "power": power,
        "asked": {"participants": participants or 22, "effect": effect, "spread": spread},
    }
    return study_page(request, "design", person, study, context)


def _checked_orders(database: Database, study: Study, now: datetime) -> dict[str, Any]:
    """Check the balance of a study's orders, once for the same participants in the same stages."""
    with database.reading() as connection:
        people = session_state(connection, study.id), sorted(vote_state(connection, study.id).excluded)
    known = json.dumps([str(database.engine.url), study.id, study.revision, people, now.date(), now.hour], default=str)

    def check() -> dict[str, Any]:
        with database.reading() as connection:
            return balance_report(study_plan(connection, study), taken_orders(connection, study, now))

    return _reports.get(known, check)


@lru_cache(maxsize=64)
def _power(
    conditions: int, datasets: int, participants: int, effect: float, spread: float, *, is_rated: bool
) -> dict[str, Any]:
    """Return the power in one dataset and over all, of every claim, and the participants wanted for what a report says.

    The effect is in JOD, or in grades.
    """
    from app.analysis.comparisons.power import claim_rows, participants_wanted, power
    from app.analysis.comparisons.vote_studies import StudyPlan
    from app.analysis.ratings.planning import RatingPlan

    def plan(n: int) -> StudyPlan | RatingPlan:
        if is_rated:
            return RatingPlan(conditions, n, participants, TYPICAL_INCONSISTENCY, spread=spread)
        return StudyPlan(conditions, n, participants, spread=spread)

    whole = plan(datasets)
    return {
        "single": power(plan(1), effect, 1, REPLICATES),
        "pooled": power(whole, effect, 1, REPLICATES),
        "claims": claim_rows(whole, effect, 1, REPLICATES),
        "wanted": participants_wanted(whole, effect, 1, REPLICATES),
    }
