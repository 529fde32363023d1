"""The file through which the cell's process learns how its DLO lies; no other process may read it."""

from pathlib import Path

import numpy as np

from dlokit.errors import InputError
from dlokit.types.arrays import Float64Array

NAME = "start.npy"

NOBODYS_BUSINESS: Float64Array = np.empty((0, 3))
"""What every component but the cell is given in its place."""


def write_start(run_dir: Path, nodes_world: Float64Array) -> None:
    """Leave the shape (K, 3) [m] in the run's folder."""
    np.save(run_dir / NAME, nodes_world, allow_pickle=False)


def read_start(run_dir: Path) -> Float64Array:
    """The shape (K, 3) [m]. Raises `InputError` when it is not there."""
    try:
        return np.load(run_dir / NAME, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{run_dir / NAME} cannot be read: {error}; it is written when a live run starts") from error
