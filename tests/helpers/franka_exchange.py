"""A recorded exchange of the Franka's streaming process with franky-sim's arm: states, and the set-points given."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dlokit.description.arm.franka import FR3
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move
from dlokit.types.arrays import Float64Array

FILE = Path(__file__).parents[1] / "replay" / "references" / "franka_exchange.npz"
MOVE = scaled(
    joint_move(FR3.home_q_rad, FR3.home_q_rad + np.array([0.9, 0.4, -0.5, 0.6, 0.4, 0.5, -0.6]), FR3.limits), 0.5
)
NOTHING = np.full(7, np.nan)


class RecordedTurn(NamedTuple):
    """What was read in a turn, and what was set then; NaN where nothing was."""

    robot_ms: int
    mode: int
    q: Float64Array
    dq: Float64Array
    target_q: Float64Array = NOTHING
    target_dq: Float64Array = NOTHING


def write_exchange(turns: Sequence[RecordedTurn]) -> None:
    """Write the file."""
    columns = {name: np.array([getattr(turn, name) for turn in turns]) for name in RecordedTurn._fields}
    np.savez_compressed(FILE, allow_pickle=False, **columns)


def read_exchange() -> list[RecordedTurn]:
    """The turns of the file."""
    with np.load(FILE) as columns:
        rows = [columns[name] for name in RecordedTurn._fields]
    return [RecordedTurn(int(row[0]), int(row[1]), *row[2:]) for row in zip(*rows, strict=True)]
