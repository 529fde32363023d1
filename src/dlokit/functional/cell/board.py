"""The calibration board of the cell: held by the first arm or on the table, with errors of print, grasp and joints.

These values are ground truth: a calibration gets pictures and the reported state of the arm, and estimates the rest.
"""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dlokit import geometry
from dlokit.description.arm.model import HAND, ArmModel
from dlokit.description.board import CharucoBoard
from dlokit.functional.cell.config import CellBoard
from dlokit.functional.cell.rendering import displaced
from dlokit.functional.cell.surroundings import add_printed_material
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

BOARD = CharucoBoard()
"""The nominal board, without printing errors."""
T_TCP_BOARD = geometry.pose_from_matrix(
    np.array(
        [
            [0.0, 0.0, -1.0, 0.035],
            [-1.0, 0.0, 0.0, BOARD.size_m[0] / 2],
            [0.0, 1.0, 0.0, 0.050 - BOARD.size_m[1] / 2],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
)
"""Pose in which the arm holds the board, by a block on its back between the fingers; it faces along x of the tool."""
PRINT_SCALE = 1.002
"""Size of the printed board over its nominal size: a typical error of office printers."""
JOINT_OFFSET_DEG = 0.1
"""Error of each joint's reported angle [°], of either sign: typical of a good arm after mastering."""
HELD_M, HELD_DEG = 0.005, 2.0
"""Distance and angle between the nominal pose and the pose in which a person clamps the board."""
T_WORLD_BOARD = geometry.pose_from_matrix(
    np.array(
        [
            [-1.0, 0.0, 0.0, 0.52 + BOARD.size_m[0] / 2],
            [0.0, 1.0, 0.0, 0.02 - BOARD.size_m[1] / 2],
            [0.0, 0.0, -1.0, 0.004],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
)
"""Pose of the board on the table, face up: its back touches the table."""

_STREAM = 0xB0  # separates these draws from all other draws of the same seed
_SQUARE_PX = 96  # of the texture; a picture shows a square with a third of it, and the graphics average
_PLATE_M = 0.004
_LIGHT = 0.9  # grey of the paper, of 1


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueBoard:
    """The errors drawn for the board of one run."""

    scale: float
    """Size of the print over the nominal size."""
    arm: ArmModel
    joint_offsets_rad: Float64Array  # (J,) reported minus true angles
    T_tcp_board: Pose | None
    """None: the board is on the table, at `T_WORLD_BOARD`."""


def draw_board(config: CellBoard, seed: int, arm: ArmModel) -> TrueBoard:
    """Draw the errors of a board's grasp and of the joints; each joint is off by `JOINT_OFFSET_DEG`, to either side."""
    rng = np.random.default_rng([seed, _STREAM])
    offsets = np.radians(JOINT_OFFSET_DEG) * rng.choice([-1.0, 1.0], size=len(arm.joints))
    held = displaced(T_TCP_BOARD, HELD_M, HELD_DEG, rng)
    return TrueBoard(
        arm=arm,
        scale=PRINT_SCALE,
        joint_offsets_rad=offsets,
        T_tcp_board=held if config.held else None,
    )


def add_board(spec: Any, board: TrueBoard, robot: str) -> None:
    """Add the board to `spec` (MjSpec), to the hand of the arm `robot` or to the table; nothing collides with it."""
    pixels = np.repeat(BOARD.picture(_SQUARE_PX)[:, :, None], 3, axis=2)
    add_printed_material(spec, "board", (_LIGHT * pixels).astype(np.uint8))
    width_m, height_m = (board.scale * extent for extent in BOARD.size_m)
    front = spec.add_mesh(name="board")
    # The printed side, and a point behind it: a mesh needs a volume.
    front.uservert = [0, 0, 0, width_m, 0, 0, width_m, height_m, 0, 0, height_m, 0, width_m / 2, height_m / 2, _PLATE_M]
    front.usertexcoord = [0, 0, 1, 0, 1, 1, 0, 1, 0.5, 0.5]
    front.userface = [0, 2, 1, 0, 3, 2, 0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4]
    front.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    held = board.T_tcp_board
    if held is None:
        body, place = spec.worldbody, T_WORLD_BOARD
    else:
        body = spec.body(f"{robot}/{HAND}")
        place = geometry.compose(geometry.pose((0.0, 0.0, board.arm.gripper.tcp_m)), held)
    body.add_geom(
        name="board",
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname="board",
        material="board",
        pos=place.position_m,
        quat=place.wxyz,
        group=0,
        contype=0,
        conaffinity=0,
        mass=0.0,
    )
