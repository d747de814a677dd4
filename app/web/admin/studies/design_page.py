"""Show a study's design: pairs, balance of the orders, duration, and the number of participants it needs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import lru_cache, partial
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request
from fastapi.responses import FileResponse, Response

from app.errors import NotFoundError
from app.files import file_digest
from app.films.strips import write_still
from app.store.counted_votes import vote_state
from app.store.designs import STRIPS, conditions_of, pair_records, stimulus_records
from app.store.engine import Database
from app.store.experimenters import Experimenter
from app.store.orders import study_plan, taken_orders
from app.store.participants import session_state
from app.store.studies import Study
from app.study.adaptive import adaptive_pairs
from app.study.balance import OrderPlan, balance_report
from app.study.duration import stage_minutes
from app.study.options import parse_options
from app.study.protocols import TYPICAL_INCONSISTENCY
from app.study.trial import PlannedPair
from app.web.admin.layout import study_page
from app.web.admin.listing import listed
from app.web.gates import Acting, AStudy, Now, Person, Store, database, settings
from app.web.once import Latest, Shared

PAIR_COLUMNS = ("dataset", "item_1", "item_2", "n_shown", "n_1_is_a", "n_1_is_first")
PAIR_FILM_COLUMNS = ("dataset", "top", "bottom", "n_frames")
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
) -> Response:
    with database.reading() as connection:
        plan = study_plan(connection, study)
        conditions = conditions_of(connection, study.id)
    report, _ = _latest_report.get(
        (str(database.engine.url), study.id), partial(_checked_orders, database, study, now), PATIENCE_S
    )
    n_trials = plan.most_trials(_pairs_of_first(study, plan))
    minutes = stage_minutes(parse_options(study.options), n_trials, study.exposure_s)
    n_datasets = len({pair.dataset for pair in plan.pairs})
    power = _power(len(conditions), n_datasets, participants, effect, is_rated=plan.is_rated) if participants else None
    context = {
        "report": report,
        "pairs": listed(request, report["pairs"] if report else [], PAIR_COLUMNS, prefix="pairs_"),
        "conditions": conditions,
        "factors": study.factors,
        "n_trials": n_trials,
        "is_rated": plan.is_rated,
        "inconsistency": TYPICAL_INCONSISTENCY,
        "minutes": round(sum(minutes.values())),
        "power": power,
        "asked": {"participants": participants or 22, "effect": effect},
    }
    return study_page(request, "design", person, study, context)


def _pairs_of_first(study: Study, plan: OrderPlan) -> Sequence[PlannedPair]:
    """Return as many pairs as each participant sees: those that the first would see before any vote."""
    n_adaptive = parse_options(study.options).adaptive_pairs
    return adaptive_pairs(plan.pairs, {}, n_adaptive, study.seed, 0) if n_adaptive else plan.pairs


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
def _power(conditions: int, datasets: int, participants: int, effect: float, *, is_rated: bool) -> tuple[float, float]:
    """Return the power in one dataset and over all, as shares of studies; the effect is in JOD, or in grades."""
    from app.analysis.power import StudyPlan, power
    from app.analysis.ratings.planning import RatingPlan, rating_power

    if is_rated:
        plans = (RatingPlan(conditions, n, participants, TYPICAL_INCONSISTENCY) for n in (1, datasets))
        single, pooled = (rating_power(plan, effect) for plan in plans)
        return single, pooled

    single, pooled = (power(StudyPlan(conditions, n, participants), effect, 1, REPLICATES) for n in (1, datasets))
    return single, pooled


@router.get("/stimuli")
def stimuli_page(request: Request, person: Person, study: AStudy) -> Response:
    return _stimuli_page(request, person, study)


@router.post("/stimuli")
def check_stimuli(request: Request, person: Person, actor: Acting, study: AStudy, database: Store) -> Response:
    """Check that every pair's file exists and is unchanged."""
    with database.reading() as connection:
        pairs = pair_records(connection, study.id)
    checked = {pair["media"]: _fault(request, pair) for pair in pairs}
    with database.writing() as connection:
        faults = sum(fault is not None for fault in checked.values())
        actor.note(connection, "films checked", study, study.slug, files=len(checked), faults=faults)
    return _stimuli_page(request, person, study, checked)


@router.get("/stimuli/{media}/{half}.jpg")
def still(
    request: Request,
    _person: Person,
    study: AStudy,
    media: Annotated[str, Path(max_length=32)],
    half: Annotated[str, Path(max_length=9)],
    database: Store,
) -> Response:
    """Show the first picture of a strip of a pair's film."""
    strips = STRIPS if parse_options(study.options).reference_beside else STRIPS[:2]
    with database.reading() as connection:
        pair = next((row for row in pair_records(connection, study.id) if row["media"] == media), None)
    if pair is None or half not in strips:
        raise NotFoundError("This study has no such film.")
    path = settings(request).data_dir / "stills" / f"{pair['sha256']}-{half}.jpg"
    if not path.is_file():
        row = strips.index(half) * (pair["height"] + pair["guard_rows"])
        film = settings(request).media_dir / pair["file"]
        write_still(film, path, row=row, width=pair["width"], height=pair["height"])
    return FileResponse(path, media_type="image/jpeg", headers={"Cache-Control": "private, max-age=86400"})


def _stimuli_page(
    request: Request, person: Experimenter, study: Study, checked: Mapping[str, str | None] | None = None
) -> Response:
    """Show a study's films; `checked` says by film what is wrong with it, and then those come first."""
    with database(request).reading() as connection:
        stimuli, pairs = stimulus_records(connection, study.id), pair_records(connection, study.id)
    names = dict.fromkeys(row["dataset"] for row in stimuli)
    if checked is not None:
        pairs = sorted(pairs, key=lambda pair: checked[pair["media"]] is None)
    context = {
        "datasets": {name: [row for row in stimuli if row["dataset"] == name] for name in names},
        "pairs": listed(request, pairs, PAIR_FILM_COLUMNS, prefix="pairs_"),
        "has_reference": bool(parse_options(study.options).reference_beside),
        "checked": checked,
    }
    return study_page(request, "stimuli", person, study, context)


def _fault(request: Request, pair: dict[str, Any]) -> str | None:
    path = settings(request).media_dir / pair["file"]
    if not path.is_file():
        return "the file is missing"
    return None if file_digest(path) == pair["sha256"] else "the file is not what it was when the study was made"
