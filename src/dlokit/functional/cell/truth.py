"""The record of truth: the true nodes of the DLO and the forces on fixtures, in separate files of the run's folder,
never on the bus."""

import io
import json
import threading
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dlokit.recording.disk import Disk, write_synced
from dlokit.types.arrays import Float64Array, Int64Array, RowArray

if TYPE_CHECKING:
    from dlokit.functional.cell.world import Cell

TRUTH_FILE = "truth.npz"
ROWS_FILE = "truth.rows"
"""File that grows during the run, and becomes `truth.npz` at its end; it remains after a kill or a full disk."""
FORCES_FILE = "truth.forces.json"
"""File of the forces on fixtures, replaced when they have grown: a task of a run that goes on is judged by it. At the
end of the run they are in `truth.npz`."""
NO_FORCES: RowArray = np.zeros(0, [("link", "U64"), ("fixture", "U20"), ("force_n", "f8"), ("stamp_ns", "i8")])
"""The largest force [N] of each link of an arm that touched a fixture on that fixture, a row each; none yet."""


class TruthRecorder:
    """Notes the true nodes at 10 Hz; `truth.npz` has stamps_ns (T,) and nodes_world (T, Mc, 3) [m].

    In a cell with fixtures it also has fixture_forces, the rows of `NO_FORCES` over all physics steps of the run.
    A separate thread writes, so that the cell's clock does not wait for the disk.
    """

    PERIOD_NS = 100_000_000
    WRITE_NS = 1_000_000_000
    """Period of appending to the file [ns]; a killed cell loses the notes since the last one."""
    WAITING_ROWS = 36_000
    """Largest number of notes that wait for a disk: one hour, about 45 MB; then the oldest are dropped."""

    def __init__(self, folder: Path, disk: Disk | None = None) -> None:
        self._folder = folder
        self._disk = disk or Disk()
        self._lock = threading.Lock()
        self._waiting: deque[tuple[int, Float64Array]] = deque(maxlen=self.WAITING_ROWS)
        self._dropped = False
        self._forces: RowArray | None = None
        self._written_forces: RowArray | None = None
        self._noted_ns: int | None = None
        self._appended_ns = 0
        self._size = 0
        """Length of the whole rows in the file [bytes]."""

    def note(self, cell: "Cell") -> None:
        """Note the nodes now, unless the last note is too recent. Call once per tick."""
        now_ns = cell.time_ns
        self._forces = cell.fixture_forces
        if self._noted_ns is not None and now_ns - self._noted_ns < self.PERIOD_NS:
            return
        self._noted_ns = now_ns
        with self._lock:
            self._dropped |= len(self._waiting) == self.WAITING_ROWS
            self._waiting.append((now_ns, cell.true_nodes_world()))
        if now_ns - self._appended_ns >= self.WRITE_NS:
            self._appended_ns = now_ns
            self._disk.put(TRUTH_FILE, self._append)

    def write(self) -> None:
        """Write `truth.npz` of all notes; waits for the disk, though not for ever."""
        if self._noted_ns is not None:
            self._disk.written(TRUTH_FILE, self._finish)

    def _append(self) -> None:
        with self._lock:
            rows = list(self._waiting)
        if not rows:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        if (forces := self._forces) is not None and forces is not self._written_forces:
            write_synced(self._folder / FORCES_FILE, json.dumps(forces.tolist()).encode())
            self._written_forces = forces
        path = self._folder / ROWS_FILE
        data = b"".join(_row(stamp_ns, nodes) for stamp_ns, nodes in rows)
        if self._size == 0:
            data = np.int64(len(rows[0][1])).tobytes() + data
        with path.open("r+b" if self._size else "wb", buffering=0) as file:
            file.truncate(self._size)  # a full disk may have left a part of a row
            file.seek(self._size)
            written = 0
            while written < len(data):
                written += file.write(data[written:])
        self._size += len(data)
        with self._lock:
            for _ in rows:
                self._waiting.popleft()

    def _finish(self) -> None:
        self._append()
        if self._dropped:
            raise OSError(0, "the disk did not respond for an hour, and notes were dropped")
        stamps_ns, nodes_world = read_rows(self._folder)
        arrays: dict[str, Any] = {"stamps_ns": stamps_ns, "nodes_world": nodes_world}
        if self._forces is not None:
            arrays["fixture_forces"] = self._forces
        file = io.BytesIO()
        np.savez(file, **arrays)
        write_synced(self._folder / TRUTH_FILE, file.getvalue())
        (self._folder / ROWS_FILE).unlink()
        (self._folder / FORCES_FILE).unlink(missing_ok=True)


def _row(stamp_ns: int, nodes_world: Float64Array) -> bytes:
    return np.int64(stamp_ns).tobytes() + np.ascontiguousarray(nodes_world, dtype=np.float64).tobytes()


def read_rows(folder: Path) -> tuple[Int64Array, Float64Array]:
    """Stamps (T,) [ns] and nodes (T, Mc, 3) [m] of a cell that did not end correctly, up to the last whole row.

    Raises `OSError` when there is no such file, and `ValueError` when it has no row.
    """
    data = (folder / ROWS_FILE).read_bytes()
    nodes = int(np.frombuffer(data[:8], dtype=np.int64)[0]) if len(data) >= 8 else 0
    row = np.dtype([("stamp_ns", np.int64), ("nodes_world", np.float64, (nodes, 3))])
    if nodes < 1 or len(data) < 8 + row.itemsize:
        raise ValueError("it has no complete row")
    rows = np.frombuffer(data, dtype=row, offset=8, count=(len(data) - 8) // row.itemsize)
    return np.array(rows["stamp_ns"]), np.array(rows["nodes_world"])


def read_forces(folder: Path) -> RowArray | None:
    """The forces on fixtures in a cell that did not end correctly; None without fixtures. Raises as `read_rows`."""
    path = folder / FORCES_FILE
    return np.array([tuple(row) for row in json.loads(path.read_bytes())], NO_FORCES.dtype) if path.exists() else None
