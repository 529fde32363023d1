"""A real arm moves only after an operator has confirmed the start, whichever way a motion is asked for."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from robot_bench import reason

from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.errors import SkillFailure, StartNotConfirmed
from dlokit.extras.cameras.realsense import RealSenseConfig
from dlokit.functional.robots.kinematic import KinematicRobotConfig
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.operator_start import RealStart, Sighting, confirmed_start
from dlokit.system.results.run_folder import HIDDEN_START
from dlokit.system.table import COMPONENTS
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import TargetPoints
from dlokit.types.observation import LookResult
from dlokit.types.outcome import Succeeded
from dlokit.types.robot import FIRST_ROBOT

LEASE_S = 60.0  # no heartbeats here


@dataclass(frozen=True, kw_only=True)
class RealArmConfig(KinematicRobotConfig):
    """An arm in software that counts as real."""

    name: ClassVar[str] = "real-arm"
    is_real: ClassVar[bool] = True


REAL = RunConfig(headless=True, camera=RealSenseConfig(), driver=RealArmConfig())
"""In lockstep: its lease is wired as in a live run, and the button in its process needs no socket."""


class Answer:
    """An operator who answers without being shown anything."""

    def __init__(self, *, yes: bool) -> None:
        self.yes = yes
        self.asked = 0

    async def confirm(self, start: RealStart) -> None:
        self.asked += 1
        if not self.yes:
            raise StartNotConfirmed("the gripper is not empty")


@asynccontextmanager
async def arm(config: RunConfig, folder: Path, *others: Component) -> AsyncGenerator[MemoryTransport]:
    transport, clock = MemoryTransport(), LoopClock()
    wiring = Wiring(transport=transport, clock=clock, folder=folder, start_nodes_world=HIDDEN_START)
    host = Container(transport, clock)
    for component in (build_component("robot", config, wiring), *others):
        host.add(component)
    async with host:
        async for _ in transport.stream(topics.ROBOT_STATE):
            break
        yield transport


async def take_lease(transport: MemoryTransport) -> None:
    taken = await transport.call(robot.RENEW_LEASE, transport.identity, LEASE_S)
    assert isinstance(taken, Succeeded)


def test_every_motion_of_a_real_arm_is_rejected_until_the_holder_of_its_lease_confirms_the_start(
    tmp_path: Path,
) -> None:
    async def main() -> None:
        async with arm(REAL, tmp_path) as transport:
            assert reason(await transport.call(robot.HOME)) == "no_operator"
            # A process that does not command the arm cannot confirm for one that does.
            assert reason(await transport.call(robot.CONFIRM_START)) == "not_commander"
            await take_lease(transport)
            assert reason(await transport.call(robot.HOME)) == "no_operator"
            assert reason(await transport.call(robot.RELEASE, 0.03)) == "no_operator"
            assert isinstance(await transport.call(robot.CONFIRM_START), Succeeded)
            assert isinstance(await transport.call(robot.RELEASE, 0.079), Succeeded)
            assert isinstance(await transport.call(robot.RELEASE_LEASE, transport.identity), Succeeded)
            assert reason(await transport.call(robot.HOME)) == "no_operator"  # the next commander asks again
            await take_lease(transport)
            assert reason(await transport.call(robot.HOME)) == "no_operator"

    virtual_time.run(main())


def test_all_skills_that_move_an_arm_need_the_operator() -> None:
    moving = [skill for skill in COMPONENTS["robot"].skills() if skill.moves_arm]
    assert {skill.name for skill in moving} == {
        "move_joints", "move_to", "move_linear", "follow_path", "grasp", "release", "home",
    }  # fmt: skip
    assert all(robot.CONFIRMED in skill.preconditions for skill in moving)
    assert {skill for skill in COMPONENTS["robot"].skills() if skill.exclusive} == set(moving)


@pytest.mark.parametrize(
    "config",
    [replace(REAL, dry_run=True), replace(REAL, driver=KinematicRobotConfig())],
    ids=["dry run", "software"],
)
def test_an_arm_in_software_needs_no_operator(config: RunConfig, tmp_path: Path) -> None:
    operator = Answer(yes=False)

    async def main() -> None:
        async with arm(config, tmp_path) as transport:
            await take_lease(transport)
            await confirmed_start(transport, config, operator, resumed=False)
            assert isinstance(await transport.call(robot.RELEASE, 0.079), Succeeded)

    virtual_time.run(main())
    assert operator.asked == 0


class Eyes(Component):
    """Perception with made answers."""

    name = "perception"

    def __init__(self, *answers: int | str) -> None:
        """Numbers of points, or reasons of failure, look by look."""
        self.answers = list(answers)

    @implements(perception.LOOK)
    async def look(self) -> LookResult:
        answer = self.answers.pop(0)
        if isinstance(answer, str):
            raise SkillFailure(answer, "as made")
        return LookResult(stamp_ns=5, points=answer)


class Finder(Component):
    """The observer with made answers."""

    name = "observer"

    def __init__(self, reason: str = "") -> None:
        self.reason = reason
        self.resets = 0

    @implements(observer.INITIALISE)
    async def initialise(self, after_stamp_ns: int = 0, towards_world: Float64Array | None = None) -> TargetPoints:
        assert after_stamp_ns == 5
        if self.reason:
            raise SkillFailure(self.reason, "as made")
        return TargetPoints(stamp_ns=5, nodes_world=np.zeros((31, 3)), visible=np.ones(31, dtype=bool))

    @implements(observer.RESET)
    async def reset(self) -> None:
        self.resets += 1


def look_with(*others: Component) -> Sighting:
    transport, clock = MemoryTransport(), LoopClock()
    host = Container(transport, clock)
    for component in others:
        host.add(component)

    async def main() -> Sighting:
        async with host:
            return await RealStart(transport, REAL).look()

    return virtual_time.run(main())


def test_the_operator_is_shown_how_many_points_are_seen_and_whether_the_dlo_is_found() -> None:
    finder = Finder()
    assert look_with(Eyes(365), finder) == Sighting(points=365, nodes=31)
    assert finder.resets == 1  # what was seen with the arm in view is not kept
    hidden = look_with(Eyes(90), Finder("out_of_view"))
    assert (hidden.points, hidden.nodes) == (90, 0)
    assert hidden.problem.startswith("out_of_view")
    assert look_with(Eyes("no_points"), Finder()).problem == "no_points: as made"


@pytest.mark.parametrize("lost", ["camera_lost", "clock_jumped"])
def test_a_camera_that_fails_at_first_is_asked_again(lost: str) -> None:
    assert look_with(Eyes(lost, lost, 365), Finder()).nodes == 31
    failed = look_with(Eyes(lost, lost, lost, 365), Finder())
    assert failed.problem.startswith(lost)
    assert not failed.pictured


def test_a_picture_without_a_dlo_is_a_picture_and_no_process_of_the_camera_is_none() -> None:
    assert look_with(Eyes("no_points"), Finder()).pictured
    assert look_with(Finder()).pictured is False


def test_no_operator_no_motion_and_a_yes_allows_them(tmp_path: Path) -> None:
    async def main() -> None:
        async with arm(REAL, tmp_path) as transport:
            await take_lease(transport)
            with pytest.raises(StartNotConfirmed, match="gripper is not empty"):
                await confirmed_start(transport, REAL, Answer(yes=False), resumed=False)
            assert reason(await transport.call(robot.HOME)) == "no_operator"
            await confirmed_start(transport, REAL, Answer(yes=True), resumed=False)
            assert isinstance(await transport.call(robot.RELEASE, 0.079), Succeeded)

    virtual_time.run(main())


def test_the_start_knows_how_far_the_fingers_are_apart(tmp_path: Path) -> None:
    async def main() -> dict[str, Any]:
        async with arm(REAL, tmp_path) as transport:
            return {**await RealStart(transport, REAL).grippers()}

    assert virtual_time.run(main()) == {FIRST_ROBOT: pytest.approx(0.08)}
