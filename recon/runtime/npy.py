"""NPY files of other programs: read, or refused by a sentence."""

from __future__ import annotations

from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.runtime.files import refused

# Beside ValueError, what numpy lets through of a damaged header, which it reads as Python, and of a file cut off.
DAMAGED = (ValueError, TypeError, ArithmeticError, SyntaxError, TokenError, EOFError, MemoryError)


def read_npy(path: Path) -> NDArray[Any]:
    """Read the array of an NPY file, but no Python objects.

    Returns
    -------
    array (...,) of the shape and dtype that the file says

    Raises
    ------
    ValueError
        If the file is missing, unreadable or damaged.
    """
    try:
        with path.open("rb") as file:
            return np.lib.format.read_array(file, allow_pickle=False)
    except OSError as error:
        raise refused(path, error) from error
    except DAMAGED as error:
        reason = error if isinstance(error, ValueError) else "its header is damaged, or it is cut off"
        raise ValueError(f"{path}: is not readable as NPY: {reason}") from error
