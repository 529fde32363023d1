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

from dlokit.communication.port import Port
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.timing.pulse import Pulse, loop_pulse
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.errors import BadValue, ConfigError, HardwareError, SkillFailure, StartNotConfirmed
from dlokit.extras.checks.checks import require_none
from dlokit.extras.checks.command import RobotCheckArgs, robot_args, run
from dlokit.extras.checks.device_report import CheckedDevice
from dlokit.extras.checks.new_process import latched_in_new_process, sent
from dlokit.extras.checks.robot_checks import LATCHED_QUESTION, QUESTIONS, WANTED, SilenceablePulse
from dlokit.extras.checks.robots import examined_robot
from dlokit.functional.robots.base import Robot
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.functional.robots.kinematic import KinematicRobot
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_file import with_installation
from dlokit.testing import CheckFailed, check_robot
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


def sleeping() -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])


class FlawedRobot:
    """A sound robot with one flaw, in software; "" has none."""

    def __init__(self, flaw: str, pulse: Pulse = loop_pulse) -> None:
        self._flaw, self._pulse = flaw, pulse
        self._beat_ns = 0
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
        elif self._flaw == "no heartbeats":
            result = await self._gated.follow(trajectory, lease)
        else:
            async with self._pulse(self._beat, lease.heartbeat_s):
                result = await self._watched(trajectory, lease)
        return replace(result, largest_joint_error_rad=0.05) if self._flaw == "lags" else result

    def _beat(self) -> None:
        self._beat_ns = self._gated.now_ns()

    async def _watched(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Brake as the controller of an arm does, when no heartbeat came within the lease."""
        self._beat_ns, lost = LoopClock().now_ns(), False
        moving = asyncio.ensure_future(self._gated.follow(trajectory, lease))
        try:
            while not (await asyncio.wait({moving}, timeout=0.02))[0]:
                silent_s = (self.state().stamp_ns - self._beat_ns) / 1e9
                if silent_s > lease.duration_s and not lost and self._flaw != "goes on without heartbeats":
                    lost = True
                    self._bare.brake()
            return moving.result()
        except SkillFailure as error:
            if lost:
                raise SkillFailure(RobotReason.LOST_COMMANDER, "no heartbeat came in time") from error
            raise
        finally:
            moving.cancel()

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
    "no heartbeats": ("heartbeat", "it sent no heartbeats in the motions before"),
    "goes on without heartbeats": ("heartbeat", "the motion ran to its end|the motion continues"),
    "stop is not latched": ("stop", "after a stop the state does not say that the stop is latched"),
    "latch not shown": ("stop", "after a stop the state does not say that the stop is latched"),
    "stop is slow": ("stop", "stop returned after 1.3"),
    "recover enables": ("stop", "after recover the state does not say that the stop is latched"),
    "enable does nothing": ("stop", "enable does not clear the stop"),
    "wrong width": ("grip", "ordered 0.0 mm, the state says 80.0 mm"),
    "holds nothing": ("grip", "at 0 mm the fingers hold something"),
    "recover fails": ("heartbeat", "not_confirmed: no answer"),
    "connects once": ("closes", "entered again, it raises HardwareError: no arm answers"),
    "forgets its stop": ("latch", "a new process that opened the driver after a stop saw none"),
}
"""What is wrong, the check that fails by it, and what the check says."""


async def examined(robot: Robot, pulse: SilenceablePulse, flaw: str = "", **given: Any) -> CheckedDevice:
    """Examine a robot whose memory counts as the arm's; a new process would not see it."""

    async def latch_seen() -> bool:
        return flaw != "forgets its stop"

    return await examined_robot(robot, pulse=pulse, latch_seen=latch_seen, **given)


def flawed(flaw: str) -> tuple[FlawedRobot, SilenceablePulse]:
    pulse = SilenceablePulse(loop_pulse)
    return FlawedRobot(flaw, pulse), pulse


def test_a_sound_robot_passes_every_check() -> None:
    found = virtual_time.run(examined(*flawed("")))
    assert (found.found, found.untried) == ([], ())


def test_the_arm_of_the_cell_passes_with_the_rate_that_it_states_and_its_heartbeats() -> None:
    pulse = SilenceablePulse(loop_pulse)

    async def main() -> None:
        async with test_robots.of_cell(pulse) as robot:
            gated = GatedRobot(robot, GateConfig(), LoopClock().now_ns)
            found = await examined(gated, pulse, rate_hz=50.0)
            assert (found.found, found.untried) == ([], ())

    virtual_time.run(main())


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_robot_that_violates_a_requirement_fails_by_its_name_and_moves_no_more(flaw: str) -> None:
    check, said = FLAWS[flaw]
    found = virtual_time.run(examined(*flawed(flaw), flaw))
    with pytest.raises(CheckFailed, match=rf"(?s)failed: {check}\n.*{said}"):
        require_none("it", found.found)
    later = tuple(WANTED)[tuple(WANTED).index(check) + 1 :]
    assert {*later} - {"closes"} <= {*found.untried}


@pytest.fixture
def leaving() -> Iterator[tuple[FlawedRobot, SilenceablePulse]]:
    robot, pulse = flawed("leaves a process")
    yield robot, pulse
    for child in robot.children:
        child.kill()
        child.wait()


@pytest.mark.live
def test_a_driver_that_leaves_a_process_fails(leaving: tuple[FlawedRobot, SilenceablePulse]) -> None:
    found = virtual_time.run(examined(*leaving))
    with pytest.raises(CheckFailed, match=r"(?s)failed: closes\n.*1 of its processes still run"):
        require_none("it", found.found)
    assert found.untried == ("latch",)


LATCH = Path("latch")
"""What the controller of the arm below remembers."""


class RememberingRobot(FlawedRobot):
    """Its stop is kept outside of the driver, in a file."""

    def state(self) -> RobotState:
        return replace(super().state(), stop_latched=LATCH.exists())


def remembering(port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
    return RememberingRobot("", pulse)


def forgetful(port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
    return FlawedRobot("", pulse)


def absent(port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
    return FlawedRobot("connects", pulse)


@pytest.mark.live
def test_a_new_process_sees_a_stop_that_the_arm_keeps_and_none_of_the_drivers_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    LATCH.touch()
    mount = FIRST_ALONE[0]
    assert asyncio.run(latched_in_new_process(sent(remembering, mount)))
    assert not asyncio.run(latched_in_new_process(sent(forgetful, mount)))
    LATCH.unlink()
    assert not asyncio.run(latched_in_new_process(sent(remembering, mount)))
    with pytest.raises(HardwareError, match=r"a new process could not open the driver: .*no arm answers"):
        asyncio.run(latched_in_new_process(sent(absent, mount)))


def test_what_a_new_process_could_not_import_is_refused_before_anything_moves() -> None:
    def here(port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
        raise AssertionError("it must not be called")

    with pytest.raises(BadValue, match=r"a new process must be able to import .*at the top of a module"):
        check_robot(here)
    here.__module__ = "__main__"
    with pytest.raises(BadValue, match="defined in the script that was started"):
        check_robot(here)


def test_what_is_no_robot_is_refused_with_what_it_lacks() -> None:
    with pytest.raises(BadValue, match=r"made a bool, which is no robot: it lacks __aenter__, .*recover"):
        check_robot(no_robot)


def no_robot(port: Port, mount: ArmMount, pulse: Pulse) -> Any:
    return True


def test_nothing_moves_unless_the_operator_says_yes_to_every_question() -> None:
    for noes in range(len(QUESTIONS)):
        asked: list[str] = []

        async def confirm(question: str, noes: int = noes, asked: list[str] = asked) -> bool:
            asked.append(question)
            return len(asked) <= noes

        robot, pulse = flawed("")
        before = virtual_time.run(_angles(robot))
        with pytest.raises(StartNotConfirmed, match="the operator said no to"):
            virtual_time.run(examined(robot, pulse, confirm=confirm))
        assert asked == list(QUESTIONS[: noes + 1])
        np.testing.assert_array_equal(virtual_time.run(_angles(robot)), before)


def test_an_operator_may_enable_a_stopped_arm_before_the_check() -> None:
    asked: list[str] = []

    async def confirm(question: str) -> bool:
        asked.append(question)
        return True

    found = virtual_time.run(examined(*flawed("latched at first"), confirm=confirm))
    assert asked == [LATCHED_QUESTION, *QUESTIONS]
    # Its state says ever after that nothing is latched, and so its stop fails.
    assert {finding.check for finding in found.found} == {"stop"}


async def _angles(robot: Robot) -> Any:
    async with robot:
        return robot.state().q_rad


def stale(port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
    return FlawedRobot("stale", pulse)


def in_software(port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
    return KinematicRobot(port.clock, mount)


def without_arguments() -> Robot:
    return FlawedRobot("")


def report_of(said: str) -> str:
    return Path(said.rpartition("attach to a bug report: ")[2].strip()).read_text(encoding="utf-8")


def test_the_command_checks_what_a_function_or_the_settings_make_and_writes_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(RobotCheckArgs(name="test_check_robot:stale", operator_confirms=True), virtual_time.run) == 1
    said = capsys.readouterr().out
    assert said.startswith("The check reads the state")
    report = report_of(said)
    assert "# Check of a robot: FAILED: state" in report
    assert "| motion | not tried |" in report
    assert "| franky-control |" in report
    # The settings of an arm in software, which sends no heartbeats: a check that cannot be tried is not passed.
    settings = "dlokit.functional.robots.kinematic:KinematicRobotConfig"
    assert run(RobotCheckArgs(name=settings, operator_confirms=True), virtual_time.run) == 1
    assert "# Check of a robot: FAILED: heartbeat" in report_of(capsys.readouterr().out)


def test_the_help_says_what_the_function_is_called_with(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        robot_args(["--help"])
    assert "function(port, mount, pulse)" in " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (RobotCheckArgs(name="franka"), "first asks an operator in a terminal"),
        (RobotCheckArgs(name="simulated", operator_confirms=True), "simulated is no device: it moves an arm in soft"),
        (RobotCheckArgs(name="kinematic", operator_confirms=True), "kinematic is no device: .*examples/robot_package"),
        (
            RobotCheckArgs(name="test_check_robot:without_arguments", operator_confirms=True),
            r"cannot be called as without_arguments\(port, mount, pulse\), as `build` .*too many positional arguments",
        ),
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
    args = robot_args(["test_check_robot:in_software", "--installation", str(lab), "--operator-confirms"])
    assert run(args, virtual_time.run) == 1
    report = report_of(capsys.readouterr().out)
    assert "Franka Research 3" in report
    (mount,) = with_installation(RunConfig(), lab).installation.mounts(1)
    tool = tcp_pose(mount.model, mount.model.home_q_rad)  # of a base that stands 8 cm below the table's top, turned
    x, y, z = np.round([-tool.position_m[1], tool.position_m[0], tool.position_m[2] - 0.08], 4).tolist()
    assert f"[{x}, {y}, {z}]" in report
    with pytest.raises(ConfigError, match=r"nowhere\.toml"):
        run(robot_args(["franka", "--installation", "nowhere.toml", "--operator-confirms"]))


def test_the_settings_of_the_named_driver_are_options() -> None:
    args = robot_args(["franka", "--driver.address", "127.0.0.9", "--driver.no-real-time"])
    driver: Any = args.driver
    assert (driver.name, driver.address, driver.real_time) == ("franka", "127.0.0.9", False)
