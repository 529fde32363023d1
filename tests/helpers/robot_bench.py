"""A robot component with an ideal arm, which follows its set-points exactly, on virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

import numpy as np
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.port import Compute, InlineCompute, Port
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.scene import Scene
from dlokit.errors import HardwareError
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.geometry import downward
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.skills.robot.component import RobotComponent
from dlokit.skills.robot.config import RobotConfig
from dlokit.types.action import VelocityProfile
from dlokit.types.outcome import Failed, Outcome, Rejected
from dlokit.types.robot import (
    ArmProtection,
    GripResult,
    JointTrajectory,
    Lease,
    MotionResult,
    RobotState,
)

P = ParamSpec("P")
R = TypeVar("R")
EMPTY = Scene()


class PerfectArm:
    """An ideal arm on the loop's clock, which records its commands."""

    arm: ArmModel = PANDA

    def __init__(self) -> None:
        self.q = PANDA.home_q_rad.copy()
        self.width_m = 0.08
        self.stops = 0
        self.latched = False
        self.connected = True
        self.silent = False
        self.frozen: RobotState | None = None  # what it publishes instead of its state
        self.sag_rad = 0.0  # deviation of the measured from the commanded angles
        self.followed: list[JointTrajectory] = []
        self.protected: ArmProtection | None = None

    async def __aenter__(self) -> Self:
        if not self.connected:
            await asyncio.Event().wait()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stops += 1

    def state(self) -> RobotState:
        if not self.connected:
            raise HardwareError("the arm has not been heard of yet")
        if self.frozen is not None:
            return self.frozen
        return structs.replace(
            ARM_AT_REST,
            stamp_ns=0 if self.silent else round(asyncio.get_running_loop().time() * 1e9),
            q_rad=self.q + self.sag_rad,
            T_world_tcp=tcp_pose(PANDA, self.q),
            finger_width_m=self.width_m,
            stop_latched=self.latched,
        )

    def now_ns(self) -> int:
        return round(asyncio.get_running_loop().time() * 1e9)

    def newest_ns(self) -> int:
        return self.state().stamp_ns

    def protection(self) -> ArmProtection | None:
        return self.protected

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        self.followed.append(trajectory)
        started = asyncio.get_running_loop().time()
        try:
            await asyncio.sleep(float(trajectory.times_s[-1]))
        finally:
            passed = asyncio.get_running_loop().time() - started
            self.q = np.array([np.interp(passed, trajectory.times_s, trajectory.q_rad[:, joint]) for joint in range(7)])
        return MotionResult(
            q_rad=self.q, T_world_tcp=tcp_pose(PANDA, self.q), duration_s=passed, largest_joint_error_rad=0.0
        )

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        await asyncio.sleep(0.5)
        self.width_m = width_m
        return GripResult(width_m=width_m, held=False)

    async def halt(self) -> None:
        self.stops += 1

    async def stop(self) -> None:
        self.stops += 1
        self.latched = True

    async def enable(self) -> None:
        self.latched = False
        self.connected = True

    def brake(self) -> None:
        self.stops += 1

    async def recover(self) -> None:
        self.stops += 1


class Bench:
    """A component on a separate bus, and a caller."""

    def __init__(self, compute: Compute | None = None, scene: Scene = EMPTY) -> None:
        self.arm = PerfectArm()
        self.machine_s = 0.0  # the machine's clock, which only the test advances
        self.transport = transport = MemoryTransport()
        clock = LoopClock()
        self.me = transport.identity
        self.host = Container(transport, clock, compute)
        gated = GatedRobot(self.arm, GateConfig(), clock.now_ns)
        self.robot = RobotComponent(
            RobotConfig(), gated, lambda: round(self.machine_s * 1e9), standing=gated.standing, scene=scene
        )
        self.host.add(self.robot)
        self.port = Port(transport, clock, InlineCompute(), owner="test", publishes=())


class SlowCompute:
    """Planning takes a second."""

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        await asyncio.sleep(1.0)
        return function(*args, **kwargs)


def on_bench(
    scenario: Callable[[Bench], Awaitable[None]], compute: Compute | None = None, scene: Scene = EMPTY
) -> None:
    async def main() -> None:
        bench = Bench(compute, scene)
        async with bench.host:
            await scenario(bench)

    virtual_time.run(main())


ABOVE = downward([0.5, 0.1, 0.1], 0.3)
FAR = PANDA.home_q_rad + np.array([1.0, 0.2, 0.0, 0.3, 0.0, 0.0, 0.0])
PROFILE = VelocityProfile()
KINEMATICS = ArmKinematics(PANDA)


def reason(outcome: Outcome[Any]) -> str:
    assert isinstance(outcome, Failed | Rejected), outcome
    return outcome.reason
