"""Plan a study by simulation: for the command, the dashboard and REST alike."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from pydantic import ValidationError

from app.errors import InvalidError
from app.operations.commands.analysis import Plan
from app.operations.jobs.forms import fields_of
from app.study.planning import usual_spread
from app.study.protocols import Protocol
from ground.file_models import first_fault
from ground.progress import Progress, no_progress

MOST_PAIRS, MOST_PEOPLE = 400, 500  # of a study that a server simulates
ASSUMPTIONS = {field.name: field for field in fields_of("plan", {})}  # in the order of the command's help
REPLICATES = 200  # on a server; gives the power to about 3 %


def simulated_plan(asked: Plan, progress: Progress = no_progress) -> dict[str, Any]:
    """Return what a study can show, as `planned` does; of votes, in JOD, as `plan_study` does.

    Parameters
    ----------
    asked : the study and its people
    progress : told what is simulated, how many studies are, and how many will be at most
    """
    import numpy as np

    from app.analysis.comparisons.power import plan_study
    from app.analysis.comparisons.vote_studies import StudyPlan
    from app.analysis.ratings.planning import RatingPlan, plan_ratings

    rng = np.random.default_rng(asked.seed)
    spread = usual_spread(asked.protocol) if asked.spread is None else asked.spread
    how: dict[str, Any] = {"replicates": asked.replicates, "progress": progress, "claim": asked.claim}
    if asked.is_rated:
        return plan_ratings(asked.filled_in(RatingPlan, spread=spread), asked.effect, rng, **how)
    return plan_study(asked.filled_in(StudyPlan, spread=spread), rng, effect_jod=asked.effect, **how)


def plan_on_server(protocol: Protocol, assumed: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what a study can show, under the same names for votes and for ratings.

    Parameters
    ----------
    protocol : of the study
    assumed : the other settings of a plan

    Raises
    ------
    InvalidError
        If no such study can be planned, or its simulation would keep the server busy for long.
    """
    try:
        return _plan_on_server(Plan(protocol=protocol, replicates=REPLICATES, **assumed))
    except ValidationError as error:
        raise InvalidError(f"No study can be planned whose {first_fault(error, Plan)}.") from error


@lru_cache(maxsize=64)
def _plan_on_server(asked: Plan) -> Mapping[str, Any]:
    from app.analysis.reading.phrases import counted

    n_pairs = asked.conditions * (asked.conditions - 1) // 2 * asked.datasets
    if n_pairs > MOST_PAIRS or asked.participants > MOST_PEOPLE:
        raise InvalidError(
            f"A study of {asked.conditions} conditions in {counted(asked.datasets, 'dataset')} has {n_pairs} pairs, "
            f"here for {asked.participants} participants; this server simulates {MOST_PAIRS} at most, for "
            f"{MOST_PEOPLE} participants. `reconstudy plan` on a computer of your own has no such limit."
        )
    result = simulated_plan(asked)
    unit = "" if asked.is_rated else "_jod"
    return {
        **{name: result[name] for name in type(asked).model_fields if name in result},
        "effect": asked.effect,
        "is_rated": asked.is_rated,
        "power": {"one_dataset": result["power_one_dataset"], "all_datasets": result["power_pooled"]},
        "detectable": {
            "one_dataset": result[f"detectable{unit}_one_dataset"],
            "all_datasets": result[f"detectable{unit}_pooled"],
        },
        "claims": result["claims"],
        "participants_wanted": result["participants_wanted"],
        "clickers_named": result.get("clickers_named"),
    }
