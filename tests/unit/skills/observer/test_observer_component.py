"""The observer on a bus: its messages, their times, and the outcomes of its skills."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec
import numpy as np
import pytest
from synthetic_clouds import LENGTH_M, NODES, cloud, shape, state

from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Compute
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.geometry import rmse_m
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer import api
from dlokit.skills.observer.anchored import Anchored, AnchoredConfig
from dlokit.skills.observer.component import FOUND_MARGIN, ObserverComponent
from dlokit.skills.observer.config import ObserverConfig, from_spec, strategies, to_spec
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.observer.following import FOUND_AGAIN_HEALTH, followed
from dlokit.skills.observer.som import SomConfig
from dlokit.skills.observer.spr import SprConfig
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import DistrustReason, Observation, ObserverEventKind
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.system import StrategySpec

FRAME_NS = 100_000_000


class SlowTracking:
    """Computes at once, but takes a second for each cloud that is tracked."""

    async def __call__(self, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        if function is followed:
            await asyncio.sleep(1.0)
        return function(*args, **kwargs)


def play(
    scenario: Callable[[MemoryTransport, LoopClock], Awaitable[None]],
    config: ObserverConfig | None = None,
    compute: Compute | None = None,
) -> None:
    async def main() -> None:
        transport, clock = MemoryTransport(), LoopClock()
        host = Container(transport, clock, compute)
        host.add(ObserverComponent(config or ObserverConfig(), BelievedDlo(nodes=NODES, length_m=LENGTH_M)))
        async with host:
            await scenario(transport, clock)

    virtual_time.run(main())


def at(stamp_ns: int, seen: Observation) -> Observation:
    return msgspec.structs.replace(seen, stamp_ns=stamp_ns)


async def targets_after(transport: MemoryTransport, clock: LoopClock, seen: Observation) -> TargetPoints | None:
    transport.publish(topics.OBSERVATION, seen)
    await clock.sleep(0.01)
    newest = transport.latest(topics.TARGETS).value
    return newest if newest is not None and newest.stamp_ns == seen.stamp_ns else None


def test_clouds_before_the_first_initialise_give_no_targets() -> None:
    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        assert await targets_after(transport, clock, at(5, cloud(shape("S")))) is None

    play(scenario)


def test_after_initialise_every_cloud_gives_targets_with_its_stamp() -> None:
    rod = shape("S")

    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        transport.publish(topics.OBSERVATION, at(5, cloud(rod)))
        first = await transport.call(api.INITIALISE)
        assert isinstance(first, Succeeded)
        assert first.result.stamp_ns == 5
        published = transport.latest(topics.TARGETS).value
        assert published is not None
        np.testing.assert_array_equal(published.nodes_world, first.result.nodes_world)
        next_targets = await targets_after(transport, clock, at(6, cloud(rod + np.array([0.02, 0.0, 0.0]))))
        assert next_targets is not None
        assert rmse_m(next_targets.nodes_world, rod + np.array([0.02, 0.0, 0.0])) < 0.004  # as in test_anchored

    play(scenario)


def test_the_prior_is_the_models_state_once_available() -> None:
    rod = shape("S")

    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        transport.publish(topics.OBSERVATION, at(5, cloud(rod)))
        await transport.call(api.INITIALISE)
        turned = msgspec.structs.replace(state(rod[::-1].copy()), observed_stamp_ns=5)
        transport.publish(topics.STATE, turned)
        targets = await targets_after(transport, clock, at(6, cloud(rod)))
        assert targets is not None
        assert rmse_m(targets.nodes_world, rod[::-1]) < 0.004  # the state's order, not that of the last targets

    play(scenario)


def test_initialise_waits_for_a_cloud_that_is_new_enough() -> None:
    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        transport.publish(topics.OBSERVATION, at(5, cloud(shape("S"))))
        outcome = await transport.call(api.INITIALISE, 6)
        assert isinstance(outcome, Failed)
        assert outcome.reason == "no_cloud"

    play(scenario)


def test_initialise_names_what_is_wrong_with_the_cloud() -> None:
    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        transport.publish(topics.OBSERVATION, cloud(shape("S"), count=0))
        outcome = await transport.call(api.INITIALISE)
        assert isinstance(outcome, Failed)
        assert outcome.reason == "no_points"

    play(scenario)


def test_a_second_initialise_keeps_the_order_unless_reset() -> None:
    rod = shape("S")
    half_turned = (rod - rod.mean(axis=0)) * [-1, -1, 1] + rod.mean(axis=0)

    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        transport.publish(topics.OBSERVATION, at(5, cloud(rod)))
        await transport.call(api.INITIALISE)
        transport.publish(topics.STATE, msgspec.structs.replace(state(half_turned), observed_stamp_ns=5))
        kept = await transport.call(api.INITIALISE)
        await transport.call(api.RESET)
        fresh = await transport.call(api.INITIALISE)
        assert isinstance(kept, Succeeded)
        assert isinstance(fresh, Succeeded)
        assert kept.result.nodes_world[0, 1] < kept.result.nodes_world[-1, 1]
        assert fresh.result.nodes_world[0, 1] > fresh.result.nodes_world[-1, 1]

    play(scenario)


def test_a_cloud_that_is_tracked_during_a_reset_does_not_bring_the_rod_back() -> None:
    rod = shape("S")

    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        transport.publish(topics.OBSERVATION, at(5, cloud(rod)))
        await transport.call(api.INITIALISE)
        transport.publish(topics.OBSERVATION, at(6, cloud(rod)))
        await clock.sleep(0.5)
        await transport.call(api.RESET)
        await clock.sleep(1.0)
        targets = transport.latest(topics.TARGETS).value
        assert targets is not None
        assert targets.stamp_ns == 5
        transport.publish(topics.OBSERVATION, at(7, cloud(rod)))
        await clock.sleep(2.0)
        assert transport.latest(topics.TARGETS).value is targets

    play(scenario, compute=SlowTracking())


def test_the_strategy_can_be_changed_while_running() -> None:
    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        assert isinstance(await transport.call(api.SET_STRATEGY, to_spec(CpdConfig(beta_m=0.2))), Succeeded)
        unknown = await transport.call(api.SET_STRATEGY, StrategySpec(name="guess"))
        assert isinstance(unknown, Rejected)
        assert unknown.reason == "unknown_strategy"
        assert "map" in unknown.detail
        for settings in (b"[]", b'{"beta_m": "wide"}', b'{"width_m": 1.0}'):
            bad = await transport.call(api.SET_STRATEGY, StrategySpec(name="cpd", settings=settings))
            assert isinstance(bad, Rejected)
            assert bad.reason == "bad_settings"

    play(scenario)


@pytest.mark.parametrize(
    "config",
    [AnchoredConfig(tip_snap_m=0.01), CpdConfig(beta_m=0.3), SprConfig(tau_per_m2=5.0), SomConfig(iterations=9)],
)
def test_a_spec_restores_the_settings(config: AnchoredConfig | CpdConfig | SprConfig | SomConfig) -> None:
    assert from_spec(to_spec(config)) == config
    assert from_spec(StrategySpec(name=config.name)) == strategies()[config.name]()


def test_a_rod_that_jumped_is_found_again_in_its_order_with_low_health_in_between() -> None:
    rod = shape("I")
    turn = np.radians(60)
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    jumped = (rod - rod.mean(axis=0)) @ R.T + rod.mean(axis=0) + np.array([0.15, 0.1, 0.0])
    lost = Anchored().estimate(cloud(jumped), state(rod))
    found = followed(Anchored(), cloud(jumped), state(rod), ObserverConfig()).targets
    assert rmse_m(lost.nodes_world, jumped) > 0.02
    assert rmse_m(found.nodes_world, jumped) < 0.004
    assert found.health <= FOUND_AGAIN_HEALTH


def test_a_rod_hidden_for_a_second_and_moved_meanwhile_is_lost_once_and_found_again_once() -> None:
    rod = shape("S")
    moved = rod + np.array([0.12, 0.06, 0.0])

    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        stream = aiter(transport.stream(topics.OBSERVER_EVENT))
        transport.publish(topics.OBSERVATION, at(1, cloud(rod)))
        await transport.call(api.INITIALISE)
        frame_ns = 100_000_000
        widest: list[float] = []
        targets = None
        for frame in range(1, 11):
            targets = await targets_after(transport, clock, at(frame * frame_ns, cloud(rod, count=0)))
            assert targets is not None
            assert targets.covariance is not None
            assert targets.health == 0.0
            assert not targets.visible.any()
            widest.append(float(targets.covariance[:, 0, 0].max()))
        assert np.all(np.diff(widest) > 0.0)
        for frame in range(11, 16):
            targets = await targets_after(transport, clock, at(frame * frame_ns, cloud(moved, frame)))
        assert targets is not None
        assert rmse_m(targets.nodes_world, moved) < 0.005  # as after a first look
        lost, found = await anext(stream), await anext(stream)
        assert (lost.kind, lost.reason, lost.stamp_ns) == (ObserverEventKind.LOST, DistrustReason.NO_POINTS, frame_ns)
        assert (found.kind, found.reason) == (ObserverEventKind.FOUND_AGAIN, None)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(anext(stream), 1.0)  # of virtual time

    play(scenario)


@dataclass(frozen=True)
class Wavering:
    """A strategy that finds the rod and reports a scripted health for each cloud."""

    name: ClassVar[str] = "wavering"
    healths: tuple[float, ...] = ()

    def build(self, dlo: BelievedDlo) -> "Wavering":
        return self

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        health = self.healths[seen.stamp_ns // FRAME_NS - 1]
        return msgspec.structs.replace(Anchored().estimate(seen, prior), health=health)


def test_a_health_around_the_limit_causes_one_event() -> None:
    limit = ObserverConfig().lost_health
    low, between, sound = limit - 0.01, limit + 0.01, limit + FOUND_MARGIN + 0.01
    rod = shape("S")

    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        stream = aiter(transport.stream(topics.OBSERVER_EVENT))
        transport.publish(topics.OBSERVATION, at(1, cloud(rod)))
        await transport.call(api.INITIALISE)
        for frame in range(1, 7):
            assert await targets_after(transport, clock, at(frame * FRAME_NS, cloud(rod, frame))) is not None
        lost, found = await anext(stream), await anext(stream)
        assert (lost.kind, lost.stamp_ns) == (ObserverEventKind.LOST, 2 * FRAME_NS)
        assert (found.kind, found.stamp_ns) == (ObserverEventKind.FOUND_AGAIN, 6 * FRAME_NS)

    play(scenario, ObserverConfig(strategy=Wavering(healths=(sound, low, between, low, between, sound))))


def test_clouds_with_old_stamps_are_refused_by_one_event_and_change_nothing() -> None:
    rod = shape("S")

    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        transport.publish(topics.OBSERVATION, at(5, cloud(rod)))
        await transport.call(api.INITIALISE)
        assert await targets_after(transport, clock, at(3, cloud(rod + 0.02))) is None
        first = transport.latest(topics.OBSERVER_EVENT).value
        assert await targets_after(transport, clock, at(4, cloud(rod + 0.02))) is None
        assert first is not None
        assert (first.kind, first.reason) == (ObserverEventKind.REFUSED, DistrustReason.OLD_STAMP)
        assert transport.latest(topics.OBSERVER_EVENT).value is first

    play(scenario)
