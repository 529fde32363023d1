"""The two physics of the cell's DLO behind one small interface: an elastic rod, and a chain that takes a set.

The choice between them is a setting, and every process loads the settings: a method imports what it calls.
"""

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, get_args

from numpy.typing import ArrayLike

from dlokit.description.dlo import DloPreset
from dlokit.types.arrays import Float64Array


class DloBody(Protocol):
    """The DLO in a compiled model. Cameras and fingers meet it as any other body."""

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m], equally far apart on the centre line, world frame. Kinematics must be up to date."""
        ...

    def place(self, nodes_world: ArrayLike) -> None:
        """Lay the DLO, relaxed before, along `nodes_world` (M, 3) [m], at rest."""
        ...

    def set_friction(self, friction: ArrayLike) -> None:
        """Set the coefficient of sliding friction on the table at each node, (M,)."""
        ...


@dataclass(frozen=True, kw_only=True)
class ElasticRod:
    """A discrete elastic rod: it always springs back."""

    name: ClassVar[str] = "rod"

    def add(self, spec: Any, dlo: DloPreset, nodes: int) -> None:
        """Add the DLO to `spec` (MjSpec)."""
        from dlokit.rod.elastic import add_rod

        add_rod(spec, dlo, nodes, hangs=True)

    def take_over(self, model: Any, data: Any, dlo: DloPreset) -> DloBody:
        """The DLO that `add` has added, in the compiled model."""
        from dlokit.rod.elastic import RodBody

        return RodBody(model, data)


@dataclass(frozen=True, kw_only=True)
class ElastoplasticChain:
    """Capsules on ball joints: what is bent beyond the DLO's yield curvature stays bent."""

    name: ClassVar[str] = "chain"

    def add(self, spec: Any, dlo: DloPreset, nodes: int) -> None:
        """Add the DLO to `spec` (MjSpec)."""
        from dlokit.rod.chain import add_chain

        add_chain(spec, dlo, nodes)

    def take_over(self, model: Any, data: Any, dlo: DloPreset) -> DloBody:
        """The DLO that `add` has added, in the compiled model."""
        from dlokit.rod.chain import Chain

        return Chain(model, data, dlo.curl_1_m)


DloPhysics = ElasticRod | ElastoplasticChain
"""The physics that the cell has, the default first."""

PHYSICS: dict[str, type[DloPhysics]] = {kind.name: kind for kind in get_args(DloPhysics)}
"""The same by name."""
