"""The folder of a run, which is never reused, with a file that gives only the cell's process the initial shape."""

import re
from datetime import datetime
from pathlib import Path

import numpy as np

from dlokit.errors import InputError
from dlokit.types.arrays import Float64Array

_NAME_LIMIT = 80  # file systems allow 255 bytes; nested folders leave less


def new_run_folder(root: Path, name: str, started: datetime) -> Path:
    """Create `root/<time>-<name>/`, with a number appended if it exists already.

    Raises `InputError` when the folder cannot be created.
    """
    stem = f"{started:%Y%m%d-%H%M%S}-{_slug(name)}"
    number = 1
    while True:
        path = root / (stem if number == 1 else f"{stem}-{number}")
        try:
            # Creating the folder is the test, so that two runs started together cannot share it.
            path.mkdir(parents=True, exist_ok=False)
        except FileExistsError:
            if not path.is_dir():
                raise InputError(f"{path} is a file: move it away, or choose another --out.") from None
            number += 1
        except OSError as error:
            raise _cannot_write(path, error) from error
        else:
            return path


def claim_run_folder(path: Path) -> Path:
    """Claim and create the folder given by the user. Raises `InputError` when it is not empty."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        occupied = next(path.iterdir(), None)
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"--out {path} is a file: name a folder that is empty or does not exist.") from None
    except OSError as error:
        raise _cannot_write(path, error) from error
    if occupied is not None:
        raise InputError(
            f"--out {path} is not empty (it holds {occupied.name}): runs are never overwritten; name a folder "
            "that is empty or does not exist."
        )
    return path


def _cannot_write(path: Path, error: OSError) -> InputError:
    return InputError(f"Cannot create {path} ({error.strerror}): choose a folder you may write to with --out.")


def _slug(name: str) -> str:
    """A name that is safe in a path on every system."""
    return re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-.")[:_NAME_LIMIT] or "run"


NAME = "start.npy"

HIDDEN_START: Float64Array = np.empty((0, 3))
"""Given to every component except the cell instead of the initial shape."""


def write_start(run_dir: Path, nodes_world: Float64Array) -> None:
    """Write the initial shape (K, 3) [m] to the run's folder."""
    np.save(run_dir / NAME, nodes_world, allow_pickle=False)


def read_start(run_dir: Path) -> Float64Array:
    """The initial shape (K, 3) [m]. Raises `InputError` when the file is missing."""
    try:
        return np.load(run_dir / NAME, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise InputError(f"{run_dir / NAME} cannot be read: {error}; it is written when a live run starts") from error
