"""A program that matches a pair, as somebody else may have written it."""

from __future__ import annotations

import sys
from pathlib import Path

from recon.depth.program import DepthProgram

BOX_FILTER = """
import sys
import cv2
import numpy as np
left, right = (cv2.imread(path, 0).astype(np.float32) for path in sys.argv[1:3])
first, n = int(sys.argv[5]), int(sys.argv[4])
costs = [cv2.blur(np.abs(left - np.roll(right, d, axis=1)), (7, 7)) for d in range(first, first + n)]
np.save(sys.argv[3], np.argmin(costs, axis=0).astype(np.float32) + first)
print("matched", left.shape)
"""
ARGUMENTS = "{left} {right} {out} {n_disparities} {min_disparity}"


def program(folder: Path, text: str, *, output: str = "npy", timeout_s: float = 60.0) -> DepthProgram:
    (folder / "match.py").write_text(text)
    command = f"{sys.executable} '{{folder}}/match.py' {ARGUMENTS}"
    return DepthProgram(command, output, timeout_s, str(folder))
