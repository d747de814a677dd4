"""Fits of a sphere and the exclusion rule on simulated caps: error, time, and what is caught and dropped.

Seeds differ from those that the rule's limits were set with.
Run as `python bench/validation.py [--points N] [--seeds N] [--balls N]`.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from recon.validation.caps import SPOILS, CapParameters, simulate_cap
from recon.validation.exclusion import exclusion_reasons, part_shifts
from recon.validation.measured import FitError
from recon.validation.sphere import SphereFit, fit_sphere
from recon.validation.sphere_methods import METHODS

RADIUS = 150.0
AZIMUTHS = np.deg2rad((-42.0, 0.0, 42.0))
FIRST_SEED = 5000


def fits(n_points: int, n_seeds: int) -> None:
    """Print centre errors and processor time of every method."""
    print(f"centre error, mm, and processor time on {n_points} points, {n_seeds} seeds a row")
    for method, fit in METHODS.items():
        fit(simulate_cap(CapParameters(n_points=2000), np.random.default_rng(0))[0], RADIUS, 1)  # compiles
        for opening, outliers, step in ((120, 0.05, 0), (120, 0.2, 8), (120, 0.4, 0), (120, 0.4, 8), (90, 0.2, 0)):
            errors, seconds, failed = [], [], 0
            for seed in range(n_seeds):
                rng = np.random.default_rng((FIRST_SEED + seed, opening))
                parameters = CapParameters(n_points=n_points, opening_deg=opening, outliers=outliers, depth_step=step)
                points, centre = simulate_cap(parameters, rng)
                started = time.process_time()
                try:
                    found = fit(points, RADIUS, 1)
                except FitError:
                    failed += 1
                    continue
                seconds.append(time.process_time() - started)
                errors.append(float(np.linalg.norm(found.centre - centre)))
            worst = f"median {np.median(errors):.3f} worst {max(errors):.3f}" if errors else "none"
            took = f"{1e3 * np.median(seconds):.0f} ms" if seconds else "-"
            print(
                f"  {method:9} cap {opening:3} deg, outliers {outliers:4.0%}, step {step} mm: {worst}, {took}, "
                f"failed {failed}"
            )


def exclusion(n_seeds: int) -> None:
    """Print caught and dropped reconstructions per kind of failure, three sensors a ball, one of them spoilt."""
    print(f"exclusion rule, {n_seeds} balls a row; biased: the spoilt fits that are off by more than 1 mm")
    for spoil in SPOILS:
        caught, biased, caught_biased, dropped, good = 0, 0, 0, 0, 0
        for seed in range(n_seeds):
            found, bad = _ball(seed, spoil)
            reasons = exclusion_reasons(
                {name: fit for name, (fit, _, _) in found.items()},
                {name: shifts for name, (_, shifts, _) in found.items()},
            )
            for name, (_, _, error) in found.items():
                if name == bad and spoil != "none":
                    biased += error > 1
                    caught += bool(reasons[name])
                    caught_biased += error > 1 and bool(reasons[name])
                else:
                    good += 1
                    dropped += bool(reasons[name])
        print(f"  {spoil:7} caught {caught}, of {biased} biased {caught_biased}; good dropped {dropped} of {good}")


def _ball(seed: int, spoil: str) -> tuple[dict[str, tuple[SphereFit, tuple[float, float], float]], str]:
    """Fit, shifts and centre error per sensor, and which one is spoilt."""
    rng = np.random.default_rng((FIRST_SEED + seed, len(spoil)))
    bad = int(rng.integers(3))
    found = {}
    for index, azimuth in enumerate(AZIMUTHS):
        parameters = CapParameters(
            n_points=30_000,
            noise=float(rng.uniform(2, 6)),
            outliers=float(rng.uniform(0.02, 0.2)),
            depth_step=float(rng.choice((0.0, 4.0))),
            spoil=spoil if index == bad else "none",
            spoil_mm=float(rng.uniform(6, 18)),
        )
        points, centre = simulate_cap(parameters, rng, np.array([np.sin(azimuth), 0.1, np.cos(azimuth)]))
        points = (points - centre).astype(np.float32)
        try:
            fit = fit_sphere(points, RADIUS)
        except FitError:
            continue
        found[f"S{index}"] = (fit, part_shifts(points, fit), float(np.linalg.norm(fit.centre)))
    return found, f"S{bad}"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--balls", type=int, default=30)
    arguments = parser.parse_args()
    fits(arguments.points, arguments.seeds)
    exclusion(arguments.balls)
