"""The observer component: every cloud and the model's state give target points."""

import asyncio

import msgspec
import numpy as np

from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.errors import SkillFailure
from dlokit.geometry import rmse_m
from dlokit.skills.observer import api
from dlokit.skills.observer.anchored import chain, is_chain
from dlokit.skills.observer.base import ObserverStrategy, prior_from
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.initialise import initial_targets
from dlokit.skills.observer.strategies import from_spec
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation
from dlokit.types.strategy import StrategySpec


class ObserverComponent(Component):
    """Orders the first cloud into nodes; then follows them from cloud to cloud."""

    name = "observer"
    publishes = (topics.TARGETS,)
    reads = (topics.STATE,)

    def __init__(self, config: ObserverConfig, *, nodes: int, length_m: float) -> None:
        """`nodes` M and `length_m` are the model's: targets and state have the same nodes."""
        super().__init__()
        self._config = config
        self._topology = chain(nodes, length_m)
        self._count = nodes
        self._length_m = length_m
        self._strategy: ObserverStrategy = config.strategy.build()
        self._newest: Observation | None = None
        self._arrived = asyncio.Event()
        self._last: TargetPoints | None = None
        """The targets published last; None before the rod was found."""

    @on(topics.OBSERVATION)
    async def on_observation(self, seen: Observation) -> None:
        """Estimate from the newest state and publish; nothing before the first `INITIALISE`."""
        self._newest = seen
        self._arrived.set()
        if self._last is None or seen.stamp_ns <= self._last.stamp_ns:
            return
        prior = self._prior(self._last)
        targets = await self.port.compute(follow, self._strategy, seen, prior, self._config)
        self._publish(targets)

    @implements(api.INITIALISE)
    async def initialise(self, after_stamp_ns: int = 0, towards_world: Float64Array | None = None) -> TargetPoints:
        """Order the newest cloud into nodes and publish them."""
        seen = await self._cloud_after(after_stamp_ns)
        before = towards_world
        if before is None and self._last is not None:
            before = self._prior(self._last).nodes_world
        targets = await self.port.compute(
            initial_targets, seen, self._count, self._length_m, self._config.initialise, before
        )
        self._publish(targets)
        return targets

    @implements(api.SET_STRATEGY)
    async def set_strategy(self, spec: StrategySpec) -> None:
        """Take another strategy."""
        self._strategy = from_spec(spec).build()

    @implements(api.RESET)
    async def reset(self) -> None:
        """Forget the rod."""
        self._last = None

    def _publish(self, targets: TargetPoints) -> None:
        self._last = targets
        self.port.publish(topics.TARGETS, targets)

    def _prior(self, last: TargetPoints) -> DloState:
        """The model's state, or the targets published last where the model has not followed them yet."""
        state = self.port.latest(topics.STATE).value
        if state is not None and state.observed_stamp_ns >= last.stamp_ns:
            return state
        return prior_from(last, self._topology)

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


def follow(strategy: ObserverStrategy, seen: Observation, prior: DloState, config: ObserverConfig) -> TargetPoints:
    """The strategy's targets; where they lost the rod and the cloud shows all of it, the cloud ordered anew.

    Targets are in doubt when their health is low or nodes are hidden: a fold of the registration looks like
    a rod of which a part is hidden. The cloud is then ordered without a prior; if that finds a rod of full
    length elsewhere than the targets, it is right. The order is the one nearer to the prior's, and health at
    most `found_again_health`, so that all can see that the rod was lost and found again.
    """
    targets = strategy.estimate(seen, prior)
    doubtful = targets.health < config.lost_health or not targets.visible.all()
    if not doubtful or len(seen.points_world) == 0 or not is_chain(prior.topology):
        return targets
    length_m = float(np.sum(prior.topology.rest_lengths_m))
    try:
        found = initial_targets(seen, len(prior.nodes_world), length_m, config.initialise, prior.nodes_world)
    except SkillFailure:
        return targets
    elsewhere = rmse_m(found.nodes_world, targets.nodes_world) > config.elsewhere_m
    if not elsewhere or found.health < min(targets.health, config.lost_health):
        return targets
    return msgspec.structs.replace(found, health=min(found.health, config.found_again_health))
