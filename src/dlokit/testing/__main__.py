"""`python -m dlokit.testing observer NAME`: the checks of `dlokit.testing` on a strategy by its name."""

import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import tyro
from rich.console import Console

from dlokit.communication.strategies import StrategyKind
from dlokit.errors import EXIT_BAD_INPUT, EXIT_FAULT, CheckFailed, ConfigError, InputError
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.skills.perception.segmentations import SEGMENTATIONS
from dlokit.skills.planning.strategies import PLANNERS
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


CheckArgs = ObserverCheckArgs | PlannerCheckArgs | SegmentationCheckArgs


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


def _checked(name: str, kind: StrategyKind[Any], check: Callable[[Any], object]) -> str:
    if ":" not in name:
        return str(check(kind.named(name, kind.purpose)))
    module, _, path = name.partition(":")
    try:
        config = getattr(importlib.import_module(module), path)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"{name} cannot be imported: {error}; give module:Class, as in the entry point.") from error
    return str(check(config))


def main() -> None:
    """The command line."""
    checks = {"observer": ObserverCheckArgs, "planner": PlannerCheckArgs, "segmentation": SegmentationCheckArgs}
    args: CheckArgs = tyro.extras.subcommand_cli_from_dict(checks, prog="python -m dlokit.testing")
    try:
        sys.exit(run(args))
    except InputError as error:
        sys.stderr.write(f"dlokit.testing: {error}\n")
        sys.exit(EXIT_BAD_INPUT)


if __name__ == "__main__":
    main()
