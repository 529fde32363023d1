"""`--oracle`: the cell's ground truth replaces camera, perception and observer as the source of the state.

It evaluates planning and control without the errors of perception. The ground truth is published as targets within
this process, and only by this bench.
"""

import asyncio
from collections.abc import Callable

import numpy as np

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.description.default_cameras import default_calibration
from dlokit.errors import SkillRejected
from dlokit.functional.cell.component import CellComponent
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.system.build import Build, Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import TargetPoints
from dlokit.types.observation import CameraView, LookResult, Observation
from dlokit.types.system import StrategySpec

Truth = Callable[[], Float64Array]
"""Current shape of the DLO, (Mc, 3) [m]."""
_POINTS = 600


class OracleBuild:
    """Builds the components of a system, with perception and observer replaced by the ground truth."""

    def __init__(self, build: Build = build_component) -> None:
        """`build` builds the others."""
        self._build = build
        self._cell: CellComponent | None = None

    def __call__(self, name: str, config: RunConfig, wiring: Wiring) -> Component:
        """Build the component `name`; the cell comes first."""
        match name:
            case "perception":
                return OraclePerception(self._truth)
            case "observer":
                return OracleObserver(self._truth, nodes=config.model.nodes)
            case _:
                component = self._build(name, config, wiring)
                if isinstance(component, CellComponent):
                    self._cell = component
                return component

    def _truth(self) -> Float64Array:
        assert self._cell is not None, "the cell is built before the first look"
        return self._cell.true_nodes_world()


class OraclePerception(Component):
    """Perception that sees the complete centre line of the DLO at any time."""

    name = "perception"
    publishes = (topics.OBSERVATION, topics.CAMERA)

    def __init__(self, truth: Truth) -> None:
        self._truth = truth
        self._rate_hz = 0.0
        self._rate_changed = asyncio.Event()

    @implements(perception.LOOK)
    async def look(self) -> LookResult:
        """Look now."""
        stamp_ns, camera = self.port.clock.now_ns(), default_calibration()
        points = geometry.resample(self._truth(), _POINTS).astype(np.float32)
        self.port.publish(topics.OBSERVATION, Observation(stamp_ns=stamp_ns, points_world=points, calibration=camera))
        self.port.publish(topics.CAMERA, CameraView(stamp_ns=stamp_ns, calibration=camera))
        return LookResult(stamp_ns=stamp_ns, points=len(points))

    @implements(perception.SET_TRACKING)
    async def set_tracking(self, rate_hz: float) -> None:
        """Look at a rate."""
        self._rate_hz = rate_hz
        self._rate_changed.set()

    @implements(perception.SET_BOX)
    async def set_box(self, lower_world: Float64Array, upper_world: Float64Array) -> None:
        """Ignored: nothing is filtered."""

    @implements(perception.SET_SEGMENTATION)
    async def set_segmentation(self, spec: StrategySpec) -> None:
        """There are no pictures."""
        raise SkillRejected("unknown_strategy", "an oracle has no pictures to segment")

    async def run(self) -> None:
        """Look at the set rate."""
        while True:
            if self._rate_hz > 0.0:
                await self.look()
                await self.port.clock.sleep(1.0 / self._rate_hz)
            else:
                self._rate_changed.clear()
                await self._rate_changed.wait()  # until a rate is set or the component ends


class OracleObserver(Component):
    """Observer that returns the true nodes as targets, in an order chosen at its initialisation."""

    name = "observer"
    publishes = (topics.TARGETS,)

    def __init__(self, truth: Truth, *, nodes: int) -> None:
        """`nodes` M are the model's."""
        self._truth = truth
        self._count = nodes
        self._last: TargetPoints | None = None

    @on(topics.OBSERVATION)
    async def on_observation(self, seen: Observation) -> None:
        """Publish targets, once initialised."""
        if self._last is not None and seen.stamp_ns > self._last.stamp_ns:
            self._publish(self._last.nodes_world)

    @implements(observer.INITIALISE)
    async def initialise(self, after_stamp_ns: int = 0, towards_world: Float64Array | None = None) -> TargetPoints:
        """Choose the order: the nearer to a curve, or to the previous shape, else the left end first."""
        if towards_world is not None:
            return self._publish(geometry.resample(towards_world, self._count))
        if self._last is not None:
            return self._publish(self._last.nodes_world)
        nodes = geometry.resample(self._truth(), self._count)
        return self._publish(nodes if nodes[0, 1] >= nodes[-1, 1] else nodes[::-1])

    @implements(observer.SET_STRATEGY)
    async def set_strategy(self, spec: StrategySpec) -> None:
        """Rejected: there is no strategy to choose."""
        raise SkillRejected("unknown_strategy", "an oracle needs no strategy")

    @implements(observer.RESET)
    async def reset(self) -> None:
        """Forget the order."""
        self._last = None

    def _publish(self, like_world: Float64Array) -> TargetPoints:
        """The truth in the order that is nearer to a curve (M, 3) [m]."""
        nodes = geometry.resample(self._truth(), self._count)
        if geometry.rmse_m(nodes[::-1], like_world) < geometry.rmse_m(nodes, like_world):
            nodes = nodes[::-1]
        targets = TargetPoints(
            stamp_ns=self.port.clock.now_ns(),
            nodes_world=nodes.copy(),
            visible=np.ones(self._count, dtype=np.bool_),
        )
        self._last = targets
        self.port.publish(topics.TARGETS, targets)
        return targets
