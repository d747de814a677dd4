"""Frame lock and speed of the toggle, read from pixels: `python bench/toggle.py [--switches N] [--only NAME]`.

Full HD films of 15 s at 25 frames a second hold their condition and frame number as bars. The real study page shows
them, real presses switch, and every composited picture is read back. Runs in Chromium, then in Firefox:

- used: the page as participants see it: press to composited picture, black, backward, dropped
- decoded: the same where the browser plays no film of both, so that the page decodes a film of each (WebCodecs)
- lock: used with the film's crop lifted, so that A and B are both in every picture: does their frame differ?
- peer: two video elements that are started together, both in every picture
- waits: from Next to the fixation of the next trial, whose film is fetched meanwhile
- firefox: press to paint; lock, by screenshots between real presses; and the same of two video elements

Each result is followed by its bars, passed or missed. All of it takes about eight minutes. Other work on the machine
delays pictures: the load stands beside the numbers. `--keep FOLDER` keeps the films.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from playing import in_chromium, in_firefox
from playing.study import Study, served_study

BARS = {  # the largest value of what a run tells, by its path in the result
    "press_to_picture_ms.p95": 40,
    "press_to_picture_ms.max": 60,
    "press_to_picture_ms.missed": 0,
    "press_to_paint_ms.p95": 40,
    "differing": 0,
    "black": 0,
    "backward": 0,
    "drops_percent": 1,
    "record.n_mismatches": 0,
    "longest_later_ms": 500,
}
PEERS = ("peer",)  # which nobody expects to pass
PARTS = (*in_chromium.RUNS, "firefox")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--switches", type=int, default=1000)
    parser.add_argument("--only", choices=PARTS, action="append")
    parser.add_argument("--keep", type=Path, help="folder in which the films are kept for the next time")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        with served_study(folder) as study:
            for name in arguments.only or PARTS:
                tell(name, study, arguments.switches)


def tell(name: str, study: Study, n: int) -> None:
    """Print what a run found, how busy the machine was, and which bars it passes."""
    before = os.getloadavg()[0]
    result = in_firefox.run(study, n) if name == "firefox" else asyncio.run(in_chromium.run(name, study, n))
    result |= {"load_before": round(before, 1), "load_after": round(os.getloadavg()[0], 1)}
    lines = [] if name in PEERS else list(verdicts(name, result))
    sys.stdout.write("\n".join([json.dumps({name: result}, indent=2), *lines]) + "\n")
    sys.stdout.flush()


def verdicts(name: str, result: Mapping[str, Any]) -> Iterator[str]:
    """A line for each bar that the result has a value of."""
    for path, largest in BARS.items():
        value: Any = result
        for key in path.split("."):
            value = value.get(key) if isinstance(value, Mapping) else None
        if value is not None:
            yield f"{'pass' if value <= largest else 'MISS'}  {name}: {path} {value}, at most {largest}"


if __name__ == "__main__":
    main()
