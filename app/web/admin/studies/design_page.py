"""Show a study's design: pairs, balance of the orders, duration, and the number of participants it needs."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from app.store.trials.designs import conditions_of
from app.store.trials.orders import most_trials, study_plan
from app.study.design.balance import holds
from app.study.options.duration import stage_minutes, whole_minutes
from app.study.options.options import parse_options
from app.study.protocols import TYPICAL_INCONSISTENCY, TYPICAL_SPREAD
from app.web.admin.layout import study_page
from app.web.admin.listing import listed
from app.web.analyst.results import REPLICATES, balance_soon, plan_of
from app.web.gates import Now, Store
from app.web.roles import AStudy, Person

PAIR_COLUMNS = ("dataset", "item_1", "item_2", "n_shown", "n_1_is_a", "n_1_is_first")

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
    report, _ = balance_soon(database, study, now)
    minutes = whole_minutes(stage_minutes(parse_options(study.options), n_trials, study.exposure_s))
    n_datasets = len({pair.dataset for pair in plan.pairs})
    size = (len(conditions), n_datasets, participants or 22, effect, spread)
    planned = plan_of(*size, is_rated=plan.is_rated) if participants else None
    usual = 0.0 if plan.is_rated else TYPICAL_SPREAD
    context = {
        "report": report,
        "holds": holds,
        "pairs": listed(request, report["pairs"] if report else [], PAIR_COLUMNS, prefix="pairs_"),
        "conditions": conditions,
        "factors": study.factors,
        "n_trials": n_trials,
        "is_rated": plan.is_rated,
        "inconsistency": TYPICAL_INCONSISTENCY,
        "minutes": sum(minutes.values()),
        "planned": planned,
        "replicates": REPLICATES,
        "most_participants": _most_participants() if planned else None,
        "asked": {
            "participants": participants or 22,
            "effect": effect,
            "spread": usual if spread is None else spread,
        },
    }
    return study_page(request, "design", person, study, context)


def _most_participants() -> int:
    from app.analysis.comparisons.power import MOST_PARTICIPANTS  # the analysis has been loaded for a plan

    return MOST_PARTICIPANTS
