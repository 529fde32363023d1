"""Wrong calls, each an error of the type checker; only pyright reads them, they never run.

If pyright accepted a wrong call, its comment would be unnecessary, which is also an error.
"""

# pyright: reportUnnecessaryTypeIgnoreComment=true

from dlokit import System
from dlokit.communication.component import Component, implements, implements_reporting
from dlokit.communication.port import Port
from dlokit.communication.transport import Transport
from dlokit.decision.api import SHAPE_DLO, ShapeProgress
from dlokit.decision.records import ShapeResult
from dlokit.skills.robot import api as robot
from dlokit.types.outcome import Outcome
from dlokit.types.pose import Pose
from dlokit.types.robot import MotionResult


async def right(port: Port, pose: Pose) -> Outcome[MotionResult]:
    return await port.call(robot.MOVE_TO, pose, either_way=False)


async def wrong_skill(port: Port) -> None:
    await port.call(robot.FLY)  # pyright: ignore[reportAttributeAccessIssue]
    await port.call("robot.home")  # pyright: ignore[reportArgumentType, reportCallIssue]


async def wrong_arguments(bus: Transport, pose: Pose) -> None:
    await bus.call(robot.MOVE_TO, "up")  # pyright: ignore[reportArgumentType]
    await bus.call(robot.MOVE_TO)  # pyright: ignore[reportCallIssue]
    await bus.call(robot.MOVE_TO, pose, either_weigh=True)  # pyright: ignore[reportCallIssue]
    await bus.call(robot.HOME.at("second"), 1.0)  # pyright: ignore[reportCallIssue]


def right_from_a_script(system: System, pose: Pose) -> MotionResult:
    return system.robot.at("second").move_to(pose, either_way=False)


def wrong_from_a_script(system: System) -> ShapeResult:
    system.robot.move_to("up")  # pyright: ignore[reportArgumentType]
    system.perception.fly()  # pyright: ignore[reportAttributeAccessIssue]
    return system.robot.home()  # pyright: ignore[reportReturnType]


async def wrong_result(port: Port) -> Outcome[ShapeResult]:
    return await port.call(robot.HOME)  # pyright: ignore[reportReturnType]


async def wrong_progress(port: Port) -> None:
    def told(progress: MotionResult) -> None: ...

    await port.call_reported(SHAPE_DLO, told, "S")  # pyright: ignore[reportArgumentType]
    await port.call_reported(robot.HOME, told)  # pyright: ignore[reportArgumentType, reportCallIssue]


class Wrong(Component):
    name = "robot"

    @implements(robot.GRASP)  # pyright: ignore[reportArgumentType]
    async def grasp(self, force_n: str) -> None: ...

    @implements_reporting(SHAPE_DLO)  # pyright: ignore[reportArgumentType]
    async def shape_dlo(self, told: ShapeProgress) -> ShapeResult: ...
