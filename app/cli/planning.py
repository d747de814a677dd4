"""The command that plans how many participants a study needs."""

from __future__ import annotations

import math
from typing import Annotated, Any

import typer

from app.study.protocols import TYPICAL_INCONSISTENCY
from recon.cli.console import JsonOption, ProgressLine, print_result
from recon.cli.options import wrong_use

app = typer.Typer()


@app.command()
def plan(
    conditions: Annotated[int, typer.Option(min=2, help="Conditions of each dataset; with a hidden reference if any.")],
    datasets: Annotated[int, typer.Option(min=1, help="Number of datasets.")],
    participants: Annotated[int, typer.Option(min=2, help="Number of participants.")],
    protocol: Annotated[
        str, typer.Option(help="PC or CCR (every pair is compared), or ACR, ACR-HR, DCR (every film is rated).")
    ] = "PC",
    effect: Annotated[
        float, typer.Option(help="True difference of two conditions: JOD (log-odds / ln 3), or grades where rated.")
    ] = 0.5,
    tie_rate: Annotated[float, typer.Option(min=0, max=0.99, help="Chance of no preference between equals.")] = 0.2,
    claim: Annotated[
        str,
        typer.Option(
            help="What is to be claimed: told apart (all pairs, Holm), pair, best, factor, measure, datasets."
        ),
    ] = "told apart",
    spread: Annotated[
        float | None,
        typer.Option(
            min=0,
            help="How far people's opinions of a condition differ: standard deviation, log-odds (0.4 by default), or "
            "grades where rated (0).",
        ),
    ] = None,
    by_dataset: Annotated[
        float, typer.Option(min=0, help="The same of opinions that somebody has on one dataset only.")
    ] = 0.0,
    dataset_spread: Annotated[
        float, typer.Option(min=0, help="How far datasets shift the scores: standard deviation, log-odds or grades.")
    ] = 0.0,
    drop_out: Annotated[float, typer.Option(min=0, max=0.99, help="Share of people who leave half-way.")] = 0.0,
    careless: Annotated[float, typer.Option(min=0, max=0.99, help="Share of people who answer at random.")] = 0.0,
    inconsistency: Annotated[
        float, typer.Option(help="Standard deviation of somebody's ratings around the qualities, in grades.")
    ] = TYPICAL_INCONSISTENCY,
    exposure: Annotated[float, typer.Option(help="Seconds of a trial's film, for the minutes of a session.")] = 15.0,
    replicates: Annotated[int, typer.Option(min=10, max=10_000, help="Simulated studies for each power.")] = 400,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulation.")] = 1,
    as_json: JsonOption = False,
) -> None:
    """Find a study's power and sample size by simulation."""
    import numpy as np

    from app.analysis.comparisons.power import plan_study
    from app.analysis.comparisons.vote_studies import StudyPlan
    from app.analysis.ratings.planning import RatingPlan, plan_ratings
    from app.study.options.duration import trials_s
    from app.study.options.study_file import EXPOSURE_BOUNDS_S
    from app.study.protocols import PROTOCOLS, RATED

    shortest, longest = EXPOSURE_BOUNDS_S
    if not shortest <= exposure <= longest:
        raise typer.BadParameter(f"--exposure is {exposure:g}, expected {shortest:g} to {longest:g} seconds")
    for option, value in (("--effect", effect), ("--inconsistency", inconsistency)):
        if not 0 < value < math.inf:
            raise typer.BadParameter(f"{option} is {value:g}, expected more than 0")
    if protocol not in PROTOCOLS:
        raise typer.BadParameter(f"protocol is {protocol!r}, expected one of {', '.join(PROTOCOLS)}")
    is_rated = protocol in RATED
    people: dict[str, Any] = {
        "by_dataset": by_dataset,
        "dataset_spread": dataset_spread,
        "drop_out": drop_out,
        "careless": careless,
    } | ({} if spread is None else {"spread": spread})
    rng, size = np.random.default_rng(seed), (conditions, datasets, participants)
    with ProgressLine() as progress, wrong_use():
        how: dict[str, Any] = {"replicates": replicates, "progress": progress, "claim": claim}
        if is_rated:
            result = plan_ratings(RatingPlan(*size, inconsistency, **people), effect, rng, **how)
        else:
            result = plan_study(StudyPlan(*size, tie_rate, **people), rng, effect_jod=effect, **how)
    n_trials = result["votes_per_participant"]
    result |= {"protocol": protocol, "trials": n_trials, "minutes": max(1, round(trials_s(n_trials, exposure) / 60))}
    unit, suffix = ("grades", "") if is_rated else ("JOD", "_jod")
    single, pooled = (result[f"detectable{suffix}_{where}"] for where in ("one_dataset", "pooled"))
    sentences = (
        f"{n_trials} trials for each of {participants} participants: about {result['minutes']} minutes.\n"
        f"A difference of {effect:g} {unit} is found with a power of {result['power_one_dataset']:.2f} in one dataset, "
        f"{result['power_pooled']:.2f} over all (claim: {claim}).\n"
        f"Found with a power of 0.8: {_detectable(single, unit)} in one dataset, {_detectable(pooled, unit)} over all."
    )
    print_result(result, f"{sentences}\n{_claims(result, f'{effect:g} {unit}')}", as_json=as_json)


def _claims(plan: dict[str, Any], effect: str) -> str:
    """Say how often each claim would be made, and how many participants the one asked for needs."""
    from app.analysis.comparisons.power import MOST_PARTICIPANTS

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
