"""Open3D, which the baseline fusions run on, and which reads PCD."""

from __future__ import annotations

from typing import Any

import numba


def open3d() -> Any:
    """Import Open3D, which takes 2 s.

    Numba starts its threads first: the older TBB that Open3D brings would keep it from doing so.
    """
    numba.get_num_threads()
    import open3d as module

    return module
