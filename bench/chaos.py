"""Whether votes that a page has kept reach the database while tabs, connections and the server die at random.

    python bench/chaos.py [--votes 10000] [--json]

Participants in a real browser vote with the study page's own outbox, as fast as it takes votes. Their tabs crash, are
closed and opened twice, their connections are cut, presses are doubled, and the server is killed by SIGKILL all the
time. Prints how many votes were kept by the pages, stored by the server, lost, doubled and wrong, and what happened.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from random import Random
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

from voters import voters_of

from tests.browser.crashing_tabs import compare, vote_in_chaos
from tests.study_server import StudyServer

N_VOTERS = 10


def measure(n_votes: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name:
        url = f"sqlite:///{Path(name) / 'study.sqlite'}"
        voters = voters_of(url, N_VOTERS, n_votes)
        started = time.perf_counter()
        with StudyServer(Path(name)) as server:
            seen = asyncio.run(vote_in_chaos(server, voters, Random(7)))
        seconds = round(time.perf_counter() - started, 1)
        return {**compare(url, seen), **seen.happened, "seconds": seconds, "load": round(os.getloadavg()[0], 1)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--votes", type=int, default=10_000)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    result = measure(arguments.votes)
    print(json.dumps(result, indent=2) if arguments.json else ", ".join(f"{n} {what}" for what, n in result.items()))


if __name__ == "__main__":
    main()
