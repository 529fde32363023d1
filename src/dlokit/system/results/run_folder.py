"""The folder of a run, which is never reused, with a file that gives only the cell's process the initial shape."""

import fcntl
import io
import os
import re
import shutil
from collections.abc import Generator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

import numpy as np
import psutil

from dlokit.communication.wire import codec
from dlokit.decision.journal import Journal
from dlokit.errors import CommunicationError, InputError, MachineError
from dlokit.recording.disk import Disk, write_synced
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.types.arrays import Float64Array

_NAME_LIMIT = 80  # file systems allow 255 bytes; nested folders leave less


RUNS = Path("runs")
"""Where the folders of runs are created, unless the user names another."""


def run_folder(out: Path | None, name: str) -> Path:
    """The folder `out`, claimed; without one, a new folder for what begins now. Raises `InputError`."""
    return new_run_folder(RUNS, name, datetime.now()) if out is None else claim_run_folder(out)


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
                raise InputError(f"{path} is a file: move it away, or choose another folder.") from None
            number += 1
        except OSError as error:
            raise _cannot_write(path, error) from error
        else:
            return path


CLAIM = ".claimed"
"""File in a folder that a run has claimed: process id and start time of the run."""


def claim_run_folder(path: Path) -> Path:
    """Claim and create the folder given by the user; of several runs at once, one gets it.

    Raises `InputError` when the folder is not empty, or another process has claimed it and still runs.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with _locked(path):
            _claim(path)
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{path} is a file: name a folder that is empty or does not exist.") from None
    except OSError as error:
        raise _cannot_write(path, error) from error
    return path


@contextmanager
def removed_if_refused(folder: Path) -> Generator[None]:
    """Remove a folder that this process has claimed if the block raises `InputError`: nothing has begun."""
    try:
        yield
    except InputError:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def release_claim(path: Path) -> None:
    """Remove the claim of this process, whose folder is then what it wrote and no more."""
    claim = path / CLAIM
    with suppress(OSError):
        if claim.read_text(encoding="ascii", errors="replace") == _claim_of(os.getpid()):
            claim.unlink()


def _claim(path: Path) -> None:
    occupied = next((entry for entry in path.iterdir() if entry.name != CLAIM), None)
    if occupied is not None:
        raise InputError(
            f"{path} is not empty (it holds {occupied.name}): runs are never overwritten; name a folder "
            "that is empty or does not exist."
        )
    claim, own = path / CLAIM, _claim_of(os.getpid())
    if claim.exists() and (text := claim.read_text(encoding="ascii", errors="replace")) != own and _is_alive(text):
        raise InputError(f"{path} was claimed by another run that still starts: name another folder.")
    claim.write_text(own, encoding="ascii")


def _claim_of(pid: int) -> str:
    return f"{pid} {psutil.Process(pid).create_time()}"


def _is_alive(claim: str) -> bool:
    """Whether the process of a claim still runs; process ids are reused, so its start time counts too."""
    try:
        return _claim_of(int(claim.partition(" ")[0])) == claim
    except (ValueError, psutil.Error):
        return False


@contextmanager
def _locked(folder: Path) -> Generator[None]:
    """Exclude other processes; a file system without locks excludes none."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _cannot_write(path: Path, error: OSError) -> InputError:
    return InputError(f"Cannot create {path} ({error.strerror}): choose a folder you may write to.")


def _slug(name: str) -> str:
    """A name that is safe in a path on every system."""
    return re.sub(r"[^A-Za-z0-9._]+", "-", name).strip("-.")[:_NAME_LIMIT] or "run"


START_FILE = "start.npy"

HIDDEN_START: Float64Array = np.empty((0, 3))
"""Replaces the initial shape in every component except the cell."""


def write_start(run_dir: Path, nodes_world: Float64Array) -> None:
    """Write the initial shape (K, 3) [m] to the run's folder. Raises `MachineError` when it cannot be written."""
    file = io.BytesIO()
    np.save(file, nodes_world, allow_pickle=False)
    _write_input(run_dir / START_FILE, file.getvalue())


def write_config(run_dir: Path, config: RunConfig) -> None:
    """Write the configuration to the run's folder. Raises `MachineError` when it cannot be written."""
    _write_input(run_dir / CONFIG_FILE, to_toml(config).encode())


def _write_input(path: Path, data: bytes) -> None:
    """Write a file without which a run cannot start."""
    try:
        write_synced(path, data)
    except OSError as error:
        raise MachineError(
            f"{path} cannot be written ({error.strerror}), so the run does not start: free space on the disk, or "
            "choose another folder with --out."
        ) from error


def read_start(run_dir: Path) -> Float64Array:
    """The initial shape (K, 3) [m]. Raises `InputError` when the file is missing."""
    try:
        return np.load(run_dir / START_FILE, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{run_dir / START_FILE} cannot be read: {error}; it is written when a live run starts"
        ) from error


JOURNAL_FILE = "journal.msgpack"


class JournalFile:
    """Stores the latest journal of a run; a crash or power loss leaves the file intact."""

    def __init__(self, run_dir: Path, disk: Disk) -> None:
        self._path = run_dir / JOURNAL_FILE
        self._disk = disk

    def keep(self, journal: Journal) -> None:
        """Replace the file soon. A full disk does not end the task, which then cannot be resumed from here."""
        self._disk.put(JOURNAL_FILE, lambda: write_synced(self._path, codec.encode(journal)))


def read_journal(run_dir: Path) -> Journal:
    """The latest journal. Raises `InputError` when it is missing, or this version cannot read it."""
    path = run_dir / JOURNAL_FILE
    try:
        return codec.decode(path.read_bytes(), Journal)
    except OSError:
        raise InputError(
            f"{run_dir} has no {JOURNAL_FILE}: it is not a live run, or its goal was not set yet; start it again with "
            f"dlokit shape --config {run_dir / 'config.toml'}"
        ) from None
    except CommunicationError as error:
        raise InputError(f"{path} cannot be read ({error}): it is of another version; start the run again.") from error
