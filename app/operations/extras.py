"""What to install when a package is missing that only an extra brings."""

from __future__ import annotations

import shlex
import sys
from importlib.metadata import requires
from importlib.util import find_spec

from packaging.requirements import Requirement

MODULES = {
    "recon": ("cv2", "mapbox_earcut", "numba", "open3d", "OpenEXR", "pyrender", "skimage"),
    "cluster": ("distributed",),
    "postgres": ("psycopg",),
    "s3": ("s3fs",),
}


def missing_extra(error: BaseException) -> str | None:
    """Name the extra whose absence led to an error, and the command that installs it; None if it had other causes.

    The command lists the extra's requirements, so it works wherever this program was installed from.
    """
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, ModuleNotFoundError):
        cause = cause.__cause__
    if cause is None or cause.name is None:
        return None
    extra = next((extra for extra, modules in MODULES.items() if cause.name.split(".")[0] in modules), None)
    return extra and f"it comes with the extra '{extra}'; to install it: {install_command(extra)}"


def install_command(extra: str) -> str:
    """Write the shell command that adds an extra's requirements to the Python that runs."""
    return shlex.join([sys.executable, "-m", "pip", "install", *map(str, requirements_of(extra))])


def requirements_of(extra: str) -> list[Requirement]:
    """List what an extra asks for on this machine, markers resolved."""
    lines = [line for line in requires("reconstudy") or () if "extra ==" in line]
    requirements = [
        requirement
        for requirement in map(Requirement, lines)
        if requirement.marker and requirement.marker.evaluate({"extra": extra})
    ]
    for requirement in requirements:
        requirement.marker = None
    return requirements


def has_extra(extra: str) -> bool:
    """Whether all modules of an extra can be imported here; none of them is."""
    return all(find_spec(module) is not None for module in MODULES[extra])
