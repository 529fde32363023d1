"""`dlokit doctor franka`: the first start of a Franka, step by step, each confirmed by the operator."""

import asyncio
import contextlib
import resource
import socket
import time
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
from rich.console import Console

from dlokit import geometry
from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.app.doctor.doctor import findings_table
from dlokit.app.doctor.installation import installation_findings
from dlokit.app.doctor.machine import DoctorRow, Severity
from dlokit.app.shape.questions import ask_in_terminal
from dlokit.communication import topics
from dlokit.communication.port import InlineCompute, Port
from dlokit.communication.skill import Skill
from dlokit.communication.timing.deadlines import ThreadWatchdog
from dlokit.communication.timing.pulse import ThreadPulse
from dlokit.description.arm.franka import FR3
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import EXIT_FAULT, ConfigError, DlokitError, HardwareError
from dlokit.extras.franka.driver import FrankaRobot, FrankaRobotConfig
from dlokit.extras.franka.link import INSTALL
from dlokit.extras.franka.panda_link import ARM as PANDA
from dlokit.extras.franka.panda_link import INSTALL as PANDA_INSTALL
from dlokit.functional.robots.base import Robot
from dlokit.functional.robots.gate import GateConfig, GatedRobot
from dlokit.geometry import downward
from dlokit.skills.robot import api as robot_api
from dlokit.skills.robot.component import RobotComponent
from dlokit.skills.robot.config import RobotConfig
from dlokit.system.build import Wiring, assemble
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_file import with_installation
from dlokit.system.operator_start import has_terminal
from dlokit.types.action import VelocityProfile
from dlokit.types.outcome import Failed, Rejected, Succeeded
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState

_ANSWERS_S = 2.0
_STATE_S = 15.0  # the first one comes when the arm is connected
_DESK_PORT = 443  # of the controller's web page; a computer that refuses it answers as well
_SPEED_SCALE = 0.1
_AHEAD_M = 0.5  # in front of the base, where the arm comes down
_ABOVE_M = 0.1  # over the height of a grasp
_TURN_RAD = 0.1  # of the base, whose turn lowers nothing
_UNTIL_STOP_S = 1.5  # of about 4 s that the turn takes
_STANDS_RAD = 2e-3
_BUTTON_S = 30.0
_LOOKS = 5
_CAPTURE_S = 2.0
_RTPRIO = 99

Ask = Callable[[str], Awaitable[bool]]
"""Asks the operator one question; True only for a clear yes."""


@dataclass(frozen=True, kw_only=True)
class FrankaDoctorArgs:
    """Check a Franka step by step before its first run: network, kernel, thresholds, camera, stop, first grasp.

    Each step is announced, and done after the operator's yes; a failed step reports the remedy, and nothing moves
    after it. Before the stop is tested, only the fingers move. Ctrl-C brakes the arm at any time. Exit code: 0 all
    steps are done or named as skipped, 1 one failed, 2 bad input.
    """

    installation: Annotated[Path | None, flag("FILE")] = None
    """Installation file: poses of arm, table and camera. Without it the camera's steps are skipped."""
    driver: FrankaRobotConfig = field(default_factory=FrankaRobotConfig)
    """Settings of the driver, as of `dlokit shape --driver franka`."""


class ReadableRobot(Robot, Protocol):
    """A robot that reports the protection settings of its arm."""

    def read_back(self) -> str:
        """The mode, tool and load that the arm reports."""
        ...


@dataclass(frozen=True, kw_only=True)
class _Step:
    """One step."""

    what: str
    announced: str
    """The announcement to the operator."""
    run: Callable[[], Coroutine[Any, Any, DoctorRow]]
    needed: bool = False
    """Whether the later steps require it."""


def _answers(address: str) -> None:
    """Return when a computer answers at an address. Raises `OSError`."""
    try:
        socket.create_connection((address, _DESK_PORT), _ANSWERS_S).close()
    except ConnectionRefusedError:
        return


class FirstStart:
    """The steps and their results."""

    def __init__(
        self,
        args: FrankaDoctorArgs,
        ask: Ask,
        say: Callable[[str], None],
        robot: ReadableRobot | None = None,
        answers: Callable[[str], None] = _answers,
    ) -> None:
        """`ask` asks the operator; `robot` is the arm, by default as in the settings.

        `answers` returns when a computer answers at an address, and raises `OSError` otherwise.
        """
        self._args, self._ask, self._say, self._answers = args, ask, say, answers
        self._run = RunConfig() if args.installation is None else with_installation(RunConfig(), args.installation)
        self._mount = ArmMount(model=FR3) if args.installation is None else self._run.installation.mounts(1)[0]
        wiring = Wiring()
        self._port = Port(wiring.transport, wiring.clock, InlineCompute(), owner="doctor", publishes=())
        args.driver.build(self._port, self._mount, ThreadPulse())  # raises `ConfigError` for another arm
        self._driver = robot or FrankaRobot(args.driver, self._mount, ThreadPulse())
        watch = ThreadWatchdog()
        self._gated = GatedRobot(
            self._driver,
            GateConfig(speed_scale=_SPEED_SCALE),
            time.monotonic_ns,
            T_world_base=self._mount.T_world_base,
            workspace=self._mount.workspace,
            watch=watch,
        )
        component = RobotComponent(
            RobotConfig(),
            self._gated,
            time.monotonic_ns,
            self._mount.T_world_base,
            watch=watch,
            standing=self._gated.standing,
        )
        self._host = assemble([component.name], self._run, wiring, build=lambda *_: component)
        self._opened = AsyncExitStack()

    @property
    def steps(self) -> tuple[_Step, ...]:
        """All steps, in their order."""
        driver = self._args.driver
        x, y = self._place_m
        return (
            _Step(what="network", announced=f"Ask {driver.address} for an answer.", run=self._network),
            _Step(what="library", announced=f"Look for {self._package[0]}.", run=self._library),
            _Step(what="real time", announced="Look at the kernel and at this user's limits.", run=self._real_time),
            _Step(
                what="connection",
                announced="Connect to the arm, and set load and collision thresholds. Nothing moves.",
                run=self._connection,
                needed=True,
            ),
            _Step(what="thresholds", announced="Compare what the arm has with what was set.", run=self._thresholds),
            _Step(what="self-test", announced="Ask whether a self-test is due.", run=self._self_test),
            _Step(what="camera", announced=f"Take {_LOOKS} looks.", run=self._camera),
            _Step(what="calibration", announced="Read the age and the residual of the calibration.", run=self._age),
            _Step(
                what="gripper",
                announced="THE FINGERS close and open; after switching on they home first. Put nothing between them.",
                run=self._gripper,
            ),
            _Step(
                what="stop",
                announced=f"THE ARM MOVES: the base turns by {np.degrees(_TURN_RAD):.0f}° at {_SPEED_SCALE:.0%} of its "
                "speed, and is stopped on the way. Keep a hand on the emergency stop.",
                run=self._stop,
                needed=True,
            ),
            _Step(
                what="arm's button",
                announced="You press the arm's own stop button while the arm stands. Answer no at a simulator.",
                run=self._button,
            ),
            _Step(
                what="dry run",
                announced=f"THE ARM MOVES home, then {100 * _ABOVE_M:.0f} cm above a grasp at ({x:.2f}, {y:.2f}) m, "
                f"and home, at {_SPEED_SCALE:.0%} of its speed. Clear the table.",
                run=self._dry_run,
                needed=True,
            ),
            _Step(
                what="first grasp",
                announced=f"THE ARM MOVES down to the table and grasps at ({x:.2f}, {y:.2f}) m: lay a "
                "straight piece of the DLO there, across the direction in which the arm reaches.",
                run=self._first_grasp,
            ),
        )

    async def rows(self) -> list[DoctorRow]:
        """Do the steps that the operator confirms; the arm is at rest and disconnected afterwards."""
        rows: list[DoctorRow] = []
        ended = ""
        async with self._opened:
            for number, step in enumerate(self.steps, 1):
                if ended:
                    rows.append(_skipped(step.what, ended))
                    continue
                self._say(f"\nStep {number} of {len(self.steps)}, {step.what}. {step.announced}")
                row = await self._done(step)
                self._say(f"  {row.standing.value}: {row.found}" + (f". To do: {row.fix}" if row.fix else ""))
                rows.append(row)
                if row.standing is Severity.LACKING:
                    ended = f"not reached: {step.what} failed"
                elif step.needed and row.standing is not Severity.READY:
                    ended = f"not reached without {step.what}"
        return rows

    async def _done(self, step: _Step) -> DoctorRow:
        if not await self._ask("Go on with this step?"):
            return _skipped(step.what, "the operator said no")
        try:
            return await step.run()
        except _StepFailed as failed:
            return DoctorRow(step.what, Severity.LACKING, str(failed), failed.fix)
        except DlokitError as error:
            fix = "do what the message says, then start this command again"
            return DoctorRow(step.what, Severity.LACKING, str(error), fix)

    async def _network(self) -> DoctorRow:
        address, began_s = self._args.driver.address, time.monotonic()
        try:
            self._answers(address)  # blocking is allowed: nothing else runs yet
        except OSError as error:
            raise _StepFailed(
                f"{address} does not answer: {error}",
                "check cable, power and --driver.address; give this computer an address in the same network (Desk, "
                "Settings, Network)",
            ) from error
        return _ready("network", f"{address} answers after {1e3 * (time.monotonic() - began_s):.1f} ms")

    async def _library(self) -> DoctorRow:
        package, fix = self._package
        try:
            version = metadata.version(package)
        except metadata.PackageNotFoundError as error:
            raise _StepFailed(f"{package} is not installed", fix) from error
        return _ready("library", f"{package} {version}")

    @property
    def _package(self) -> tuple[str, str]:
        """The library of the arm, and how to install it."""
        panda = self._mount.model.name == PANDA
        return ("franka-rs", PANDA_INSTALL) if panda else ("franky-control", INSTALL)

    async def _real_time(self) -> DoctorRow:
        kernel = real_time_kernel()
        priority = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        memory = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
        said = (
            f"{'a' if kernel else 'no'} real-time kernel, rtprio {'unlimited' if priority < 0 else priority}, memlock "
            f"{'unlimited' if memory == resource.RLIM_INFINITY else f'{memory // 1024} KiB'}"
        )
        if not self._args.driver.real_time:
            return _skipped("real time", f"{said}; not asked for (--driver.no-real-time, for simulators only)")
        enough = kernel and (priority < 0 or priority >= _RTPRIO) and memory == resource.RLIM_INFINITY
        if not enough:
            raise _StepFailed(
                said,
                "install a PREEMPT_RT kernel; put rtprio 99 and memlock unlimited for this user into "
                "/etc/security/limits.conf, and log in again",
            )
        return _ready("real time", said)

    async def _connection(self) -> DoctorRow:
        async with self._driver:  # the driver alone first: its errors then arrive here, and not in the log of the host
            pass
        await self._opened.enter_async_context(self._host)
        state = await self._state()
        if state.stop_latched:
            if not await self._ask(
                "The stop of this arm is latched. Have you seen to its cause, and may it be enabled?"
            ):
                raise _StepFailed("the stop is latched", "see to its cause, then start this command again")
            await self._call(robot_api.ENABLE)
        return _ready(
            "connection",
            f"{self._mount.model.title}, {self._driver.read_back()}; its firmware speaks the library's protocol (the "
            "library does not say which version it is)",
        )

    async def _thresholds(self) -> DoctorRow:
        driver = self._args.driver
        return _ready(
            "thresholds",
            f"the arm accepted {driver.collision_torque_nm:g} N·m and {driver.collision_force_n:g} N (the library "
            f"cannot read them back); tool frame, tool mass and load ({driver.load_kg:g} kg) were read back and agree",
        )

    async def _self_test(self) -> DoctorRow:
        self._say("  The arm's control interface does not say it. Open Desk, Settings, System: self-tests.")
        if await self._ask("Does Desk say that a self-test is due?"):
            raise _StepFailed("a self-test is due", "run it in Desk, then start this command again")
        return _ready("self-test", "none is due, by the operator's word: the library does not say it")

    async def _camera(self) -> DoctorRow:
        if self._args.installation is None or self._run.camera.sees_cell:
            return _skipped("camera", "no real camera is configured: --installation FILE names one")
        with self._run.camera.build(self._port) as camera:
            stamps_s = [(await camera.capture(_CAPTURE_S)).stamp_ns / 1e9 for _ in range(_LOOKS)]
        period_ms = 1e3 * float(np.median(np.diff(stamps_s)))
        return _ready("camera", f"{self._run.camera.name}: {_LOOKS} pictures, {period_ms:.0f} ms apart")

    async def _age(self) -> DoctorRow:
        if self._args.installation is None:
            return _skipped("calibration", "no --installation FILE names one")
        for row in installation_findings(self._args.installation):
            if row.what == "calibration":
                return row
        return _skipped("calibration", "the camera of the installation needs none")

    async def _gripper(self) -> DoctorRow:
        closed = await self._call(robot_api.GRASP)
        opened = await self._call(robot_api.RELEASE)
        found = f"closed to {1e3 * closed.width_m:.1f} mm, opened to {1e3 * opened.width_m:.1f} mm"
        if closed.held:
            raise _StepFailed(f"{found}: something was between the fingers", "free them, then start this command again")
        return _ready("gripper", found)

    async def _stop(self) -> DoctorRow:
        begin = (await self._state()).q_rad
        turn = np.zeros(len(begin))
        turn[0] = -_TURN_RAD if begin[0] > 0.0 else _TURN_RAD
        moving = asyncio.ensure_future(self._port.call(robot_api.MOVE_JOINTS, begin + turn))
        await asyncio.sleep(_UNTIL_STOP_S)
        began_s = time.monotonic()
        await self._call(robot_api.STOP)
        took_s = time.monotonic() - began_s
        ended = await moving
        stands = (await self._state()).q_rad
        wrong = ""
        if not (isinstance(ended, Failed) and ended.reason == "stopped"):
            wrong = f"the motion ended as {ended}"
        again = await self._port.call(robot_api.MOVE_JOINTS, begin)
        state = await self._state()
        if not isinstance(again, Rejected) or not state.stop_latched:
            wrong = "the stop is not latched: the arm takes another motion"
        if float(np.abs(state.q_rad - stands).max()) > _STANDS_RAD:
            wrong = "the arm moved after the stop was confirmed"
        turned_deg = float(np.degrees(np.abs(stands - begin).max()))
        if not wrong and turned_deg < np.degrees(_STANDS_RAD):
            wrong = "the arm had not moved before the stop"
        if wrong:
            raise _StepFailed(wrong, "do not use this arm; report it with python -m dlokit.testing robot franka")
        if not await self._ask("Did the arm move, and stop? With yes it is enabled again, and turns back."):
            raise _StepFailed("the operator did not see the arm move and stop", "is --driver.address that of this arm?")
        await self._call(robot_api.ENABLE)
        await self._call(robot_api.MOVE_JOINTS, begin)
        return _ready("stop", f"after {turned_deg:.1f}°, confirmed within {1e3 * took_s:.0f} ms, latched until enabled")

    async def _button(self) -> DoctorRow:
        self._say(f"  Press the arm's stop button now, within {_BUTTON_S:.0f} s.")
        now_s = asyncio.get_running_loop().time
        deadline_s = now_s() + _BUTTON_S
        while not (await self._state()).stop_latched:
            if now_s() > deadline_s:
                raise _StepFailed(
                    f"no stop came within {_BUTTON_S:.0f} s", "check the button's cable to the arm (X3), or its socket"
                )
            await asyncio.sleep(0.1)
        if not await self._ask("The stop came. Have you released the button, and may the arm be enabled?"):
            raise _StepFailed("the stop is latched", "release the button, then start this command again")
        await self._call(robot_api.ENABLE)
        return _ready("arm's button", "latches the stop")

    async def _dry_run(self) -> DoctorRow:
        await self._call(robot_api.HOME)
        moved = await self._call(robot_api.MOVE_TO, self._over(_ABOVE_M))
        await self._call(robot_api.HOME)
        return _ready("dry run", f"largest tracking error {1e3 * moved.largest_joint_error_rad:.1f} mrad")

    async def _first_grasp(self) -> DoctorRow:
        await self._call(robot_api.MOVE_TO, self._over(_ABOVE_M))
        await self._call(robot_api.RELEASE)
        await self._call(robot_api.MOVE_LINEAR, self._over(0.0), VelocityProfile())
        gripped = await self._call(robot_api.GRASP)
        if gripped.held:
            await self._call(robot_api.MOVE_LINEAR, self._over(_ABOVE_M / 2), VelocityProfile())
            held = (await self._state()).holding
            await self._call(robot_api.MOVE_LINEAR, self._over(0.0), VelocityProfile())
        else:
            held = False
        await self._call(robot_api.RELEASE)
        await self._call(robot_api.MOVE_LINEAR, self._over(_ABOVE_M), VelocityProfile())
        await self._call(robot_api.HOME)
        width = f"the fingers closed to {1e3 * gripped.width_m:.1f} mm"
        if held:
            return _ready("first grasp", f"{width}, lifted the DLO, and laid it down")
        fix = "lay the DLO where the fingers close; one thinner than 2 mm cannot be told from nothing"
        return DoctorRow("first grasp", Severity.ADVICE, f"{width} and held nothing", fix)

    @property
    def _place_m(self) -> tuple[float, float]:
        base = self._mount.T_world_base
        ahead = np.array([_AHEAD_M, 0.0, 0.0])
        x, y = (ahead if base is None else geometry.transform(base, ahead))[:2].tolist()
        return x, y

    def _over(self, above_m: float) -> Pose:
        """The gripper over the place, its fingers closing along the direction in which the arm reaches."""
        base = self._mount.T_world_base
        turned_rad = 0.0
        if base is not None:
            R = geometry.rotation(base)
            turned_rad = float(np.arctan2(R[1, 0], R[0, 0]))
        x, y = self._place_m
        return downward([x, y, self._mount.model.gripper.grasp_height_m() + above_m], turned_rad + np.pi / 2)

    async def _state(self) -> RobotState:
        """The arm's next state."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_STATE_S):
                async for state in self._port.stream(topics.ROBOT_STATE):
                    return state
        raise HardwareError(f"no state of the arm came within {_STATE_S:g} s")

    async def _call(self, skill: Skill[..., Any], *args: Any) -> Any:
        """The result of a skill. Raises `_StepFailed`."""
        outcome = await self._port.call(skill, *args)
        if isinstance(outcome, Succeeded):
            return outcome.result
        raise _StepFailed(
            f"robot.{skill.name}: {outcome.why}",
            "see the message" if outcome.named_reason else "is this computer too busy?",
        )


class _StepFailed(Exception):
    """A step failed."""

    def __init__(self, found: str, fix: str) -> None:
        """The finding and the remedy."""
        super().__init__(found)
        self.fix = fix


def real_time_kernel(path: Path = Path("/sys/kernel/realtime")) -> bool:
    """Whether this is a PREEMPT_RT kernel, by the file that reports it."""
    try:
        return path.read_text(encoding="ascii").strip() == "1"
    except OSError:
        return False


def _ready(what: str, found: str) -> DoctorRow:
    return DoctorRow(what, Severity.READY, found)


def _skipped(what: str, why: str) -> DoctorRow:
    return DoctorRow(what, Severity.SKIPPED, why)


def exit_code(rows: Sequence[DoctorRow]) -> int:
    """1 if a step failed."""
    return EXIT_FAULT if any(row.standing is Severity.LACKING for row in rows) else 0


def run(args: FrankaDoctorArgs) -> int:
    """Do the steps with the operator in the terminal."""
    if not has_terminal():
        raise ConfigError("dlokit doctor franka asks an operator before each step: start it in a terminal.")
    console = Console()

    async def ask(question: str) -> bool:
        return await ask_in_terminal(question, console)

    async def first_start() -> list[DoctorRow]:
        return await FirstStart(args, ask, partial(say, console)).rows()

    rows = asyncio.run(first_start())
    console.print(findings_table(rows, "dlokit doctor franka"))
    return exit_code(rows)


COMMAND = CliCommand(FrankaDoctorArgs, run)
