"""Friction that differs between regions of the table."""

from typing import Any

import numpy as np

from dlokit.description.shapes import CENTRE_M
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.dlo_physics import DloBody
from dlokit.types.arrays import Float64Array


class TableFriction:
    """Gives the DLO at each node the friction of the quarter of the table where it lies."""

    def __init__(self, model: Any, dlo: DloBody, config: CellConfig) -> None:
        """The quarters meet in the middle of where shapes lie."""
        self._dlo = dlo
        self._differs = set(config.table_regions) != {1.0}
        # Of two surfaces that touch the larger friction counts: the table's own must not hide what nodes are told.
        self._nominal = max(config.table_friction, config.dlo.friction)
        self._factors = np.array(config.table_regions).reshape(2, 2)  # near and far, right and left
        if self._differs:
            model.geom_friction[model.geom("table_top").id, 0] = 0.0

    def update(self) -> None:
        """Follow the DLO; call at least every few millimetres that it moves. Kinematics must be up to date."""
        if self._differs:
            self._dlo.set_friction(self.at(self._dlo.nodes_world[:, :2]))

    def at(self, places_world: Float64Array) -> Float64Array:
        """Coefficient of friction (K,) at places (K, 2) [m]."""
        far, left = (places_world[:, axis] >= CENTRE_M[axis] for axis in range(2))
        return self._nominal * self._factors[far.astype(np.int64), left.astype(np.int64)]
