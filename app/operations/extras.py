"""What to install when a package is missing that only an extra brings."""

from __future__ import annotations

import shlex
import sys
from importlib.util import find_spec

MODULES = {
    "recon": ("cv2", "laspy", "mapbox_earcut", "numba", "open3d", "OpenEXR", "pye57", "pyrender", "skimage", "yaml"),
    "cluster": ("distributed",),
    "postgres": ("psycopg",),
    "s3": ("s3fs",),
    "ros": ("rosbags",),
}


def missing_extra(error: BaseException) -> str | None:
    """Name the extra whose absence led to an error, and the command that installs it; None if it had other causes."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, ModuleNotFoundError):
        cause = cause.__cause__
    if cause is None or cause.name is None:
        return None
    extra = next((extra for extra, modules in MODULES.items() if cause.name.split(".")[0] in modules), None)
    return extra and f"it comes with the extra '{extra}'; to install it: {install_command(extra)}"


def install_command(extra: str) -> str:
    """Write the shell command that adds an extra to the Python that runs.

    It works wherever this program was installed from: pip finds the program there, and installs what the extra needs.
    """
    return shlex.join([sys.executable, "-m", "pip", "install", f"reconstudy[{extra}]"])


def has_extra(extra: str) -> bool:
    """Whether all modules of an extra can be imported here; none of them is."""
    return all(find_spec(module) is not None for module in MODULES[extra])
