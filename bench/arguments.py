"""Arguments that benches share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping


def print_families(doc: str | None, families: Mapping[str, Callable[[int, int], Iterable[str]]], studies: int) -> None:
    """Print the lines of all simulations, or of one, as the command line asks for.

    Parameters
    ----------
    doc : what the bench says about itself
    families : from a number of studies and a seed to lines
    studies : simulated studies for each line, by default
    """
    flags = argparse.ArgumentParser(description=doc)
    flags.add_argument("--studies", type=int, default=studies, help="simulated studies for each line")
    flags.add_argument("--seed", type=int, default=1)
    flags.add_argument("--only", choices=families, help="one kind of simulation")
    given = flags.parse_args()
    for name in families if given.only is None else (given.only,):
        for line in families[name](given.studies, given.seed):
            print(line, flush=True)
