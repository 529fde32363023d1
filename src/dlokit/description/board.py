"""The ChArUco board of a calibration: a chessboard whose white squares hold markers, so that each corner has a number.

Board frame: origin at the top left corner of the printed pattern, x right, y down, z into the board.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from dlokit.errors import ConfigError
from dlokit.types.arrays import Float64Array, UInt8Array

DICTIONARY = "DICT_4X4_50"
"""Markers of 4 by 4 cells have the largest cells for a given square, so they are readable with the fewest pixels."""
_MARKERS = 50
_FEWEST_SQUARES = 3


@dataclass(frozen=True, kw_only=True)
class CharucoBoard:
    """A board with its nominal sizes; the printer may have scaled it. By default it fits on A4."""

    columns: int = 7
    """Squares along x."""
    rows: int = 5
    """Squares along y."""
    square_m: float = 0.040
    """Side of a square [m]."""
    marker_m: float = 0.030
    """Side of a marker [m]."""

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < _FEWEST_SQUARES or self.columns * self.rows // 2 > _MARKERS:
            raise ConfigError(
                f"a board of {self.columns} by {self.rows} squares: at least {_FEWEST_SQUARES} by {_FEWEST_SQUARES} "
                f"and at most {2 * _MARKERS} squares are possible; print another board"
            )
        if not 0.0 < self.marker_m < self.square_m:
            raise ConfigError(
                f"markers of {self.marker_m} m in squares of {self.square_m} m: a marker is larger than 0 and smaller "
                "than its square; measure the print"
            )

    @property
    def size_m(self) -> tuple[float, float]:
        """Extent along x and y [m]."""
        return self.columns * self.square_m, self.rows * self.square_m

    @property
    def outline_board(self) -> Float64Array:
        """The corners (4, 3) [m] of the pattern, in order around it."""
        width_m, height_m = self.size_m
        return np.array([[0.0, 0.0, 0.0], [width_m, 0.0, 0.0], [width_m, height_m, 0.0], [0.0, height_m, 0.0]])

    @property
    def corners_board(self) -> Float64Array:
        """The inner corners (C, 3) [m], by their numbers."""
        return np.array(self.pattern().getChessboardCorners(), dtype=np.float64)

    def pattern(self) -> Any:
        """The board of OpenCV."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, dictionary)

    def picture(self, square_px: int) -> UInt8Array:
        """The pattern as grey values (rows * square_px, columns * square_px), without a margin; print this."""
        size = (self.columns * square_px, self.rows * square_px)
        return np.asarray(self.pattern().generateImage(size, marginSize=0), dtype=np.uint8)
