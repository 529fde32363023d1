"""The cell's hidden truth, as it lies in `truth.npz`. Nothing but the evaluator and the tests reads it."""

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dlokit.errors import InputError
from dlokit.types.arrays import Float64Array, Int64Array

FILE_NAME = "truth.npz"


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Where the DLO really was, all along a run."""

    stamps_ns: Int64Array  # (T,) rising, on the cell's clock [ns]
    nodes_world: Float64Array  # (T, Mc, 3) [m], Mc nodes of the cell's own rod

    def at(self, stamp_ns: int) -> Float64Array:
        """Nodes (Mc, 3) [m] at a time, interpolated between the two records around it; held before and after."""
        last = len(self.stamps_ns) - 1
        after = int(np.clip(np.searchsorted(self.stamps_ns, stamp_ns), min(1, last), last))
        before = max(after - 1, 0)
        span = float(self.stamps_ns[after] - self.stamps_ns[before])
        part = 0.0 if span == 0.0 else float(np.clip((stamp_ns - self.stamps_ns[before]) / span, 0.0, 1.0))
        return (1.0 - part) * self.nodes_world[before] + part * self.nodes_world[after]


def read_truth(folder: Path) -> Truth:
    """The truth in a run's folder. Raises `InputError` when it is missing or has another layout."""
    path = folder / FILE_NAME
    try:
        with np.load(path, allow_pickle=False) as arrays:
            stamps, nodes = np.asarray(arrays["stamps_ns"]), np.asarray(arrays["nodes_world"])
    except FileNotFoundError:
        raise InputError(f"{folder} holds no {FILE_NAME}: only runs on the simulated cell have one.") from None
    except (KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is not a cell's truth ({error}): run it again.") from error
    if stamps.ndim != 1 or len(stamps) == 0 or nodes.ndim != 3 or nodes.shape[::2] != (len(stamps), 3):
        raise InputError(
            f"{path} holds stamps_ns {stamps.shape} and nodes_world {nodes.shape}; expected (T,) and (T, Mc, 3) "
            "with T of at least 1: run it again."
        )
    return Truth(stamps_ns=stamps.astype(np.int64), nodes_world=nodes.astype(np.float64))
