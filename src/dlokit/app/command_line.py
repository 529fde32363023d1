"""Runs one command of `dlokit` and ends the process with its exit code."""

import io
import logging
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from rich.console import Console
from rich.logging import RichHandler
from rich.text import Text

import dlokit
from dlokit.app.commands import execute, name_of, parse
from dlokit.app.environment import handle_signals
from dlokit.errors import (
    EXIT_BAD_INPUT,
    EXIT_FAULT,
    EXIT_INTERRUPTED,
    DlokitError,
    InputError,
    missing_extra,
)
from dlokit.system.processes.first_press import FirstPress

EXIT_UNREAD = 141  # as a shell reports SIGPIPE


def run_command_line(arguments: Sequence[str], pressed: FirstPress | None) -> NoReturn:
    """Print one line for bad input, and a traceback only for errors in dlokit; SIGTERM and SIGHUP act like Ctrl-C.

    `pressed` is what `dlokit stop` has done already; None for every other command line.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without box characters or µ shows a question mark
    if list(arguments) == ["--version"]:
        print(f"dlokit {dlokit.__version__}")
        sys.exit(0)
    errors = Console(stderr=True)
    logging.basicConfig(
        level=logging.WARNING, format="%(message)s", handlers=[RichHandler(console=errors, show_path=False)]
    )
    handle_signals()
    try:
        code = execute(arguments) if pressed is None else _stop(arguments, pressed)
    except InputError as error:
        _say(errors, str(error))
        code = EXIT_BAD_INPUT
    except ModuleNotFoundError as error:
        lacking = missing_extra(error, f"dlokit {name_of(arguments)}".rstrip())
        if lacking is None:
            raise
        _say(errors, str(lacking))
        code = EXIT_BAD_INPUT
    except DlokitError as error:
        _say(errors, f"{type(error).__name__}: {error}")
        code = EXIT_FAULT
    except KeyboardInterrupt:
        _say(errors, "stopped")
        code = EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader has closed the pipe (`dlokit graph | head`); the interpreter must not flush into it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_UNREAD
    sys.exit(code)


def _stop(arguments: Sequence[str], pressed: FirstPress) -> int:
    from dlokit.app.operate.stop import run_stop

    return run_stop(parse(arguments), pressed)


def _say(console: Console, message: str) -> None:
    # As text, not as markup: messages quote user input, including brackets.
    console.print(Text.assemble(("dlokit: ", "bold red"), message), highlight=False, soft_wrap=True)
