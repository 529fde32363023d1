"""`python -m dlokit.testing observer NAME`: the checks of `dlokit.testing` on an observer by its name."""

import importlib
import sys
from dataclasses import dataclass
from typing import Annotated, Any

import tyro
from rich.console import Console

from dlokit.errors import EXIT_BAD_INPUT, EXIT_FAULT, CheckFailed, ConfigError, InputError
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.testing.observers import check_observer


@dataclass(frozen=True, kw_only=True)
class ObserverCheckArgs:
    """Check that an observer keeps to its protocol. Exit code: 0 it does, 1 it does not, 2 bad input."""

    observer: Annotated[str, tyro.conf.Positional]
    """Name of an installed observer, or module:Class of its settings."""


def run(args: ObserverCheckArgs) -> int:
    """Check, print what was found, and give the exit code."""
    console = Console()
    try:
        console.print(str(check_observer(_class(args.observer))), markup=False, highlight=False, soft_wrap=True)
    except CheckFailed as failed:
        console.print(str(failed), markup=False, highlight=False, soft_wrap=True)
        return EXIT_FAULT
    return 0


def _class(name: str) -> Any:
    if ":" not in name:
        return OBSERVERS.named(name, "observer")
    module, _, path = name.partition(":")
    try:
        return getattr(importlib.import_module(module), path)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"{name} cannot be imported: {error}; give module:Class, as in the entry point.") from error


def main() -> None:
    """The command line."""
    args = tyro.extras.subcommand_cli_from_dict({"observer": ObserverCheckArgs}, prog="python -m dlokit.testing")
    try:
        sys.exit(run(args))
    except InputError as error:
        sys.stderr.write(f"dlokit.testing: {error}\n")
        sys.exit(EXIT_BAD_INPUT)


if __name__ == "__main__":
    main()
