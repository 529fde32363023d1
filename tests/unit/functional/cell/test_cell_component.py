"""The cell on a bus, from the drivers' perspective."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest
from cell_bench import STRAIGHT, CellBench

from dlokit.communication import topics
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.timing.urgency import Urgency, never_urgent
from dlokit.communication.transport import Liveness
from dlokit.description.arm.franka import PANDA
from dlokit.evaluation.evaluator import read_truth
from dlokit.functional.cell import api
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import NODES
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.robot import JointTrajectory, RobotMode

HOME = np.array(PANDA.home_q_rad)
LEASE_S = 0.2


@asynccontextmanager
async def running(
    truth_folder: Path | None = None,
    *,
    start: Float64Array = STRAIGHT,
    renews: bool = True,
    urgency: Urgency = never_urgent,
) -> AsyncGenerator[MemoryTransport]:
    bench = CellBench(start, truth_folder=truth_folder, urgency=urgency)
    bus = bench.bus

    async def renew() -> None:
        while True:
            await asyncio.sleep(LEASE_S / 4)
            await bus.call(api.RENEW)

    async with bench.host:
        heart = asyncio.create_task(renew()) if renews else None
        yield bus
        if heart is not None:
            heart.cancel()


def run(story: Callable[[MemoryTransport], Awaitable[None]], *, renews: bool = True) -> None:
    async def main() -> None:
        async with running(renews=renews) as bus:
            await story(bus)

    virtual_time.run(main())


def wave(amplitude_rad: float = 0.3, duration_s: float = 1.0) -> JointTrajectory:
    """The last joint, turned there by a minimum-jerk profile."""
    times = np.linspace(0.0, duration_s, 101)
    u = times / duration_s
    q, dq, ddq = (np.tile(HOME, (101, 1)), np.zeros((101, 7)), np.zeros((101, 7)))
    q[:, 6] += amplitude_rad * u**3 * (10 - 15 * u + 6 * u**2)
    dq[:, 6] = amplitude_rad * 30 * u**2 * (1 - u) ** 2 / duration_s
    ddq[:, 6] = amplitude_rad * 60 * u * (1 - u) * (1 - 2 * u) / duration_s**2
    return JointTrajectory(times_s=times, q_rad=q, dq_rad_s=dq, ddq_rad_s2=ddq)


def arm_mode(bus: MemoryTransport) -> RobotMode:
    state = bus.latest(topics.ARM_STATE).value
    assert state is not None
    return state.mode


def test_in_lockstep_the_cells_time_is_the_loops():
    async def story(bus: MemoryTransport) -> None:
        await asyncio.sleep(0.505)
        tick = bus.latest(topics.CLOCK).value
        assert tick is not None
        assert tick.stamp_ns == 500_000_000
        assert tick.real_time_factor == pytest.approx(1.0, rel=0.02)  # its mean starts with the first tick

    run(story)


def test_the_clock_ticks_at_100_hz_and_the_arm_publishes_at_50():
    async def story(bus: MemoryTransport) -> None:
        await asyncio.sleep(0.505)
        tick, state = bus.latest(topics.CLOCK).value, bus.latest(topics.ARM_STATE).value
        assert tick is not None
        assert state is not None
        assert tick.seq == 51
        assert state.seq == 26

    run(story)


def test_a_trajectory_is_followed_closely_to_its_end():
    async def story(bus: MemoryTransport) -> None:
        outcome = await bus.call(api.FOLLOW, wave(), LEASE_S)
        assert isinstance(outcome, Succeeded)
        assert outcome.result.q_rad[6] == pytest.approx(HOME[6] + 0.3, abs=2e-3)  # rad: remaining lag
        assert outcome.result.largest_joint_error_rad < 0.01
        assert outcome.result.duration_s == pytest.approx(1.0, abs=0.02)  # two ticks
        await asyncio.sleep(0.05)
        assert arm_mode(bus) == RobotMode.IDLE

    run(story)


def test_only_the_process_of_the_arms_robot_may_move_it_or_clear_its_stop_and_anyone_may_stop_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(MemoryTransport, "alive", lambda bus, component: Liveness(True, f"driver of {component}"))

    async def story(bus: MemoryTransport) -> None:
        for call in (
            bus.call(api.FOLLOW, wave(), LEASE_S),
            bus.call(api.GRIP, 0.04, 20.0, LEASE_S),
            bus.call(api.RENEW),
            bus.call(api.ENABLE),
            bus.call(api.RECOVER),
        ):
            refused = await call
            assert isinstance(refused, Rejected)
            assert refused.reason == "not_driver"
        await asyncio.sleep(0.05)
        assert arm_mode(bus) == RobotMode.IDLE
        assert isinstance(await bus.call(api.SLIP, 0.03, 0.1, 20.0), Succeeded)  # the benches' own
        assert isinstance(await bus.call(api.STOP), Succeeded)
        bus.identity = "driver of robot"
        assert isinstance(await bus.call(api.ENABLE), Succeeded)
        assert isinstance(await bus.call(api.FOLLOW, wave(), LEASE_S), Succeeded)

    run(story)


def test_a_bench_lays_the_dlo_as_it_was_at_the_start_while_no_arm_moves(tmp_path: Path) -> None:
    above = STRAIGHT + np.array([0.0, 0.0, 0.3])  # from where it falls onto the table in 0.25 s

    async def main() -> None:
        async with running(tmp_path, start=above) as bus:
            moving = asyncio.ensure_future(bus.call(api.FOLLOW, wave(), LEASE_S))
            await asyncio.sleep(0.5)
            early = await bus.call(api.LAY)
            assert isinstance(early, Rejected)
            assert early.reason == "arm_moves"
            await moving
            assert isinstance(await bus.call(api.LAY), Succeeded)
            await asyncio.sleep(0.15)  # a note of the truth is 0.1 s old at most

    virtual_time.run(main())
    truth = read_truth(tmp_path)
    height_m = truth.nodes_world[:, :, 2].mean(axis=1)
    moved = (truth.stamps_ns >= 500_000_000) & (truth.stamps_ns < 1_000_000_000)
    assert height_m[moved].max() < 0.01
    assert height_m[truth.stamps_ns >= 1_000_000_000].max() > 0.2  # in 0.1 s it falls by 0.05 m


def test_without_renewals_the_arm_brakes_and_needs_recovery():
    async def story(bus: MemoryTransport) -> None:
        outcome = await bus.call(api.FOLLOW, wave(duration_s=2.0), LEASE_S)
        assert isinstance(outcome, Failed)
        assert outcome.reason == "lost_commander"
        await asyncio.sleep(0.05)
        assert arm_mode(bus) == RobotMode.FAULT
        refused = await bus.call(api.FOLLOW, wave(), LEASE_S)
        assert isinstance(refused, Rejected)
        assert refused.reason == "fault"
        assert isinstance(await bus.call(api.RECOVER), Succeeded)
        await asyncio.sleep(0.05)
        assert arm_mode(bus) == RobotMode.IDLE

    run(story, renews=False)


def test_the_cell_is_urgent_during_a_motion_but_not_while_it_renders():
    wanted: list[bool] = []

    async def main() -> None:
        async with running(urgency=wanted.append) as bus:
            await asyncio.sleep(0.1)
            assert not any(wanted)
            motion = asyncio.create_task(bus.call(api.FOLLOW, wave(duration_s=2.0), LEASE_S))
            await asyncio.sleep(0.5)
            assert wanted[-1]
            await bus.call(api.CAPTURE)
            assert not wanted[-1]
            await asyncio.sleep(0.1)
            assert wanted[-1]
            await bus.call(api.BRAKE)
            await motion
            await asyncio.sleep(0.1)
            assert not wanted[-1]

    virtual_time.run(main())


def test_a_brake_ends_a_motion_as_stopped_with_the_arm_at_rest_before_its_end():
    async def story(bus: MemoryTransport) -> None:
        motion = asyncio.create_task(bus.call(api.FOLLOW, wave(duration_s=2.0), LEASE_S))
        await asyncio.sleep(1.0)
        assert isinstance(await bus.call(api.BRAKE), Succeeded)
        outcome = await motion
        assert isinstance(outcome, Failed)
        assert outcome.reason == "stopped"
        await asyncio.sleep(0.05)
        state = bus.latest(topics.ARM_STATE).value
        assert state is not None
        assert state.mode == RobotMode.IDLE
        assert state.q_rad[6] < HOME[6] + 0.29

    run(story)


def test_a_cancelled_motion_brakes():
    async def story(bus: MemoryTransport) -> None:
        motion = asyncio.create_task(bus.call(api.FOLLOW, wave(duration_s=2.0), LEASE_S))
        await asyncio.sleep(1.0)
        motion.cancel()
        await asyncio.sleep(0.5)
        assert arm_mode(bus) == RobotMode.IDLE
        state = bus.latest(topics.ARM_STATE).value
        assert state is not None
        assert HOME[6] + 0.1 < state.q_rad[6] < HOME[6] + 0.29

    run(story)


def test_a_second_motion_is_refused_while_one_runs():
    async def story(bus: MemoryTransport) -> None:
        motion = asyncio.create_task(bus.call(api.FOLLOW, wave(), LEASE_S))
        await asyncio.sleep(0.1)
        second = await bus.call(api.FOLLOW, wave(), LEASE_S)
        assert isinstance(second, Rejected)
        assert second.reason == "busy"
        assert isinstance(await motion, Succeeded)

    run(story)


def bad(**changes: object) -> JointTrajectory:
    fine = wave()
    values = {field: getattr(fine, field) for field in ("times_s", "q_rad", "dq_rad_s", "ddq_rad_s2")}
    return JointTrajectory(**{**values, **changes})  # type: ignore[arg-type]  # the point of the test


@pytest.mark.parametrize(
    ("trajectory", "reason"),
    [
        (bad(q_rad=wave().q_rad + 0.1), "wrong_start"),
        (bad(q_rad=np.full((101, 7), np.nan)), "bad_trajectory"),
        (bad(times_s=np.zeros(101)), "bad_trajectory"),
    ],
)
def test_a_trajectory_outside_the_rules_is_refused_by_name(trajectory: JointTrajectory, reason: str):
    async def story(bus: MemoryTransport) -> None:
        outcome = await bus.call(api.FOLLOW, trajectory, LEASE_S)
        assert isinstance(outcome, Rejected)
        assert outcome.reason == reason

    run(story)


@pytest.mark.parametrize(("width_m", "force_n", "reason"), [(0.2, 20.0, "bad_width"), (0.02, 0.0, "bad_force")])
def test_a_grip_that_the_hand_cannot_do_is_refused(width_m: float, force_n: float, reason: str):
    async def story(bus: MemoryTransport) -> None:
        outcome = await bus.call(api.GRIP, width_m, force_n, 5.0)
        assert isinstance(outcome, Rejected)
        assert outcome.reason == reason

    run(story)


def test_a_grip_returns_when_the_fingers_rest():
    async def story(bus: MemoryTransport) -> None:
        outcome = await bus.call(api.GRIP, 0.02, 20.0, 5.0)
        assert isinstance(outcome, Succeeded)
        assert outcome.result.width_m == pytest.approx(0.02, abs=5e-4)
        assert not outcome.result.held

    run(story)


def test_the_true_shape_is_recorded_in_a_separate_file_at_10_hz(tmp_path: Path):
    async def main() -> None:
        async with running(tmp_path) as bus:
            await asyncio.sleep(1.05)
            images = await bus.call(api.CAPTURE)
            assert isinstance(images, Succeeded)
            assert images.result.stamp_ns == 1_050_000_000 or images.result.stamp_ns == 1_040_000_000

    virtual_time.run(main())
    truth = read_truth(tmp_path)
    assert truth.stamps_ns.tolist() == [k * 100_000_000 for k in range(11)]
    assert truth.nodes_world.shape == (11, NODES, 3)


def test_two_runs_of_one_seed_see_equal_pictures():
    pictures: list[bytes] = []

    async def story(bus: MemoryTransport) -> None:
        await bus.call(api.FOLLOW, wave(duration_s=0.5), LEASE_S)
        outcome = await bus.call(api.CAPTURE)
        assert isinstance(outcome, Succeeded)
        pictures.append(outcome.result.left.tobytes())

    run(story)
    run(story)
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize("drift_ppm", [50.0, -50.0])
def test_stamps_are_late_by_what_the_driver_does_not_know_however_the_clock_drifts(drift_ppm: float):
    async def main() -> None:
        late_s = 0.08
        config = CellConfig(settle_s=0.0, width_px=64, height_px=64, camera_late_s=late_s, camera_drift_ppm=drift_ppm)
        bench = CellBench(config=config)
        bus, cell = bench.bus, bench.cell
        async with bench.host:
            for _ in range(10):
                asked_ns = LoopClock().now_ns()
                taken = await bus.call(api.CAPTURE)
                assert isinstance(taken, Succeeded)
                assert abs(taken.result.stamp_ns - asked_ns - late_s * 1e9) <= 11e6  # a tick of the cell, and 1 ms
                await asyncio.sleep(0.5)
            cell.camera_clock.jump(1_000_000_000)
            jumped = await bus.call(api.CAPTURE)
            assert isinstance(jumped, Failed)
            assert jumped.reason == api.CLOCK_JUMPED
            asked_ns = LoopClock().now_ns()
            taken = await bus.call(api.CAPTURE)
            assert isinstance(taken, Succeeded)
            assert abs(taken.result.stamp_ns - asked_ns - late_s * 1e9) <= 11e6

    virtual_time.run(main())
