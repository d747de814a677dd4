"""The two views of a pair as matching sees them: codes, guides and what is searched, at one level of the hierarchy.

What is computed from the right view is mirrored: both then search their matches towards smaller columns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.depth.channels import fine_grey_image, grey_image, on_black
from recon.depth.matching.census import BEHIND, WINDOW, census_pair
from recon.depth.matching.guide import Passages, guide_image, noise_level, permeabilities
from recon.depth.matching.hierarchy import halved, halved_mask
from recon.depth.matching.lanes import N_LANES
from recon.depth.matching.slanted import SPARE
from recon.depth.pair import StereoPair


@dataclass(frozen=True)
class Level:
    """What is searched at one level of the hierarchy."""

    n_disparities: int
    min_disparity: int

    def halved(self) -> Level:
        """Return the level that searches the same disparities at half the size."""
        lowest = self.min_disparity // 2
        highest = -(-(self.min_disparity + self.n_disparities - 1) // 2)
        return Level(highest - lowest + 1, lowest)

    @property
    def before(self) -> int:
        """Columns of padding before a row of the other view."""
        return max(-self.min_disparity, 0) + SPARE

    @property
    def after(self) -> int:
        """Columns of padding after a row of the other view."""
        return max(self.min_disparity + max(self.n_disparities, N_LANES), 0) + SPARE


@dataclass(frozen=True, eq=False)
class View:
    """One image of a pair at one level, its background black.

    What is computed from the right view is mirrored: both then search their matches towards smaller columns.
    """

    image: NDArray[np.uint8]
    grey: NDArray[np.uint16]
    mask: NDArray[np.bool_] | None
    noise: float
    sigma: float
    window: int
    level: Level
    is_right: bool

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W), pixels."""
        return self.image.shape[0], self.image.shape[1]

    def mirrored(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return an image (H, W, ...) as it is in the left view, its columns from right to left in the right."""
        return np.ascontiguousarray(image[:, ::-1] if self.is_right else image)

    def halved(self) -> View:
        """Return the view at the next coarser level."""
        return replace(
            self,
            image=halved(self.image),
            grey=halved(self.grey),
            mask=None if self.mask is None else halved_mask(self.mask),
            noise=self.noise / 2,
            level=self.level.halved(),
        )

    def prepare(self) -> None:
        """Compute what the searches of both views read, and keep it."""
        _ = self.framed_codes

    @cached_property
    def framed_codes(self) -> NDArray[np.uint32]:
        """Census codes, uint32 (2, H, before + W + after), mirrored in the right view, flagged on the background.

        Beyond the image the outermost code is repeated: no disparity is favoured there, and ties remain ties.
        """
        codes = census_pair(self.grey, self.window)
        if self.mask is not None:
            codes[:, ~self.mask] |= BEHIND
        mirrored = codes[:, :, ::-1] if self.is_right else codes
        return np.pad(mirrored, ((0, 0), (0, 0), (self.level.before, self.level.after)), mode="edge")

    @property
    def codes(self) -> NDArray[np.uint32]:
        """Census codes, uint32 (2, H, W), mirrored in the right view."""
        return self.framed_codes[:, :, self.level.before : self.level.before + self.shape[1]]

    @property
    def origin(self) -> int:
        """Column of the padded codes that faces the last pixel of a row of the other view at disparity index 0."""
        return self.level.before + self.level.min_disparity

    @cached_property
    def guide(self) -> NDArray[np.uint8]:
        """The picture without its noise, uint8 (H, W, 3) or (H, W), mirrored in the right view."""
        return guide_image(self.mirrored(self.image), self.noise)

    @cached_property
    def passages(self) -> Passages:
        """How freely costs pass between neighbours, mirrored in the right view."""
        mask = None if self.mask is None else self.mirrored(self.mask)
        return permeabilities(self.guide, sigma=self.sigma, mask=mask)


def views_of(pair: StereoPair, sigma: float, window: int = WINDOW) -> tuple[View, View]:
    """Return the left and the right view of the part of a pair that is matched.

    Parameters
    ----------
    pair : to match
    sigma : permeability, grey levels
    window : of the census, pixels
    """
    box, level = pair.foreground(), Level(pair.n_disparities, pair.min_disparity)

    def view(image: NDArray[np.uint8], mask: NDArray[np.bool_] | None, *, is_right: bool) -> View:
        mask = None if mask is None else mask[box]
        image = on_black(image[box], mask)
        noise = noise_level(grey_image(image), mask)
        return View(image, fine_grey_image(image), mask, noise, sigma, window, level, is_right)

    return view(pair.left, pair.left_mask, is_right=False), view(pair.right, pair.right_mask, is_right=True)
