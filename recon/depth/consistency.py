"""Left/right check: a match counts when both views found it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def consistent(left: NDArray[np.integer], right: NDArray[np.integer], *, threshold: int = 0) -> NDArray[np.bool_]:
    """Where the left view's disparity is confirmed by the pixel of the right view that it points to.

    Parameters
    ----------
    left, right : integer (H, W), pixels, the disparity of each view
    threshold : pixels by which the two may differ; 0 is the total check (Table 2)

    Returns
    -------
    confirmed : bool (H, W), of the left view; False where the match lies outside the right image
    """
    rows, columns = np.arange(left.shape[0])[:, None], np.arange(left.shape[1])[None]
    matched = columns - left
    inside = (matched >= 0) & (matched < left.shape[1])
    there = right[rows, np.where(inside, matched, 0)]
    return np.asarray(inside & (np.abs(left - there) <= threshold))
