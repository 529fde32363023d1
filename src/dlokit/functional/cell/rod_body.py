"""The elastic rod of the cell, in the compiled model."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dlokit.description.rod import rod_nodes, set_rod_friction, set_rod_nodes
from dlokit.types.arrays import Float64Array


class RodBody:
    """A `DloBody` of the flex `rod`."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m]."""
        return rod_nodes(self._model, self._data)

    def place(self, nodes_world: ArrayLike) -> None:
        """Lay the rod along `nodes_world` (M, 3) [m], at rest."""
        set_rod_nodes(self._model, self._data, nodes_world)

    def set_friction(self, friction: ArrayLike) -> None:
        """Set the friction on the table to the mean of those at each node, (M,)."""
        # A rod has one coefficient: it feels the mean of the places where it lies.
        set_rod_friction(self._model, float(np.asarray(friction, dtype=np.float64).mean()))
