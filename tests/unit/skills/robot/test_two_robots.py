"""Two robot components with their arms in one cell: the arms do not collide."""

import asyncio
import math
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest
from cell_bench import CellBench
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit.communication import topics
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Port
from dlokit.communication.timing import virtual_time
from dlokit.communication.topic import Topic
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import SECOND, ArmMount
from dlokit.description.installation import Installation
from dlokit.description.shapes import CENTRE_M
from dlokit.functional.robots.simulated import SimulatedRobot
from dlokit.geometry import downward, rotation
from dlokit.motion.arm_distance import Apart, gap_m, stopping_gap_m
from dlokit.motion.collisions import segment_distances
from dlokit.motion.forward_kinematics import PosedArm, capsule_ends, tcp_matrices
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.skills.robot import api
from dlokit.skills.robot.component import RobotComponent
from dlokit.skills.robot.config import RobotConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Failed, Succeeded
from dlokit.types.robot import RobotMode, RobotReason, RobotState

ARMS = Installation().mounts(2)

MIDDLE = downward([*CENTRE_M, 0.25], 0.0)
CLEARANCE_M = RobotConfig().arm_clearance_m


def posed(state: RobotState) -> PosedArm:
    return PosedArm(PANDA, state)


def robot(port: Port, mount: ArmMount) -> RobotComponent:
    return RobotComponent(
        RobotConfig(),
        SimulatedRobot(port, mount),
        lambda: 0,
        mount.T_world_base,
        mount.instance,
        neighbours=tuple(other for other in ARMS if other is not mount),
    )


def in_cell(scenario: Callable[[Port], Awaitable[None]], mounts: tuple[ArmMount, ...] = ARMS) -> None:
    async def main() -> None:
        bench = CellBench(arms=ARMS, instances={"robot": (SECOND,)})
        for mount in mounts:
            bench.host.add(robot(bench.port("driver"), mount))
        async with bench.host:
            await asyncio.sleep(0.2)  # feedback of both arms has arrived
            await scenario(bench.port("test"))

    virtual_time.run(main())


def states(port: Port) -> tuple[RobotState, RobotState]:
    first, second = port.latest(topics.ROBOT_STATE).value, port.latest(topics.ROBOT_STATE.at(SECOND)).value
    assert first is not None
    assert second is not None
    return first, second


def test_a_motion_into_the_other_arm_is_refused() -> None:
    async def scenario(port: Port) -> None:
        assert isinstance(await port.call(api.MOVE_TO, MIDDLE), Succeeded)
        refused = await port.call(api.MOVE_TO.at(SECOND), MIDDLE)
        assert isinstance(refused, Failed)
        assert refused.reason == RobotReason.ARMS_TOO_NEAR
        np.testing.assert_allclose(states(port)[1].q_rad, PANDA.home_q_rad, atol=2e-3)
        # After the first has moved away, the path is free.
        assert isinstance(await port.call(api.HOME), Succeeded)
        assert isinstance(await port.call(api.MOVE_TO.at(SECOND), MIDDLE), Succeeded)

    in_cell(scenario)


def test_an_arm_may_approach_a_resting_arm_to_the_checked_distance_and_leave() -> None:
    async def scenario(port: Port) -> None:
        assert isinstance(await port.call(api.MOVE_TO, MIDDLE), Succeeded)
        beside = downward([CENTRE_M[0] + 0.165, CENTRE_M[1], 0.25], 0.0)
        assert isinstance(await port.call(api.MOVE_TO.at(SECOND), beside), Succeeded)
        # With the reaction time of an approaching arm, this would be too close.
        assert gap_m(*map(posed, states(port))) < 0.05
        assert isinstance(await port.call(api.HOME.at(SECOND)), Succeeded)

    in_cell(scenario)


def test_arms_that_set_out_for_the_same_place_at_once_brake_before_they_meet() -> None:
    async def scenario(port: Port) -> None:
        nearest_m = math.inf

        async def watch() -> None:
            nonlocal nearest_m
            async for state in port.stream(topics.ROBOT_STATE):
                nearest_m = min(nearest_m, gap_m(posed(state), posed(states(port)[1])))

        states(port)
        watching = asyncio.create_task(watch())
        outcomes = await asyncio.gather(port.call(api.MOVE_TO, MIDDLE), port.call(api.MOVE_TO.at(SECOND), MIDDLE))
        await port.clock.sleep(1.0)
        watching.cancel()
        assert [outcome.reason for outcome in outcomes if isinstance(outcome, Failed)] == [
            RobotReason.ARMS_TOO_NEAR
        ] * 2
        # They did get close: the guard ended the motions, not the check at the start.
        assert 0.0 < nearest_m < 0.15

    in_cell(scenario)


def test_no_motion_starts_without_feedback_of_the_other_arm() -> None:
    async def scenario(port: Port) -> None:
        refused = await port.call(api.MOVE_TO, MIDDLE)
        assert isinstance(refused, Failed)
        assert refused.reason == RobotReason.NEIGHBOUR_SILENT

    in_cell(scenario, ARMS[:1])


@pytest.mark.parametrize("silence", ["nothing comes", "the same comes again"])
def test_a_moving_arm_brakes_when_feedback_of_the_other_stops(silence: str, monkeypatch: pytest.MonkeyPatch) -> None:
    publish, last, since_s = MemoryTransport.publish, list[RobotState](), math.inf

    def withhold(bus: MemoryTransport, topic: Topic[Any], message: Any) -> None:
        if topic.name == topics.ROBOT_STATE.at(SECOND).name:
            if asyncio.get_running_loop().time() < since_s:
                last[:] = [message]
            elif silence == "nothing comes":
                return
            message = last[0]
        publish(bus, topic, message)

    async def scenario(port: Port) -> None:
        nonlocal since_s
        aside = PANDA.home_q_rad + np.array([1.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        states(port)
        moving = asyncio.create_task(port.call(api.MOVE_JOINTS, aside))
        since_s = asyncio.get_running_loop().time() + 0.4
        brakings_s = list[float]()
        async for state in port.stream(topics.ARM_STATE):
            if state.mode is RobotMode.BRAKING:
                brakings_s.append(asyncio.get_running_loop().time())
            if moving.done():
                break
        outcome = await moving
        assert isinstance(outcome, Failed)
        assert outcome.reason == RobotReason.NEIGHBOUR_SILENT
        assert 0.2 < brakings_s[0] - since_s <= 0.25
        since_s = math.inf  # its feedback arrives again
        assert isinstance(await port.call(api.HOME), Succeeded)

    monkeypatch.setattr(MemoryTransport, "publish", withhold)

    in_cell(scenario)


def tool_jacobian(q_rad: Float64Array) -> Float64Array:
    """How fast the tool moves [m/s] with each joint (3, 7), by differences."""
    step = 1e-6 * np.eye(7)
    return ((tcp_matrices(PANDA, q_rad + step) - tcp_matrices(PANDA, q_rad - step))[:, :3, 3] / 2e-6).T


@pytest.mark.parametrize(("speed_m_s", "nearer_mm"), [(0.4, 32.0), (-0.4, 0.0)])
def test_the_distance_after_braking_includes_the_braking_distance(speed_m_s: float, nearer_mm: float) -> None:
    q_rad = ArmKinematics(PANDA).inverse(MIDDLE)
    towards_the_other = np.array([speed_m_s, 0.0, 0.0])

    def state(mount: ArmMount, q_rad: Float64Array, dq_rad_s: Float64Array) -> RobotState:
        return structs.replace(
            ARM_AT_REST,
            robot=mount.robot,
            q_rad=q_rad,
            dq_rad_s=dq_rad_s,
            T_world_tcp=MIDDLE,
            finger_width_m=0.0,
            mode=RobotMode.MOVING,
            T_world_base=mount.T_world_base,
        )

    dq_rad_s = np.asarray(np.linalg.lstsq(tool_jacobian(q_rad), towards_the_other)[0], dtype=np.float64)
    moving = posed(state(ARMS[0], q_rad, dq_rad_s))
    standing = posed(state(ARMS[1], PANDA.home_q_rad, np.zeros(7)))
    nearer_m = gap_m(moving, standing) - stopping_gap_m(moving, standing)
    # 0.08 s of reaction at 0.4 m/s are 32 mm; braking adds to it, and the nearest parts need not meet head on.
    assert nearer_m >= 0.5e-3 * nearer_mm
    assert nearer_mm > 0.0 or nearer_m == 0.0


def test_the_least_distance_is_that_of_all_pairs_of_capsules() -> None:
    rng = np.random.default_rng(5)
    lower, upper = PANDA.limits.position_lower_rad, PANDA.limits.position_upper_rad
    arms = [ArmKinematics(PANDA, mount.T_world_base) for mount in ARMS]
    radii = np.array([capsule.radius_m for capsule in PANDA.capsules])
    T_world_base = ARMS[1].T_world_base
    assert T_world_base is not None
    for _ in range(20):
        first, second = rng.uniform(lower, upper, (2, 3, 7))
        a0, a1 = capsule_ends(PANDA, first)
        b0, b1 = (end @ rotation(T_world_base).T + T_world_base.position_m for end in capsule_ends(PANDA, second))
        gaps = segment_distances(a0[:, None, :, None], a1[:, None, :, None], b0[None, :, None], b1[None, :, None])
        expected = np.min(gaps - radii[:, None] - radii[None, :])
        assert Apart(*arms).at_joints_m(first, second) == pytest.approx(expected, abs=1e-12)
