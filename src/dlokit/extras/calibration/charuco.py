"""The corners of a ChArUco board in a picture, each with its number."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from dlokit.description.board import CharucoBoard
from dlokit.skills.perception.rectification import grey
from dlokit.types.arrays import Float64Array, Int64Array, UInt8Array

FEWEST_CORNERS = 8
"""Least number of corners of a used picture: fewer give an uncertain pose."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardView:
    """The corners of a board that one picture shows."""

    numbers: Int64Array  # (N,) rows of `CharucoBoard.corners_board`
    pixels: Float64Array  # (N, 2) u, v [px]


def find_board(picture: UInt8Array, board: CharucoBoard) -> BoardView | None:
    """The corners of `board` in a picture (height, width) or (height, width, 3); None when it shows too few."""
    detector = cv2.aruco.CharucoDetector(board.pattern())
    found: Any = detector.detectBoard(grey(picture))
    corners, numbers = found[:2]
    if numbers is None or len(numbers) < FEWEST_CORNERS:
        return None
    return BoardView(
        numbers=np.asarray(numbers, dtype=np.int64).ravel(),
        pixels=np.asarray(corners, dtype=np.float64).reshape(-1, 2),
    )
