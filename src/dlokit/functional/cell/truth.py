"""The record of truth: the true nodes of the DLO, in a separate file of the run's folder, never on the bus."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dlokit.types.arrays import Float64Array

if TYPE_CHECKING:
    from dlokit.functional.cell.world import Cell

TRUTH_FILE = "truth.npz"


class TruthRecorder:
    """Notes the true nodes at 10 Hz and writes them to `truth.npz`: stamps_ns (T,), nodes_world (T, Mc, 3) [m]."""

    PERIOD_NS = 100_000_000
    WRITE_NS = 30_000_000_000
    """Period of rewriting the file [ns], so that a killed cell leaves most of it."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / TRUTH_FILE
        self._stamps_ns: list[int] = []
        self._nodes_world: list[Float64Array] = []
        self._written_ns = 0

    def note(self, cell: "Cell") -> None:
        """Note the nodes now, unless the last note is too recent. Call once per tick."""
        if self._stamps_ns and cell.time_ns - self._stamps_ns[-1] < self.PERIOD_NS:
            return
        self._stamps_ns.append(cell.time_ns)
        self._nodes_world.append(cell.true_nodes_world())
        if cell.time_ns - self._written_ns >= self.WRITE_NS:
            self.write()

    def write(self) -> None:
        """Write the notes; an incomplete file never replaces a complete one."""
        if not self._stamps_ns:
            return
        self._path.parent.mkdir(parents=True, exist_ok=True)
        draft = self._path.with_name("truth.partial.npz")
        np.savez(draft, stamps_ns=np.array(self._stamps_ns, dtype=np.int64), nodes_world=np.array(self._nodes_world))
        draft.replace(self._path)
        self._written_ns = self._stamps_ns[-1]
