"""The cell with a second arm: each has its own name, and neither affects the other."""

import asyncio

import numpy as np
from cell_bench import CellBench

from dlokit.communication import topics
from dlokit.communication.timing import virtual_time
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import SECOND
from dlokit.description.installation import Installation
from dlokit.functional.cell import api
from dlokit.functional.robots.simulated import SimulatedRobot
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.trajectories import joint_move
from dlokit.types.outcome import Rejected
from dlokit.types.robot import Lease

ARMS = Installation().mounts(2)


def test_each_driver_moves_its_own_arm_and_the_other_stays_where_it_is() -> None:
    async def main() -> None:
        bench = CellBench(arms=ARMS)
        bus, port = bench.bus, bench.port("drivers")
        async with bench.host, SimulatedRobot(port, ARMS[0]) as first, SimulatedRobot(port, ARMS[1]) as second:
            base_joint = np.eye(7)[0]
            ends = PANDA.home_q_rad + 0.3 * base_joint, PANDA.home_q_rad - 0.2 * base_joint
            await second.follow(joint_move(PANDA.home_q_rad, ends[1], PANDA.limits), Lease(holder="test"))
            np.testing.assert_allclose(first.state().q_rad, PANDA.home_q_rad, atol=2e-3)  # gravity is compensated
            await asyncio.gather(
                first.follow(joint_move(PANDA.home_q_rad, ends[0], PANDA.limits), Lease(holder="test")),
                second.follow(joint_move(ends[1], PANDA.home_q_rad, PANDA.limits), Lease(holder="test")),
            )
            await asyncio.sleep(0.3)
            states = bus.latest(topics.ARM_STATE).value, bus.latest(topics.ARM_STATE.at(SECOND)).value
            for state, q_rad, mount in zip(states, (ends[0], PANDA.home_q_rad), ARMS, strict=True):
                assert state is not None
                assert state.robot == mount.robot
                np.testing.assert_allclose(state.q_rad, q_rad, atol=2e-3)
                believed = ArmKinematics(PANDA, state.T_world_base).forward(state.q_rad)
                np.testing.assert_allclose(state.T_world_tcp.position_m, believed.position_m, atol=1e-6)
            absent = await bus.call(api.STOP, "middle")
            assert isinstance(absent, Rejected)
            assert absent.reason == "no_such_robot"

    virtual_time.run(main())
