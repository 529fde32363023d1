"""Twin runs: the cell's arm mirrors that of a driver, and the driver's fingers feel the cell's rope."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np
import pytest

from dlokit.app.commands import execute
from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.wire import codec
from dlokit.description.arm.franka import PANDA
from dlokit.errors import ConfigError
from dlokit.evaluation.judged_run import judged_run
from dlokit.extras.cameras.realsense import RealSenseConfig
from dlokit.extras.franka.driver import FrankaRobotConfig
from dlokit.extras.hosts.section import HostsSection
from dlokit.functional.cell import api as cell_api
from dlokit.functional.cell.component import CellComponent
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.robots.kinematic import KinematicRobotConfig
from dlokit.functional.robots.simulated import SimulatedRobotConfig
from dlokit.functional.robots.twin import TwinRobot
from dlokit.geometry import downward
from dlokit.motion.trajectories import joint_move
from dlokit.skills.robot import api as robot_api
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.job import job_from_config
from dlokit.system.results.run_result import read_result
from dlokit.system.shaping import Watcher
from dlokit.system.table import TimeBase, processes_of_run
from dlokit.types.action import VelocityProfile
from dlokit.types.outcome import Rejected, Succeeded
from dlokit.types.robot import RobotState

P = ParamSpec("P")
R = TypeVar("R")

TWIN = RunConfig(headless=True, twin=True, driver=KinematicRobotConfig(), cell=CellConfig(settle_s=0.2))
BAR_RAD = 0.025
ROD = np.column_stack([np.full(41, 0.5), np.linspace(-0.25, 0.25, 41)])
ABOVE = downward([0.5, 0.1, 0.06], np.pi / 2)
LOW = downward([0.5, 0.1, 0.011], np.pi / 2)


@asynccontextmanager
async def twin(folder: Path, config: RunConfig = TWIN) -> AsyncGenerator[tuple[MemoryTransport, CellComponent]]:
    """The processes of cell and robot; the rope lies along y at x = 0.5 m."""
    transport, clock = MemoryTransport(), LoopClock()
    wiring = Wiring(transport=transport, clock=clock, folder=folder, start_nodes_world=ROD)
    cell = build_component("cell", config, wiring)
    assert isinstance(cell, CellComponent)
    host = Container(transport, clock)
    host.add(cell)
    host.add(build_component("robot", config, wiring))
    async with host:
        async for _ in transport.stream(topics.ROBOT_STATE):
            break
        yield transport, cell


def run(folder: Path, story: Callable[[MemoryTransport, CellComponent], Awaitable[None]]) -> None:
    async def main() -> None:
        async with twin(folder) as (transport, cell):
            await story(transport, cell)

    virtual_time.run(main())


async def done(transport: MemoryTransport, skill: Skill[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    outcome = await transport.call(skill, *args, **kwargs)
    assert isinstance(outcome, Succeeded), outcome
    return outcome.result


def state_of(transport: MemoryTransport) -> RobotState:
    state = transport.latest(topics.ROBOT_STATE).value
    assert state is not None
    return state


def test_the_cells_arm_mirrors_the_driver_and_the_fingers_feel_lift_and_drop_the_cells_rope(tmp_path: Path) -> None:
    async def story(transport: MemoryTransport, cell: CellComponent) -> None:
        driver, mirrored = list[RobotState](), list[RobotState]()
        for topic, states in ((topics.ROBOT_STATE, driver), (topics.ARM_STATE, mirrored)):
            transport.tap(topic, lambda data, states=states: states.append(codec.decode(data, RobotState)))
        began_s = asyncio.get_running_loop().time()
        assert not (await done(transport, robot_api.GRASP)).held
        await done(transport, robot_api.RELEASE)
        await done(transport, robot_api.MOVE_TO, ABOVE)
        await done(transport, robot_api.MOVE_LINEAR, LOW, VelocityProfile())
        await asyncio.sleep(0.1)
        gripped = await done(transport, robot_api.GRASP)
        assert gripped.held
        assert gripped.width_m == pytest.approx(0.008, abs=1.5e-3)  # the rope's diameter
        await done(transport, robot_api.MOVE_LINEAR, ABOVE, VelocityProfile())
        await asyncio.sleep(0.1)
        assert state_of(transport).holding
        assert cell.true_nodes_world()[:, 2].max() > 0.04
        await done(transport, robot_api.RELEASE)
        await asyncio.sleep(0.5)
        assert not state_of(transport).holding
        assert cell.true_nodes_world()[:, 2].max() < 0.02
        took_s = asyncio.get_running_loop().time() - began_s
        assert len(mirrored) >= 50 * took_s
        assert len(driver) >= 100 * took_s
        stamps = [state.stamp_ns for state in driver]
        q_rad = np.array([state.q_rad for state in driver])
        inside = [state for state in mirrored if stamps[0] <= state.stamp_ns <= stamps[-1]]
        at = [state.stamp_ns for state in inside]
        expected = np.column_stack([np.interp(at, stamps, joint) for joint in q_rad.T])
        assert np.abs(np.array([state.q_rad for state in inside]) - expected).max() <= BAR_RAD

    run(tmp_path, story)


def test_only_its_driver_moves_a_mirroring_arm_and_a_stop_holds_the_fingers_of_both(tmp_path: Path) -> None:
    async def story(transport: MemoryTransport, cell: CellComponent) -> None:
        away = joint_move(PANDA.home_q_rad, PANDA.home_q_rad + 0.1, PANDA.limits)
        refused = await transport.call(cell_api.FOLLOW, away, 0.2)
        assert isinstance(refused, Rejected)
        assert refused.reason == "mirrors"
        closing = asyncio.create_task(transport.call(robot_api.GRASP))
        await asyncio.sleep(0.2)
        await done(transport, robot_api.STOP)
        assert not isinstance(await closing, Succeeded)
        width_m = state_of(transport).finger_width_m
        assert width_m > 0.02
        assert isinstance(await transport.call(robot_api.GRASP), Rejected)
        await asyncio.sleep(0.5)
        assert state_of(transport).finger_width_m == pytest.approx(width_m, abs=1e-3)
        await done(transport, robot_api.ENABLE)
        await done(transport, robot_api.GRASP)

    run(tmp_path, story)


@pytest.mark.parametrize(
    ("config", "says"),
    [
        (replace(TWIN, driver=SimulatedRobotConfig()), "moves the cell's own arm: choose --driver kinematic or franka"),
        (replace(TWIN, camera=RealSenseConfig()), "--camera realsense sees another world"),
        (replace(TWIN, twin=False), "does not move the arm of the simulated cell.*or --twin"),
        (replace(TWIN, driver=FrankaRobotConfig(), arm="fr3"), "--driver franka moves in real time"),
        (
            replace(
                TWIN, runtime="live", hosts=HostsSection(endpoint="tls/127.0.0.1:7447", certificates="certificates")
            ),
            "--twin runs on one machine",
        ),
    ],
)
def test_what_cannot_be_a_twin_is_refused(config: RunConfig, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        check_before_start(config, operator_confirms=True)


@pytest.mark.parametrize(
    "config",
    [
        replace(TWIN, camera=RealSenseConfig()),
        replace(TWIN, driver=SimulatedRobotConfig()),
        replace(TWIN, dry_run=True),
        replace(TWIN, twin=False),
    ],
)
def test_no_other_run_builds_a_robot_with_simulated_feedback(
    config: RunConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[TwinRobot] = []
    monkeypatch.setattr(TwinRobot, "__init__", lambda self, device, fingers: built.append(self))  # pyright: ignore
    transport, clock = MemoryTransport(), LoopClock()
    wiring = Wiring(transport=transport, clock=clock, folder=tmp_path, start_nodes_world=ROD)
    build_component("robot", config, wiring)
    assert built == []


def test_in_a_twin_run_all_processes_follow_the_machines_clock_by_which_the_driver_stamps() -> None:
    rows = processes_of_run(replace(TWIN, runtime="live"))
    assert "cell" in {row.name for row in rows}
    assert {row.time_base for row in rows} == {TimeBase.MACHINE}


def test_result_recording_and_summary_say_that_a_run_was_a_twin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = replace(TWIN, start="I", goal="I", task=replace(TWIN.task, check_camera=False))
    check_before_start(config)
    record = judged_run(config, job_from_config(config), tmp_path, Watcher())
    assert record.unwritten == {}
    assert read_result(tmp_path).twin
    assert execute(["info", str(tmp_path)]) == 0
    assert "twin camera, DLO and finger feedback simulated" in " ".join(capsys.readouterr().out.split())
