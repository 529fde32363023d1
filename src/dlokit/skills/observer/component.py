"""The observer component: publishes target points for every cloud."""

import asyncio
from collections.abc import Callable
from functools import partial

import msgspec

from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.errors import SkillFailure
from dlokit.geometry import rmse_m
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer import api
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.base import ObserverStrategy, prior_from, without_memory
from dlokit.skills.observer.config import ObserverConfig, from_spec
from dlokit.skills.observer.following import ELSEWHERE_M, cleaned, followed
from dlokit.skills.observer.initialise.first_shape import initial_targets
from dlokit.skills.observer.kernels import load_kernels
from dlokit.skills.observer.visibility import thickness
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import DistrustReason, Observation, ObserverEvent, ObserverEventKind
from dlokit.types.system import StrategySpec

FOUND_MARGIN = 0.05
"""Hysteresis of the health above which a lost rod counts as found, so that a fluctuating health does not cause
repeated events."""


class ObserverComponent(Component):
    """Orders the first cloud into nodes, then tracks them from cloud to cloud."""

    name = "observer"
    publishes = (topics.TARGETS, topics.OBSERVER_EVENT)
    reads = (topics.STATE,)

    def __init__(self, config: ObserverConfig, dlo: BelievedDlo) -> None:
        """`dlo` is the model's: targets and state have the same nodes."""
        super().__init__()
        self._config = config
        self._dlo = dlo
        self._topology = chain(dlo.nodes, dlo.length_m)
        self._strategy: ObserverStrategy = config.strategy.build(dlo)
        self._newest: Observation | None = None
        self._arrived = asyncio.Event()
        self._last: TargetPoints | None = None
        """The last published targets; None before the rod was found."""
        self._inherits = True
        """Whether a memory in the model's state may be that of this observer's previous process."""
        self._lost = False
        self._refusing = False

    def preparation(self) -> Callable[[], object]:
        """Load the compiled code of the strategy."""
        return partial(load_kernels, (self._config.strategy,))

    @on(topics.OBSERVATION)
    async def on_observation(self, seen: Observation) -> None:
        """Estimate from the newest state and publish; before the first `INITIALISE` only keep the cloud."""
        self._newest = seen
        self._arrived.set()
        if self._last is None:
            return
        if seen.stamp_ns <= self._last.stamp_ns:
            if seen.stamp_ns < self._last.stamp_ns:  # a cloud with an equal stamp is the one that `INITIALISE` took
                self._refuse(seen)
            return
        self._refusing = False
        last, tracked = self._last, self._tracked(self._last)
        prior = tracked or prior_from(last, self._topology)
        answer = await self.port.compute(followed, self._strategy, seen, prior, self._config, self._dlo.radius_m)
        if self._last is not last:  # meanwhile `INITIALISE` has found the rod, or `RESET` has forgotten it
            return
        prior_stamp_ns = 0 if tracked is None else tracked.stamp_ns
        self._publish(msgspec.structs.replace(answer.targets, prior_stamp_ns=prior_stamp_ns))
        self._report(answer.targets, answer.distrust)

    @implements(api.INITIALISE)
    async def initialise(self, after_stamp_ns: int = 0, towards_world: Float64Array | None = None) -> TargetPoints:
        """Order the newest cloud into nodes and publish them."""
        seen = await self._cloud_after(after_stamp_ns)
        before = towards_world
        if before is None and self._last is not None:
            before = self._prior(self._last).nodes_world
        targets = await self.port.compute(
            initial_targets,
            cleaned(seen),
            self._dlo.nodes,
            self._dlo.length_m,
            before,
            self._dlo.radius_m,
        )
        targets = msgspec.structs.replace(targets, memory=self._remembered(targets))
        self._publish(targets)
        self._lost = self._refusing = False
        return targets

    @implements(api.SET_STRATEGY)
    async def set_strategy(self, spec: StrategySpec) -> None:
        """Replace the strategy, and forget the memory of the previous one."""
        self._strategy = from_spec(spec).build(self._dlo)
        self._inherits = False
        if self._last is not None:
            self._last = without_memory(self._last)

    @implements(api.RESET)
    async def reset(self) -> None:
        """Forget the rod."""
        self._last, self._inherits = None, False

    def _publish(self, targets: TargetPoints) -> None:
        self._last = targets
        self.port.publish(topics.TARGETS, targets)

    def _report(self, targets: TargetPoints, distrust: DistrustReason | None) -> None:
        """Publish an event when the rod is lost, and when it is found again."""
        limit = self._config.lost_health + (FOUND_MARGIN if self._lost else 0.0)
        lost = targets.health < limit
        if lost is not self._lost:
            self._lost = lost
            kind = ObserverEventKind.LOST if lost else ObserverEventKind.FOUND_AGAIN
            self._publish_event(targets.stamp_ns, kind, distrust if lost else None, targets.health)

    def _refuse(self, seen: Observation) -> None:
        """Publish an event at the first of several clouds that are not newer than the targets."""
        if not self._refusing and self._last is not None:
            self._refusing = True
            self._publish_event(seen.stamp_ns, ObserverEventKind.REFUSED, DistrustReason.OLD_STAMP, self._last.health)

    def _publish_event(
        self, stamp_ns: int, kind: ObserverEventKind, reason: DistrustReason | None, health: float
    ) -> None:
        event = ObserverEvent(stamp_ns=stamp_ns, kind=kind, reason=reason, health=health)
        self.port.publish(topics.OBSERVER_EVENT, event)

    def _prior(self, last: TargetPoints) -> DloState:
        """The model's state, or the last published targets if the model has not tracked them yet."""
        return self._tracked(last) or prior_from(last, self._topology)

    def _tracked(self, last: TargetPoints) -> DloState | None:
        """The model's state, with the observer's memory; None if the model has not tracked the last targets yet."""
        state = self.port.latest(topics.STATE).value
        same_nodes = state is not None and len(state.nodes_world) == self._dlo.nodes
        if state is not None and same_nodes and state.observed_stamp_ns >= last.stamp_ns:
            return msgspec.structs.replace(state, memory=last.memory)
        return None

    def _remembered(self, found: TargetPoints) -> dict[str, Float64Array]:
        """The last memory, where the rod that was ordered again is where it was seen last; else it is forgotten.

        After a restart the last memory is that in the model's state.
        """
        inherited = self.port.latest(topics.STATE).value if self._inherits else None
        last = inherited if self._last is None else self._prior(self._last)
        if last is None or last.nodes_world.shape != found.nodes_world.shape:
            return {}
        moved_m = rmse_m(last.nodes_world, found.nodes_world)
        return last.memory if moved_m <= ELSEWHERE_M * thickness(self._dlo.radius_m) else {}

    async def _cloud_after(self, stamp_ns: int) -> Observation:
        """The newest cloud not older than a stamp; waits for one."""
        seen = self.port.latest(topics.OBSERVATION).value or self._newest
        try:
            async with asyncio.timeout(self._config.cloud_timeout_s):
                while seen is None or seen.stamp_ns < stamp_ns:
                    self._arrived.clear()
                    await self._arrived.wait()
                    seen = self._newest
        except TimeoutError as error:
            raise SkillFailure(
                "no_cloud",
                f"no cloud came within {self._config.cloud_timeout_s} s; is perception running, "
                f"and was it asked to look?",
            ) from error
        return seen
