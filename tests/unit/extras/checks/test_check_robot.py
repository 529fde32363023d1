"""Every requirement of `check_robot` is violated once on purpose, and named."""

import asyncio
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
import numpy as np
import pytest
import test_robots

from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.timing.pulse import loop_pulse
from dlokit.description.arm.mounts import FIRST_ALONE
from dlokit.errors import ConfigError, HardwareError, SkillFailure, StartNotConfirmed
from dlokit.extras.checks.command import RobotCheckArgs, robot_args, run
from dlokit.extras.checks.robot_checks import LATCHED_QUESTION, QUESTIONS, WANTED, SilenceablePulse
from dlokit.extras.checks.robots import examined_robot
from dlokit.functional.robots.base import Robot
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.functional.robots.kinematic import KinematicRobot
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_file import with_installation
from dlokit.testing import CheckFailed, RobotCheckReport, checked_robot
from dlokit.types.robot import (
    ArmProtection,
    GripResult,
    JointTrajectory,
    Lease,
    MotionResult,
    RobotReason,
    RobotState,
)

replace = msgspec.structs.replace


def sound() -> Robot:
    return GatedRobot(KinematicRobot(LoopClock(), FIRST_ALONE[0]), GateConfig(), LoopClock().now_ns)


def sleeping() -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])


class FlawedRobot:
    """A sound robot with one flaw, in software."""

    def __init__(self, flaw: str) -> None:
        self._flaw = flaw
        self._bare = KinematicRobot(LoopClock(), FIRST_ALONE[0])
        self._gated = GatedRobot(self._bare, GateConfig(), LoopClock().now_ns)
        self._first: RobotState | None = None
        self._latched = False
        self._opened = 0
        self.children: list[subprocess.Popen[bytes]] = []

    @property
    def arm(self) -> Any:
        return self._gated.arm

    async def __aenter__(self) -> Self:
        self._opened += 1
        if self._flaw == "connects" or (self._flaw == "connects once" and self._opened > 1):
            raise HardwareError("no arm answers")
        if self._flaw == "leaves a process":
            self.children.append(sleeping())
        await self._gated.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._gated.__aexit__(kind, error, trace)

    def state(self) -> RobotState:
        state = self._gated.state()
        self._first = self._first or state
        match self._flaw:
            case "stale":
                return self._first
            case "not finite":
                return replace(state, tau_nm=np.full(7, np.nan))
            case "old":
                return replace(state, stamp_ns=state.stamp_ns - 300_000_000)
            case "another tool":
                x, y, z = state.T_world_tcp.position_m
                return replace(state, T_world_tcp=replace(state.T_world_tcp, position_m=np.array([x, y, z + 0.01])))
            case "latch not shown":
                return replace(state, stop_latched=False)
            case "latched at first":
                return replace(state, stop_latched=not self._latched)
            case "wrong width":
                return replace(state, finger_width_m=0.08)
            case _:
                return state

    def now_ns(self) -> int:
        return self._gated.now_ns()

    def newest_ns(self) -> int:
        return self._gated.newest_ns()

    def protection(self) -> ArmProtection | None:
        return self._gated.protection()

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        if self._flaw == "accepts every trajectory" and lease.duration_s == 0.2 and lease.holder:
            return await self._bare.follow(trajectory, lease)
        if self._flaw == "accepts every lease":
            lease = Lease(holder="anybody", duration_s=0.2)
        if self._flaw == "wrong reason" and trajectory.times_s[-1] < 0.1:
            raise SkillFailure(RobotReason.FAULT, "no")
        if self._flaw == "does not brake":
            result = await asyncio.shield(self._gated.follow(trajectory, lease))
        else:
            result = await self._gated.follow(trajectory, lease)
        return replace(result, largest_joint_error_rad=0.05) if self._flaw == "lags" else result

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        if self._flaw == "grips without a lease":
            lease = Lease(holder="anybody", duration_s=0.2)
        result = await self._gated.grip(width_m, force_n, lease)
        return replace(result, held=True) if self._flaw == "holds nothing" else result

    async def halt(self) -> None:
        await self._gated.halt()

    async def stop(self) -> None:
        if self._flaw == "stop is not latched":
            await self._gated.halt()
        elif self._flaw == "stop is slow":
            await self._gated.stop()
            await asyncio.sleep(1.3)
        else:
            await self._gated.stop()

    async def enable(self) -> None:
        self._latched = True
        if self._flaw != "enable does nothing":
            await self._gated.enable()

    def brake(self) -> None:
        if self._flaw != "does not brake":
            self._gated.brake()

    async def recover(self) -> None:
        await self._gated.recover()
        if self._flaw == "recover enables":
            await self._gated.enable()
        if self._flaw == "recover fails":
            raise SkillFailure(RobotReason.NOT_CONFIRMED, "no answer")


FLAWS = {
    "connects": ("connects", "no arm answers"),
    "latched at first": ("connects", "its stop is latched"),
    "another tool": ("arm", "10.0 mm from where the model has it"),
    "stale": ("state", "0 new states a second"),
    "old": ("state", "a state was 0.3"),
    "not finite": ("state", "not finite"),
    "accepts every trajectory": ("limits", "outside the range of a joint was accepted"),
    "wrong reason": ("limits", "a jump by 3 mrad in 5 ms was refused as fault"),
    "accepts every lease": ("lease", "a motion of a caller without a name was accepted"),
    "grips without a lease": ("lease", "a grip of a caller without a name was accepted"),
    "lags": ("motion", "largest error in a motion 50.0 mrad"),
    "does not brake": ("brake", "the motion ran to its end|the motion continues"),
    "stop is not latched": ("stop", "after a stop the state does not say that the stop is latched"),
    "latch not shown": ("stop", "after a stop the state does not say that the stop is latched"),
    "stop is slow": ("stop", "stop returned after 1.3"),
    "recover enables": ("stop", "after recover the state does not say that the stop is latched"),
    "enable does nothing": ("stop", "enable does not clear the stop"),
    "wrong width": ("grip", "ordered 0.0 mm, the state says 80.0 mm"),
    "holds nothing": ("grip", "at 0 mm the fingers hold something"),
    "recover fails": ("stop", "not_confirmed: no answer"),
    "connects once": ("closes", "entered again, it raises HardwareError: no arm answers"),
}
"""What is wrong, the check that fails by it, and what the check says."""


def checked(robot: Robot, rate_hz: float = 100.0) -> RobotCheckReport:
    return virtual_time.run(checked_robot(robot, rate_hz=rate_hz))


def test_a_sound_robot_passes_every_check_that_it_allows() -> None:
    report = checked(sound())
    assert report.passed == tuple(name for name in WANTED if name != "heartbeat")  # it needs none
    assert "Franka Emika Panda with its hand: 11 checks passed; connecting: " in str(report)


def test_the_arm_of_the_cell_passes_with_the_rate_that_it_states_and_its_heartbeats() -> None:
    pulse = SilenceablePulse(loop_pulse)

    async def main() -> None:
        async with test_robots.of_cell(pulse) as robot:
            gated = GatedRobot(robot, GateConfig(), LoopClock().now_ns)
            report = await checked_robot(gated, rate_hz=50.0, pulse=pulse)
            assert report.passed == tuple(WANTED)

    virtual_time.run(main())


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_robot_that_violates_a_requirement_fails_by_its_name_and_moves_no_more(flaw: str) -> None:
    check, said = FLAWS[flaw]
    with pytest.raises(CheckFailed, match=rf"(?s)failed: {check}\n.*{said}"):
        checked(FlawedRobot(flaw))


@pytest.fixture
def leaving() -> Iterator[FlawedRobot]:
    robot = FlawedRobot("leaves a process")
    yield robot
    for child in robot.children:
        child.kill()
        child.wait()


@pytest.mark.live
def test_a_driver_that_leaves_a_process_fails(leaving: FlawedRobot) -> None:
    with pytest.raises(CheckFailed, match=r"(?s)failed: closes\n.*1 of its processes still run"):
        checked(leaving)


def test_nothing_moves_unless_the_operator_says_yes_to_every_question() -> None:
    for noes in range(len(QUESTIONS)):
        asked: list[str] = []

        async def confirm(question: str, noes: int = noes, asked: list[str] = asked) -> bool:
            asked.append(question)
            return len(asked) <= noes

        robot = FlawedRobot("")
        before = virtual_time.run(_angles(robot))
        with pytest.raises(StartNotConfirmed, match="the operator said no to"):
            virtual_time.run(examined_robot(robot, confirm=confirm))
        assert asked == list(QUESTIONS[: noes + 1])
        np.testing.assert_array_equal(virtual_time.run(_angles(robot)), before)


def test_an_operator_may_enable_a_stopped_arm_before_the_check() -> None:
    asked: list[str] = []

    async def confirm(question: str) -> bool:
        asked.append(question)
        return True

    examined = virtual_time.run(examined_robot(FlawedRobot("latched at first"), confirm=confirm))
    assert asked == [LATCHED_QUESTION, *QUESTIONS]
    # Its state says ever after that nothing is latched, and so its stop fails.
    assert {finding.check for finding in examined.found} == {"stop"}


async def _angles(robot: Robot) -> Any:
    async with robot:
        return robot.state().q_rad


def make_robot() -> Robot:
    return FlawedRobot("stale")


def test_the_command_checks_an_installed_driver_and_a_function_and_writes_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(RobotCheckArgs(name="kinematic", operator_confirms=True), virtual_time.run) == 0
    said = capsys.readouterr().out
    assert said.startswith("The check reads the state")
    assert "11 checks passed; not tried: heartbeat" in said
    assert run(RobotCheckArgs(name="test_check_robot:make_robot", operator_confirms=True), virtual_time.run) == 1
    said = capsys.readouterr().out
    report = Path(said.rpartition("attach to a bug report: ")[2].strip()).read_text(encoding="utf-8")
    assert "# Check of a robot: FAILED: state" in report
    assert "| motion | not tried |" in report
    assert "| franky-control |" in report


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (RobotCheckArgs(name="kinematic"), "first asks an operator in a terminal"),
        (RobotCheckArgs(name="simulated", operator_confirms=True), "no device: it moves the arm of the simulated cell"),
        (RobotCheckArgs(name="arm_7", operator_confirms=True), "neither an installed driver"),
        (robot_args(["franka", "--arm", "ur5e", "--operator-confirms"]), "add --arm fr3 or --arm panda"),
    ],
)
def test_what_cannot_be_checked_is_bad_input(args: RobotCheckArgs, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        run(args)


def test_an_installation_says_which_arm_it_is_and_where_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    lab = tmp_path / "lab.toml"
    lab.write_text(
        '[table]\nposition_m = [0.0, 0.0, 0.08]\n[[arms]]\nname = "left"\nmodel = "fr3"\n'
        "position_m = [0.0, 0.0, 0.0]\nrpy_deg = [0.0, 0.0, 90.0]\n"
        "home_deg = [-90.0, -51.6, 0.0, -143.2, 0.0, 91.7, 45.0]\n",
        encoding="utf-8",
    )
    args = robot_args(["kinematic", "--installation", str(lab), "--operator-confirms"])
    assert run(args, virtual_time.run) == 0
    said = capsys.readouterr().out
    report = Path(said.rpartition("attach to a bug report: ")[2].strip()).read_text(encoding="utf-8")
    assert "Franka Research 3" in report
    (mount,) = with_installation(RunConfig(), lab).installation.mounts(1)
    tool = tcp_pose(mount.model, mount.model.home_q_rad)  # of a base that stands 8 cm below the table's top, turned
    x, y, z = np.round([-tool.position_m[1], tool.position_m[0], tool.position_m[2] - 0.08], 4).tolist()
    assert f"[{x}, {y}, {z}]" in report
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        run(robot_args(["kinematic", "--installation", "nowhere.toml", "--operator-confirms"]))


def test_the_settings_of_the_named_driver_are_options() -> None:
    args = robot_args(["franka", "--driver.address", "127.0.0.9", "--driver.no-real-time"])
    driver: Any = args.driver
    assert (driver.name, driver.address, driver.real_time) == ("franka", "127.0.0.9", False)
