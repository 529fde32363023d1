"""What an observer keeps from cloud to cloud travels with targets and state, and outlives its process."""

import logging
import re
from collections.abc import Awaitable, Callable

import msgspec
import numpy as np
import pytest
from counting_observer import CountingConfig, counted
from synthetic_clouds import LENGTH_M, NODES, cloud, shape, state

from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.wire import codec
from dlokit.description.arm.franka import FRANKA_HAND
from dlokit.recording.message_json import from_json, to_json
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.model.component import ModelComponent
from dlokit.skills.observer import api
from dlokit.skills.observer.base import MOST_MEMORY_BYTES, memory_flaw, nothing_seen, prior_from
from dlokit.skills.observer.component import ObserverComponent
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.following import followed
from dlokit.system.request import OwnStrategies
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import DistrustReason, Observation
from dlokit.types.outcome import Succeeded
from dlokit.types.system import StrategySpec

ROD = shape("S")
STEP_NS = 100_000_000
CONFIG = ObserverConfig()


def at(number: int, points: Observation | None = None) -> Observation:
    return msgspec.structs.replace(points or cloud(ROD), stamp_ns=number * STEP_NS)


def remembering(count: int = 3) -> DloState:
    return msgspec.structs.replace(state(ROD), memory={"clouds": np.array([float(count)])})


def after(config: CountingConfig, seen: Observation, prior: DloState) -> tuple[TargetPoints, DistrustReason | None]:
    answer = followed(config.build(BelievedDlo()), seen, prior, CONFIG)
    return answer.targets, answer.distrust


def test_the_memory_comes_back_with_the_prior_of_the_next_cloud() -> None:
    prior = state(ROD)
    for number in range(1, 4):
        targets, _ = after(CountingConfig(), at(number), prior)
        prior = prior_from(targets, prior.topology)
    assert counted(prior.memory) == 3


@pytest.mark.parametrize(
    ("points", "reason"),
    [(np.zeros((0, 3)), DistrustReason.NO_POINTS), (ROD + 9.0, DistrustReason.FAR_POINTS)],
)
def test_a_cloud_that_is_not_used_leaves_the_memory(points: np.ndarray, reason: DistrustReason) -> None:
    seen = Observation(stamp_ns=STEP_NS, points_world=points.astype(np.float32))
    targets, distrust = after(CountingConfig(), seen, remembering(3))
    assert distrust is reason
    assert counted(targets.memory) == 3


def test_targets_that_are_not_used_leave_the_memory_before_them() -> None:
    targets, distrust = after(CountingConfig(health=0.1), at(1), remembering(3))
    assert distrust is DistrustReason.NOT_THE_DLO
    assert counted(targets.memory) == 3


def test_an_empty_cloud_keeps_the_memory() -> None:
    assert counted(nothing_seen(cloud(ROD, count=0), remembering(3)).memory) == 3


def test_a_strategy_that_fails_begins_again_without_a_memory() -> None:
    targets, distrust = after(CountingConfig(fails_at=4), at(1), remembering(3))
    assert distrust is DistrustReason.BAD_TARGETS
    assert targets.memory == {}
    again, _ = after(CountingConfig(fails_at=4), at(2), prior_from(targets, state(ROD).topology))
    assert counted(again.memory) == 1


def test_a_rod_that_is_found_elsewhere_is_tracked_without_the_memory_of_the_lost_one() -> None:
    straight = shape("I")
    across = (straight - straight.mean(axis=0))[:, [1, 0, 2]] + straight.mean(axis=0) + np.array([0.15, 0.1, 0.0])
    prior = msgspec.structs.replace(remembering(3), nodes_world=straight)
    targets, distrust = after(CountingConfig(health=0.3), at(1, cloud(across)), prior)
    assert distrust is DistrustReason.ELSEWHERE
    assert targets.memory == {}


def test_a_memory_that_is_too_large_is_refused_by_name(caplog: pytest.LogCaptureFixture) -> None:
    most = MOST_MEMORY_BYTES // 8
    assert after(CountingConfig(numbers=most), at(1), state(ROD))[1] is None
    with caplog.at_level(logging.ERROR):
        targets, distrust = after(CountingConfig(numbers=most + 1), at(1), state(ROD))
    assert distrust is DistrustReason.BAD_MEMORY
    assert targets.memory == {}
    assert f"memory has {MOST_MEMORY_BYTES + 8} bytes; at most {MOST_MEMORY_BYTES} (256 KiB)" in caplog.text


@pytest.mark.parametrize(
    ("memory", "says"),
    [
        ([1.0], "memory is a list; it must be a dict"),
        ({3: np.zeros(2)}, "the name 3"),
        ({"weights": [0.5]}, "memory 'weights' is list; it must be a float64 array"),
        ({"weights": np.zeros(2, dtype=np.float32)}, r"memory 'weights' is float32 \(2,\); it must be a float64"),
        ({"weights": np.zeros((1, 1, 1, 1, 1))}, "at most 4 dimensions"),
    ],
)
def test_a_memory_of_something_else_is_refused(memory: object, says: str) -> None:
    flaw = memory_flaw(memory)
    assert flaw is not None
    assert re.search(says, flaw)


def test_it_is_recorded_and_sent_unchanged_and_omitted_where_it_is_empty() -> None:
    values = np.random.default_rng(0).normal(size=(600, 2))
    kept = msgspec.structs.replace(state(ROD), memory={"particles": values, "one": np.array(0.1)})
    for back in (from_json(to_json(kept), DloState), codec.decode(codec.encode(kept), DloState)):
        assert list(back.memory) == ["particles", "one"]
        np.testing.assert_array_equal(back.memory["particles"], values, strict=True)
        np.testing.assert_array_equal(back.memory["one"], np.array(0.1), strict=True)
    assert b"memory" not in to_json(state(ROD))


Scenario = Callable[[MemoryTransport, LoopClock], Awaitable[None]]


def play(*scenarios: Scenario, config: CountingConfig | None = None) -> None:
    """Each scenario has a new observer, on the bus of the one before."""

    async def main() -> None:
        transport, clock = MemoryTransport(), LoopClock()
        for scenario in scenarios:
            host = Container(transport, clock)
            strategy = ObserverConfig(strategy=config or CountingConfig())
            host.add(ObserverComponent(strategy, BelievedDlo(nodes=NODES, length_m=LENGTH_M)))
            async with host:
                await scenario(transport, clock)

    virtual_time.run(main())


async def count_after(transport: MemoryTransport, clock: LoopClock, number: int) -> int:
    """The count in the targets of the next cloud, which the model then follows."""
    transport.publish(topics.OBSERVATION, at(number))
    await clock.sleep(0.01)
    targets = transport.latest(topics.TARGETS).value
    assert targets is not None
    assert targets.stamp_ns == number * STEP_NS
    transport.publish(topics.STATE, prior_from(targets, state(ROD).topology))
    return counted(targets.memory)


async def begun(transport: MemoryTransport, clock: LoopClock, number: int = 1, rod: np.ndarray = ROD) -> None:
    transport.publish(topics.OBSERVATION, at(number, cloud(rod)))
    await clock.sleep(0.01)
    await transport.call(api.INITIALISE, number * STEP_NS)


async def tracked(transport: MemoryTransport, clock: LoopClock) -> None:
    await begun(transport, clock)
    assert [await count_after(transport, clock, number) for number in (2, 3, 4)] == [1, 2, 3]


def test_a_restarted_observer_goes_on_with_the_memory_in_the_models_state() -> None:
    async def restarted(transport: MemoryTransport, clock: LoopClock) -> None:
        await begun(transport, clock, 5)
        assert await count_after(transport, clock, 6) == 4

    play(tracked, restarted)


def test_a_rod_that_was_moved_meanwhile_is_tracked_without_the_memory() -> None:
    async def moved(transport: MemoryTransport, clock: LoopClock) -> None:
        await begun(transport, clock, 5, ROD + np.array([0.03, 0.0, 0.0]))
        targets = transport.latest(topics.TARGETS).value
        assert targets is not None
        assert targets.memory == {}

    play(tracked, moved)


def test_ordering_the_rod_again_where_it_was_keeps_the_memory_and_reset_forgets_it() -> None:
    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        await tracked(transport, clock)
        await begun(transport, clock, 5)  # the cloud is tracked first
        assert await count_after(transport, clock, 6) == 5
        await transport.call(api.RESET)
        await begun(transport, clock, 7)
        assert await count_after(transport, clock, 8) == 1

    play(scenario)


def test_another_strategy_begins_without_the_memory_of_the_one_before() -> None:
    async def scenario(transport: MemoryTransport, clock: LoopClock) -> None:
        await tracked(transport, clock)
        assert isinstance(await transport.call(api.SET_STRATEGY, StrategySpec(name="another")), Succeeded)
        assert await count_after(transport, clock, 5) == 1

    with OwnStrategies(observers={"another": CountingConfig()}).known():
        play(scenario)


def test_the_models_state_has_the_memory_of_the_targets() -> None:
    async def main() -> None:
        transport = MemoryTransport()
        host = Container(transport, LoopClock())
        host.add(ModelComponent(BelievedDlo(nodes=NODES, length_m=LENGTH_M), FRANKA_HAND))
        async with host:
            targets = TargetPoints(
                stamp_ns=1, nodes_world=ROD, visible=np.ones(NODES, dtype=np.bool_), memory=remembering(3).memory
            )
            transport.publish(topics.TARGETS, targets)
            await LoopClock().sleep(0.01)
            tracked_state = transport.latest(topics.STATE).value
            assert tracked_state is not None
            assert counted(tracked_state.memory) == 3

    virtual_time.run(main())
