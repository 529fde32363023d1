"""`python -m dlokit.testing observer NAME`: the checks of `dlokit.testing` on a strategy, a camera or an arm."""

import importlib
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from dlokit.communication.strategies import StrategyKind
from dlokit.description.arm.choice import arm_model
from dlokit.errors import EXIT_BAD_INPUT, EXIT_FAULT, CheckFailed, ConfigError, InputError
from dlokit.functional.cameras.recorded import RecordedCamera
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.skills.perception.segmentations import SEGMENTATIONS
from dlokit.skills.planning.strategies import PLANNERS
from dlokit.testing.arms import check_arm
from dlokit.testing.cameras import check_camera
from dlokit.testing.observers import check_observer
from dlokit.testing.planners import check_planner
from dlokit.testing.segmentations import check_segmentation


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
    """Check that a camera keeps to its protocol, and print a report. Exit code: 0 it does, 1 it does not, 2 bad input.

    Point it at something with contrast.
    """

    camera: Annotated[str, tyro.conf.Positional]
    """module:function that makes the camera, or a folder of recorded pairs."""
    captures: int = 10
    """Number of captures."""
    timeout_s: float = 2.0
    """Time limit of a capture [s]."""
    host_clock: bool = True
    """Check that stamps are on the host's monotonic clock, after the call; not for recorded pairs."""


@dataclass(frozen=True, kw_only=True)
class ArmCheckArgs:
    """Check that an arm can be planned with, and print a report. Exit code: 0 it can, 1 it cannot, 2 bad input."""

    arm: Annotated[str, tyro.conf.Positional]
    """panda, fr3, ur5e, or the .toml file of another arm."""


CheckArgs = ArmCheckArgs | ObserverCheckArgs | PlannerCheckArgs | SegmentationCheckArgs | CameraCheckArgs


def run(args: CheckArgs) -> int:
    """Check, print what was found, and give the exit code."""
    console = Console()
    try:
        console.print(_report(args), markup=False, highlight=False, soft_wrap=True)
    except CheckFailed as failed:
        console.print(str(failed), markup=False, highlight=False, soft_wrap=True)
        return EXIT_FAULT
    return 0


def _report(args: CheckArgs) -> str:
    match args:
        case ObserverCheckArgs(observer=name):
            return _checked(name, OBSERVERS, check_observer)
        case PlannerCheckArgs(planner=name):
            return _checked(name, PLANNERS, check_planner)
        case SegmentationCheckArgs(segmentation=name):
            return _checked(name, SEGMENTATIONS, check_segmentation)
        case CameraCheckArgs():
            return _checked_camera(args)
        case ArmCheckArgs(arm=name):
            return str(check_arm(arm_model(name)))


def _checked_camera(args: CameraCheckArgs) -> str:
    if args.captures < 2 or not 0.0 < args.timeout_s < math.inf:
        raise ConfigError(f"--captures {args.captures} must be at least 2, and --timeout-s {args.timeout_s} above 0.")
    if Path(args.camera).is_dir():
        camera, clock_ns = RecordedCamera(Path(args.camera), repeat=True), None
    elif ":" in args.camera:
        camera, clock_ns = _named(args.camera)(), time.monotonic_ns if args.host_clock else None
    else:
        raise ConfigError(f"{args.camera} is neither a folder nor module:function, which makes a camera.")
    return str(check_camera(camera, captures=args.captures, timeout_s=args.timeout_s, clock_ns=clock_ns))


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


def main() -> None:
    """The command line."""
    checks = {
        "observer": ObserverCheckArgs,
        "planner": PlannerCheckArgs,
        "segmentation": SegmentationCheckArgs,
        "camera": CameraCheckArgs,
        "arm": ArmCheckArgs,
    }
    args: CheckArgs = tyro.extras.subcommand_cli_from_dict(checks, prog="python -m dlokit.testing")
    try:
        sys.exit(run(args))
    except InputError as error:
        sys.stderr.write(f"dlokit.testing: {error}\n")
        sys.exit(EXIT_BAD_INPUT)


if __name__ == "__main__":
    main()
