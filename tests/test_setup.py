"""Set-up says how far it is."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

SETUP = Path(__file__).parents[1] / "setup.sh"


def test_set_up_counts_the_packages_that_pip_fetches() -> None:
    script = SETUP.read_text(encoding="utf-8")
    (function,) = re.findall(r"^tell_of_packages\(\) \{$.*?^\}$", script, re.MULTILINE | re.DOTALL)
    pip = ["Looking in links: /wheels", *(f"Collecting name{n}==1.0" for n in range(20)), "  Downloading name.whl"]
    pip += ["Processing /wheels/last.whl", "Installing collected packages: many", "Successfully installed many"]
    done = subprocess.run(
        ["bash", "-c", f"{function}\ntell_of_packages 21"], input="\n".join(pip) + "\n", capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "setup: 10 of at most 21 packages fetched",
        "setup: 20 of at most 21 packages fetched",
        "setup: 21 packages fetched; unpacking them",
    ]
