"""The memory of a process, as Linux counts it (proc(5), /proc/PID/status)."""

from __future__ import annotations

from pathlib import Path
from typing import Literal


def memory_mb(kind: Literal["VmRSS", "VmHWM"], process: int | str = "self") -> float:
    """Return a process's memory, now (VmRSS) or at its highest (VmHWM), MiB.

    getrusage would hand down the highest of the process that started it.
    """
    status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    return int(status.partition(f"{kind}:")[2].split(maxsplit=1)[0]) / 1024
