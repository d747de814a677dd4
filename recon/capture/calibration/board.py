"""Calibration boards, and their corners in pictures.

A chessboard is written `chessboard:9x6:25`: inner corners along and across, edge of a square in mm. A ChArUco board is
written `charuco:11x8:30:22` or `charuco:11x8:30:22:DICT_5X5_100`: squares along and across, edge of a square and of a
marker in mm, OpenCV's dictionary.

Convention: the board's frame has its origin at the first corner, x along the first row, z into the board.
"""

from __future__ import annotations

import math
from base64 import b64encode
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError

DEFAULT_DICTIONARY = "DICT_5X5_100"
PRINTED_SQUARE = 200  # pixels of its edge
MIN_CORNERS = 12  # of a board that is partly covered
MIN_SPREAD = 0.05  # of the corners across to along their main direction: below, they are on one line
REFINED_WITHIN = 0.4  # of the distance to the next corner, to all sides
REFINED_UNTIL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
FORMS = "chessboard:9x6:25 (inner corners, mm) or charuco:11x8:30:22[:DICTIONARY] (squares, mm, marker's mm)"


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners in a picture: their numbers on the board (N,) and their places, float64 (N, 2), pixels."""

    ids: NDArray[np.int64]
    pixels: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True)
class Board:
    """A calibration board.

    Parameters
    ----------
    kind : "chessboard" or "charuco"
    columns, rows : inner corners of a chessboard, squares of a ChArUco board
    marker_mm, dictionary : of a ChArUco board
    """

    kind: str
    columns: int
    rows: int
    square_mm: float
    marker_mm: float = 0.0
    dictionary: str = DEFAULT_DICTIONARY

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or not 0 < self.square_mm < math.inf:
            raise CaptureError(
                f"board: {self.columns}x{self.rows} with squares of {self.square_mm:g} mm, expected at least 3x3 and a "
                "positive length"
            )
        inside = 1 if self.kind == "charuco" else 0  # of a ChArUco board, no corner lies on the edge
        if (n_corners := (self.columns - inside) * (self.rows - inside)) < MIN_CORNERS:
            raise CaptureError(
                f"board: {self.columns}x{self.rows} has {n_corners} corners, expected at least {MIN_CORNERS}, which "
                "a picture must show"
            )
        if self.kind == "charuco" and not 0 < self.marker_mm < self.square_mm:
            raise CaptureError(f"board: the markers of {self.marker_mm} mm do not fit squares of {self.square_mm} mm")
        if self.kind == "charuco" and self.columns * self.rows // 2 > len(self._markers.bytesList):
            raise CaptureError(
                f"board: {self.columns}x{self.rows} squares take {self.columns * self.rows // 2} markers, and "
                f"{self.dictionary} has {len(self._markers.bytesList)}; expected fewer squares, or a larger dictionary "
                "such as DICT_5X5_1000"
            )

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """All corners on the board, float64 (N, 3), mm."""
        if self.kind == "charuco":
            return np.asarray(self._charuco.getChessboardCorners(), dtype=np.float64)
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        corners = np.stack([column, row, np.zeros_like(row)], axis=-1).reshape(-1, 3)
        return np.asarray(corners * self.square_mm, dtype=np.float64)

    @property
    def is_symmetric(self) -> bool:
        """True if the board looks the same after half a turn: nobody can tell its first corner from its last."""
        return self.kind == "chessboard" and (self.columns + self.rows) % 2 == 0

    def find(self, grey: NDArray[np.uint8]) -> Corners:
        """Find the board's corners in a grey picture, uint8 (H, W).

        A CaptureError says that the board is not found, too little of it is, or the corners are on one line.
        """
        corners = self._find_charuco(grey) if self.kind == "charuco" else self._find_chessboard(grey)
        if len(corners) < MIN_CORNERS:
            raise CaptureError(f"only {len(corners)} corners of the board are found, expected at least {MIN_CORNERS}")
        spread = np.linalg.svd(corners.pixels - corners.pixels.mean(axis=0), compute_uv=False)
        if spread[1] < MIN_SPREAD * spread[0]:
            raise CaptureError("the corners found are on one line: the board is seen from its edge")
        return corners

    def picture(self, pixels_per_mm: float) -> NDArray[np.uint8]:
        """Draw the board for printing, with a margin of one square, uint8 (H, W)."""
        edge = round(self.square_mm * pixels_per_mm)
        if self.kind == "charuco":
            size = ((self.columns + 2) * edge, (self.rows + 2) * edge)
            return np.asarray(self._charuco.generateImage(size, marginSize=edge))
        column, row = np.meshgrid(np.arange(self.columns + 1), np.arange(self.rows + 1))
        squares = np.where((column + row) % 2 == 0, 0, 255).astype(np.uint8)
        return np.pad(np.kron(squares, np.ones((edge, edge), dtype=np.uint8)), edge, constant_values=255)

    def drawing(self) -> str:
        """Draw the board for printing as an SVG file of its true size, with a margin of one square."""
        picture = self.picture(PRINTED_SQUARE / self.square_mm)
        height, width = (length * self.square_mm / PRINTED_SQUARE for length in picture.shape)
        encoded = b64encode(cv2.imencode(".png", picture)[1].tobytes()).decode("ascii")
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" '
            f'viewBox="0 0 {width:g} {height:g}"><image width="{width:g}" height="{height:g}" '
            f'style="image-rendering: pixelated" href="data:image/png;base64,{encoded}"/></svg>\n'
        )

    @cached_property
    def _markers(self) -> Any:
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))

    @cached_property
    def _charuco(self) -> Any:
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_mm, self.marker_mm, self._markers)

    def _find_charuco(self, grey: NDArray[np.uint8]) -> Corners:
        pixels, ids, _, _ = cv2.aruco.CharucoDetector(self._charuco).detectBoard(grey)
        if ids is None or len(ids) == 0:
            raise CaptureError("the board is not found")
        return Corners(np.ravel(ids).astype(np.int64), np.reshape(pixels, (-1, 2)).astype(np.float64))

    def _find_chessboard(self, grey: NDArray[np.uint8]) -> Corners:
        flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
        is_found, pixels = cv2.findChessboardCornersSB(grey, (self.columns, self.rows), flags=flags)
        if not is_found:
            raise CaptureError("the board is not found; all of it has to be in the picture")
        corners = self._refined(grey, np.reshape(pixels, (-1, 2)).astype(np.float32))
        is_turned = not self.is_symmetric and self._is_turned_round(grey, corners)
        return Corners(np.arange(len(corners)), corners[::-1] if is_turned else corners)

    def _refined(self, grey: NDArray[np.uint8], corners: NDArray[np.float32]) -> NDArray[np.float64]:
        """Move corners (N, 2) to where the edges meet: on a tilted board some are a pixel off."""
        grid = corners.reshape(self.rows, self.columns, 2)
        nearest = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min()) for axis in (0, 1))
        reach = int(np.clip(REFINED_WITHIN * nearest, 2, 15))
        cv2.cornerSubPix(grey, corners, (reach, reach), (-1, -1), REFINED_UNTIL)
        return corners.astype(np.float64)

    def _is_turned_round(self, grey: NDArray[np.uint8], corners: NDArray[np.float64]) -> bool:
        """Tell whether a chessboard's corners (N, 2) begin at its last: the square after the first is black."""
        grid = corners.reshape(self.rows, self.columns, 2)
        middles = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
        columns, rows = np.moveaxis(np.round(middles).astype(int), -1, 0)
        levels = grey[rows.clip(0, grey.shape[0] - 1), columns.clip(0, grey.shape[1] - 1)].astype(np.float64)
        is_black = np.indices(levels.shape).sum(axis=0) % 2 == 0
        return bool(levels[is_black].mean() > levels[~is_black].mean())


def parse_board(text: str) -> Board:
    """Parse a board such as `chessboard:9x6:25` or `charuco:11x8:30:22`, or raise a CaptureError if it is neither."""
    kind, _, rest = text.partition(":")
    parts = rest.split(":")
    try:
        columns, rows = map(int, parts[0].split("x"))
        if kind == "chessboard" and len(parts) == 2:
            return Board(kind, columns, rows, float(parts[1]))
        if kind == "charuco" and len(parts) in (3, 4):
            dictionary = parts[3] if len(parts) == 4 else DEFAULT_DICTIONARY
            if not (dictionary.startswith("DICT_") and hasattr(cv2.aruco, dictionary)):
                raise CaptureError(
                    f"board {text!r}: there is no dictionary {dictionary!r} in OpenCV, expected one such as "
                    f"{DEFAULT_DICTIONARY}"
                )
            return Board(kind, columns, rows, float(parts[1]), float(parts[2]), dictionary)
    except CaptureError:
        raise
    except ValueError as error:
        raise CaptureError(f"board {text!r}: expected {FORMS}") from error
    raise CaptureError(f"board {text!r}: expected {FORMS}")
