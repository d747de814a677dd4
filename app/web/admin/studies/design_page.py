"""Show a study's design: pairs, balance of the orders, duration, and the number of participants it needs."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response

from app.operations.commands.analysis import Plan
from app.operations.planning import ASSUMPTIONS, plan_on_server
from app.store.trials.designs import conditions_of, datasets_of
from app.store.trials.orders import most_trials, study_plan
from app.study.design.balance import has_begun, holds
from app.study.options.duration import stage_minutes, whole_minutes
from app.study.options.options import parse_options
from app.study.planning import MOST_PARTICIPANTS, usual_spread
from app.web.admin.layout import study_page
from app.web.admin.listing import listed
from app.web.analyst.results import balance_soon
from app.web.gates import Now, Store, from_query
from app.web.roles import AStudy, Person

PAIR_COLUMNS = ("dataset", "item_1", "item_2", "n_shown", "n_1_is_a", "n_1_is_first")
IN_UNITS = ("effect", "spread", "by_dataset", "dataset_spread")  # of the scores: JOD or log-odds, or grades
ASKED_FIRST = ("participants", "effect", "spread", "claim")
OF_VOTES, OF_RATINGS = "tie_rate", "inconsistency"  # what a plan of the other does not use

router = APIRouter(prefix="/admin/studies/{slug}", include_in_schema=False)


@router.get("/design")
def design_page(
    request: Request,
    person: Person,
    study: AStudy,
    database: Store,
    now: Now,
    assumed: Annotated[dict[str, Any], Depends(from_query(Plan, ASSUMPTIONS))],
) -> Response:
    with database.reading() as connection:
        plan = study_plan(connection, study)
        n_trials = most_trials(connection, study)
        conditions, datasets = conditions_of(connection, study.id), datasets_of(connection, study.id)
    report, _ = balance_soon(database, study, now)
    options = parse_options(study.options)
    size = {"conditions": len(conditions), "datasets": len(datasets)}
    fields = [field for name, field in ASSUMPTIONS.items() if name != (OF_VOTES if plan.is_rated else OF_RATINGS)]
    context = {
        "report": report,
        "has_begun": has_begun,
        "holds": holds,
        "pairs": listed(request, report["pairs"] if report else [], PAIR_COLUMNS, prefix="pairs_"),
        "conditions": conditions,
        "factors": study.factors,
        "n_trials": n_trials,
        "is_rated": plan.is_rated,
        "minutes": sum(whole_minutes(stage_minutes(options, n_trials, study.exposure_s)).values()),
        "planned": plan_on_server(options.protocol, size | assumed) if "participants" in request.query_params else None,
        "asked": assumed | ({"spread": usual_spread(options.protocol)} if assumed["spread"] is None else {}),
        "most_participants": MOST_PARTICIPANTS,
        "in_units": IN_UNITS,
        "is_changed": any(
            assumed[field.name] != (field.default or 0) for field in fields if field.name not in ASKED_FIRST
        ),
        "first": [field for field in fields if field.name in ASKED_FIRST],
        "others": [field for field in fields if field.name not in ASKED_FIRST],
    }
    return study_page(request, "design", person, study, context)
