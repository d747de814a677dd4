"""The command that plans how many participants a study needs."""

from __future__ import annotations

from typing import Any

import typer

from app.operations.commands.analysis import Plan
from app.study.planning import MOST_PARTICIPANTS
from recon.cli.console import ProgressLine, counted, print_result
from recon.cli.flags import with_settings

app = typer.Typer()


@app.command()
@with_settings(Plan)
def plan(asked: Plan, *, as_json: bool) -> None:
    """Find a study's power and sample size by simulation."""
    from app.operations.planning import simulated_plan
    from app.study.options.duration import trials_s

    with ProgressLine() as progress:
        result = simulated_plan(asked, progress)
    n_trials = result["votes_per_participant"]
    result |= {"protocol": asked.protocol, "trials": n_trials}
    result["minutes"] = max(1, round(trials_s(n_trials, asked.exposure) / 60))
    unit, suffix = ("grades", "") if asked.is_rated else ("JOD", "_jod")
    effect = f"{asked.effect:g} {unit}"
    single, pooled = (result[f"detectable{suffix}_{where}"] for where in ("one_dataset", "pooled"))
    sentences = (
        f"{counted(n_trials, 'trial')} for each of {asked.participants} participants: "
        f"about {counted(result['minutes'], 'minute')}.\n"
        f"A difference of {effect} is found with a power of {result['power_one_dataset']:.2f} in one dataset, "
        f"{result['power_pooled']:.2f} over all (claim: {asked.claim}).\n"
        f"Found with a power of 0.8: {_detectable(single, unit)} in one dataset, {_detectable(pooled, unit)} over all."
    )
    print_result(result, f"{sentences}\n{_claims(result, effect)}", as_json=as_json)


def _claims(plan: dict[str, Any], effect: str) -> str:
    """Say how often each claim would be made, and how many participants the one asked for needs."""
    lines = [f"Claims over all datasets, {effect} (± error of the simulation):"]
    lines += [f"  {row['power']:.2f} ± {row['power_error']:.2f}  {row['what']}" for row in plan["claims"]]
    wanted = plan["participants_wanted"]
    number = (
        f"{wanted['participants']} participants ({wanted['low']} to {wanted['high']} within the simulation's error)"
        if wanted
        else f"more than {MOST_PARTICIPANTS} participants"
    )
    named = plan.get("clickers_named")
    if named:
        shares = [
            f"{100 * named[key]:.0f} ± {100 * named[f'{key}_error']:.0f} %" for key in ("by_votes", "with_checks")
        ]
        lines.append(
            f"Of people who click at random a report names {shares[0]} by their votes alone, and {shares[1]} with five "
            "identical and five repeated pairs."
        )
    return "\n".join([*lines, f"For a power of 0.8 of the claim \u201c{plan['claim']}\u201d: {number}."])


def _detectable(difference: float | None, unit: str) -> str:
    return "no difference considered" if difference is None else f"{difference:.2f} {unit}"
