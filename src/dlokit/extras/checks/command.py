"""`python -m dlokit.testing observer NAME`: the checks of `dlokit.testing` on a strategy, camera, arm or robot."""

import asyncio
import importlib
import inspect
import math
import sys
import time
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro
from rich.console import Console

from dlokit.app.commands import OPTIONS, flag
from dlokit.app.shape.questions import ask_in_terminal
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.strategies import NamedConfig, StrategyKind
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import ArmMount, arm_model
from dlokit.errors import (
    EXIT_BAD_INPUT,
    EXIT_FAULT,
    EXIT_INTERRUPTED,
    CheckFailed,
    ConfigError,
    InputError,
    StartNotConfirmed,
)
from dlokit.extras.checks.arms import examined_arm
from dlokit.extras.checks.cameras import examined_camera
from dlokit.extras.checks.checks import require_none
from dlokit.extras.checks.device_report import CheckedDevice, write_report
from dlokit.extras.checks.new_process import BuildRobot
from dlokit.extras.checks.observers import check_observer
from dlokit.extras.checks.planners import check_planner
from dlokit.extras.checks.robot_checks import PLAN
from dlokit.extras.checks.robots import examined_driver
from dlokit.extras.checks.segmentations import check_segmentation
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.recorded import RecordedCamera, RecordedCameraConfig
from dlokit.functional.cameras.strategies import CAMERAS, AnyCamera
from dlokit.functional.robots.kinematic import KinematicRobotConfig
from dlokit.functional.robots.strategies import DRIVERS, OURS, AnyRobotDriver
from dlokit.skills.observer.config import OBSERVERS
from dlokit.skills.perception.config import SEGMENTATIONS
from dlokit.skills.planning.config import PLANNERS
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_file import with_installation
from dlokit.system.operator_start import FLAG, has_terminal

C = TypeVar("C", bound=NamedConfig)


@dataclass(frozen=True, kw_only=True)
class ObserverCheckArgs:
    """Check that an observer keeps to its protocol. Exit code: 0 it does, 1 it does not, 2 bad input."""

    observer: Annotated[str, tyro.conf.Positional]
    """Name of an installed observer, or module:Class of its settings."""


@dataclass(frozen=True, kw_only=True)
class PlannerCheckArgs:
    """Check that a planner keeps to its protocol. Exit code: 0 it does, 1 it does not, 2 bad input."""

    planner: Annotated[str, tyro.conf.Positional]
    """Name of an installed planner, or module:Class of its settings."""


@dataclass(frozen=True, kw_only=True)
class SegmentationCheckArgs:
    """Check that a segmentation keeps to its protocol. Exit code: 0 it does, 1 it does not, 2 bad input."""

    segmentation: Annotated[str, tyro.conf.Positional]
    """Name of an installed segmentation, or module:Class of its settings."""


@dataclass(frozen=True, kw_only=True)
class CameraCheckArgs:
    """Check that a camera keeps to its protocol. Exit code: 0 it does, 1 it does not, 2 bad input.

    Point it at something with contrast.

    Try
      python -m dlokit.testing camera realsense
      python -m dlokit.testing camera genicam --camera.left A --camera.right B --camera.calibration pair.toml
      python -m dlokit.testing camera pictures/

    Writes a folder to attach to a bug report: report.md, and the last pictures.
    """

    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="CAMERA")]
    """An installed camera, as `dlokit track --camera` takes it; a folder of recorded pictures; or module:function that
    makes a camera."""
    captures: int = 10
    """Number of captures."""
    timeout_s: float = 2.0
    """Time limit of a capture [s]."""
    host_clock: bool = True
    """Check that stamps are on the host's monotonic clock, after the call; not for recorded pictures."""
    camera: AnyCamera = field(default_factory=RecordedCameraConfig)
    """Settings of the installed camera."""


@dataclass(frozen=True, kw_only=True)
class ArmCheckArgs:
    """Check that an arm can be planned with, and write a report. Exit code: 0 it can, 1 it cannot, 2 bad input."""

    arm: Annotated[str, tyro.conf.Positional]
    """panda, fr3, ur5e, or the .toml file of another arm."""


@dataclass(frozen=True, kw_only=True)
class RobotCheckArgs:
    """Check that the driver of an arm keeps to its protocol. **The arm moves**, slowly and by a few degrees.

    Exit code: 0 it does, 1 it does not or an operator said no, 2 bad input.

    Try
      python -m dlokit.testing robot franka --installation lab.toml --driver.address 172.16.0.2
      python -m dlokit.testing robot my_package.driver:MyArmConfig --arm my_arm.toml
      python -m dlokit.testing robot my_package.driver:make_robot

    Lists the motions and asks before anything moves. For the last check a new process opens the driver once more.
    Writes a folder to attach to a bug report: report.md.
    """

    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ROBOT")]
    """An installed driver, as `dlokit shape --driver` takes it; module:Class of a driver's settings, which are built
    with their defaults; or module:function, which is called as `build` of such settings, function(port, mount, pulse),
    and returns a driver that is not connected yet: `port` has a clock, `mount` the arm's model and base, and `pulse`
    sends the heartbeats. dlokit.functional.robots.base describes them."""
    installation: Annotated[Path | None, flag("FILE")] = None
    """Installation file; its first arm is checked: model, home, base, workspace. Without it: at the world's origin."""
    arm: Annotated[str, tyro.conf.arg(help_behavior_hint="(default: panda, or as installed)")] = ""
    """panda, fr3, ur5e, or the .toml file of another arm."""
    operator_confirms: bool = False
    """An operator beside the arm has answered all questions with yes; for simulators and programs."""
    driver: AnyRobotDriver = field(default_factory=KinematicRobotConfig)
    """Settings of the installed driver."""


CheckArgs = (
    RobotCheckArgs | ArmCheckArgs | ObserverCheckArgs | PlannerCheckArgs | SegmentationCheckArgs | CameraCheckArgs
)


Runner = Callable[[Coroutine[Any, Any, CheckedDevice]], CheckedDevice]


def run(args: CheckArgs, runner: Runner = asyncio.run) -> int:
    """Check, print the result, and return the exit code. `runner` runs coroutines."""
    console = Console()
    try:
        console.print(_report(args, console, runner), markup=False, highlight=False, soft_wrap=True)
    except CheckFailed as failed:
        console.print(str(failed), markup=False, highlight=False, soft_wrap=True)
        return EXIT_FAULT
    return 0


def _report(args: CheckArgs, console: Console, runner: Runner) -> str:
    match args:
        case ObserverCheckArgs(observer=name):
            return _checked(name, OBSERVERS, check_observer)
        case PlannerCheckArgs(planner=name):
            return _checked(name, PLANNERS, check_planner)
        case SegmentationCheckArgs(segmentation=name):
            return _checked(name, SEGMENTATIONS, check_segmentation)
        case CameraCheckArgs():
            return _with_report(_checked_camera(args, runner), "camera")
        case ArmCheckArgs(arm=name):
            return _with_report(examined_arm(arm_model(name)), "arm")
        case RobotCheckArgs():
            return _with_report(_checked_robot(args, console, runner), "robot")


def _with_report(checked: CheckedDevice, kind: str) -> str:
    """The result and the path of the report. Raises `CheckFailed` when the device did not pass."""
    path = write_report(checked, kind)
    where = f"report, to attach to a bug report: {path}"
    try:
        require_none(checked.what, checked.found)
    except CheckFailed as failed:
        raise CheckFailed(f"{failed}\n{where}") from None
    tried = len(checked.wanted) - len(checked.untried)
    facts = [f"  {name}: {value}" for name, value in {**checked.facts, **checked.timing}.items()]
    not_tried = f"; not tried: {', '.join(checked.untried)}" if checked.untried else ""
    return "\n".join([f"{checked.what}: {tried} checks passed{not_tried}", *facts, where])


def _checked_camera(args: CameraCheckArgs, runner: Runner) -> CheckedDevice:
    if args.captures < 2 or not 0.0 < args.timeout_s < math.inf:
        raise ConfigError(f"--captures {args.captures} must be at least 2, and --timeout-s {args.timeout_s} above 0.")

    async def examined() -> CheckedDevice:
        camera, clock_ns = _camera(args)  # here: some drivers are bound to the running loop
        return await examined_camera(camera, captures=args.captures, timeout_s=args.timeout_s, clock_ns=clock_ns)

    return runner(examined())


def _camera(args: CameraCheckArgs) -> tuple[Camera, Callable[[], int] | None]:
    """The camera, and the clock of its stamps, if they are to be compared with one."""
    host_clock = time.monotonic_ns if args.host_clock else None
    installed = CAMERAS.installed().get(args.name)
    if installed is not None and installed.sees_cell:
        raise ConfigError(f"{args.name} is no device: it sees the simulated cell, whose tests check it.")
    if installed is not None:
        # A device whose settings name a file replays it.
        recorded = isinstance(args.camera, RecordedCameraConfig) or getattr(args.camera, "file", "") != ""
        return args.camera.build(MemoryTransport()), None if recorded else host_clock
    if Path(args.name).is_dir():
        return RecordedCamera(Path(args.name), repeat=True), None
    if ":" in args.name:
        return _named(args.name)(), host_clock
    raise ConfigError(
        f"{args.name} is neither an installed camera ({', '.join(CAMERAS.installed())}), nor a folder, nor "
        "module:function, which makes a camera."
    )


def _checked_robot(args: RobotCheckArgs, console: Console, runner: Runner) -> CheckedDevice:
    if not args.operator_confirms and not has_terminal():
        raise ConfigError(
            f"the check moves the arm and first asks an operator in a terminal. {FLAG} states instead that an operator "
            "beside the arm has answered all questions with yes."
        )
    for line in PLAN:
        console.print(line, markup=False, highlight=False, soft_wrap=True)

    async def confirm(question: str) -> bool:
        return args.operator_confirms or await ask_in_terminal(question, console)

    async def examined() -> CheckedDevice:
        build, mount = _robot(args)
        return await examined_driver(build, mount, confirm=confirm)

    return runner(examined())


def _robot(args: RobotCheckArgs) -> tuple[BuildRobot, ArmMount]:
    """What makes the driver, and where its arm is mounted."""
    if args.installation is None:
        mount = ArmMount(model=arm_model(args.arm or PANDA.name))
    else:
        (mount,) = with_installation(RunConfig(), args.installation).installation.mounts(1, args.arm)
    installed = DRIVERS.installed().get(args.name)
    if installed in OURS:
        raise ConfigError(
            f"{args.name} is no device: it moves an arm in software, whose tests check it. To try the check without an "
            "arm, see examples/robot_package, which has a simulated controller."
        )
    if installed is not None:
        return args.driver.build, mount
    if ":" in args.name:
        return _builder(args.name), mount
    raise ConfigError(
        f"{args.name} is neither an installed driver ({', '.join(DRIVERS.installed())}), nor module:Class of the "
        "settings of a driver, nor module:function, which makes one."
    )


def _builder(name: str) -> BuildRobot:
    """What a class of settings or a function of this name makes a driver with. Raises `ConfigError`."""
    named = _named(name)
    build = named().build if isinstance(named, type) and hasattr(named, "build") else named
    try:
        inspect.signature(build).bind("port", "mount", "pulse")
    except (TypeError, ValueError) as error:
        raise ConfigError(
            f"{name} cannot be called as {name.partition(':')[2]}(port, mount, pulse), as `build` of a driver's "
            f"settings is ({error}); dlokit.functional.robots.base describes the three."
        ) from error
    return build


def _checked(name: str, kind: StrategyKind[Any], check: Callable[[Any], object]) -> str:
    if ":" not in name:
        return str(check(kind.named(name, kind.purpose)))
    return str(check(_named(name)))


def _named(name: str) -> Any:
    module, _, path = name.partition(":")
    try:
        return getattr(importlib.import_module(module), path)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"{name} cannot be imported: {error}; give module:Class, as in the entry point.") from error


def camera_args(arguments: Sequence[str]) -> CameraCheckArgs:
    """The arguments of a check of a camera, whose settings are those of the camera that they name."""
    default = CameraCheckArgs(name=tyro.MISSING, camera=_named_in(arguments, CAMERAS) or RecordedCameraConfig())
    return tyro.cli(
        CameraCheckArgs, prog="python -m dlokit.testing camera", args=arguments, default=default, config=OPTIONS
    )


def robot_args(arguments: Sequence[str]) -> RobotCheckArgs:
    """The arguments of a check of a robot, whose settings are those of the driver that they name."""
    default = RobotCheckArgs(name=tyro.MISSING, driver=_named_in(arguments, DRIVERS) or KinematicRobotConfig())
    return tyro.cli(
        RobotCheckArgs, prog="python -m dlokit.testing robot", args=arguments, default=default, config=OPTIONS
    )


def _named_in(arguments: Sequence[str], kind: StrategyKind[C]) -> C | None:
    """The usual settings of the first installed camera or driver that the arguments name."""
    installed = kind.installed()
    return next((installed[name]() for name in arguments if name in installed), None)


def main() -> None:
    """The command line."""
    arguments = sys.argv[1:]
    checks: dict[str, Any] = {
        "observer": ObserverCheckArgs,
        "planner": PlannerCheckArgs,
        "segmentation": SegmentationCheckArgs,
        "camera": CameraCheckArgs,
        "arm": ArmCheckArgs,
        "robot": RobotCheckArgs,
    }
    try:
        if arguments[:1] == ["camera"]:
            args: CheckArgs = camera_args(arguments[1:])
        elif arguments[:1] == ["robot"]:
            args = robot_args(arguments[1:])
        else:
            args = tyro.extras.subcommand_cli_from_dict(checks, prog="python -m dlokit.testing", args=arguments)
        sys.exit(run(args))
    except InputError as error:
        sys.stderr.write(f"dlokit.testing: {error}\n")
        sys.exit(EXIT_BAD_INPUT)
    except KeyboardInterrupt:
        sys.stderr.write("dlokit.testing: interrupted; an arm that moved has braked\n")
        sys.exit(EXIT_INTERRUPTED)
    except StartNotConfirmed as error:
        sys.stderr.write(f"dlokit.testing: {error}; nothing has moved\n")
        sys.exit(EXIT_FAULT)
