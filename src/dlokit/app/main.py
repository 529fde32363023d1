"""The command `dlokit`. Its first step is a stop: `dlokit stop` brakes before this process imports anything large."""

import sys
from collections.abc import Sequence

from dlokit.system.processes.first_press import press_first
from dlokit.system.processes.process_end import without_teardown


def main() -> None:
    """The program: run its command line, and end the process."""
    with without_teardown():
        run(sys.argv[1:])


def run(arguments: Sequence[str]) -> None:
    """Press the stop sockets where the command line asks for it, then import and run the command."""
    pressed = press_first(arguments)  # an arm does not wait for the imports below
    from dlokit.app.environment import prepare_environment

    prepare_environment()  # before anything imports MuJoCo or NumPy's linear algebra
    from dlokit.app.command_line import run_command_line

    run_command_line(arguments, pressed)


if __name__ == "__main__":
    main()
