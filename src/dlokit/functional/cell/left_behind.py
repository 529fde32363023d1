"""How a cell has left its DLO, for the cell that takes its place: reality stays as it is when its watchers crash."""

import zipfile
from pathlib import Path

import numpy as np

from dlokit.errors import InputError
from dlokit.functional.cell.truth import TruthRecorder
from dlokit.types.arrays import Float64Array


def left_nodes_world(folder: Path) -> Float64Array:
    """Where the DLO of the cell that ran in `folder` lay last, (Mc, 3) [m]; nobody but the next cell may be told.

    Raises `InputError` where no cell has left anything.
    """
    path = folder / TruthRecorder.FILE_NAME
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return np.array(arrays["nodes_world"][-1], dtype=np.float64)
    except (OSError, KeyError, ValueError, IndexError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path} does not tell how the cell left its DLO ({error}): start anew with dlokit shape --config "
            f"{folder / 'config.toml'}"
        ) from error
