"""The commands of `dlokit`. Each is a module with a COMMAND; it is imported when the command is called.

No command waits for the libraries of another; `dlokit stop` in particular must start fast.
"""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, make_dataclass
from difflib import get_close_matches
from functools import reduce
from importlib import import_module
from operator import or_
from typing import Annotated, Any, Generic, NoReturn, TypeVar

import tyro
from rich.console import Console

from dlokit.app.help_pages import HELP, asked_page, printed
from dlokit.errors import InputError

A = TypeVar("A")


@dataclass(frozen=True)
class CliCommand(Generic[A]):
    """One command; its module defines it as COMMAND."""

    arguments: type[A]
    """A dataclass: its fields are the flags, its docstring is the help text."""
    run: Callable[[A], int]
    """Executes the command and returns its exit code."""
    defaults: Callable[[Sequence[str]], A] | None = None
    """Computes the defaults of the arguments, if they depend on the command line (`--config FILE`)."""


def flag(metavar: str, default: str = "") -> Any:
    """A flag that is unset by default; `default` describes the value that is then used."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=f"(default: {default})" if default else "")


def say(console: Console, text: str) -> None:
    """Print text as it is: lines are not wrapped, so that paths can be copied, and brackets in them are no markup."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


DESCRIPTION = """Bring cables, ropes and wires into the shape you want with a robot and a camera.

`dlokit COMMAND --help` explains a command, `dlokit --version` prints the version."""

OPTIONS = (tyro.conf.AvoidSubcommands,)
"""A flag chooses a strategy (`--observer cpd`); the strategy's settings are flags like all others."""


@dataclass(frozen=True)
class CommandRow:
    """A row of the table of commands."""

    module: str
    """Module below `dlokit.app` that defines the command."""
    summary: str
    """First sentence of the command's help text, repeated here so that listing the commands imports none of them."""


COMMANDS: Mapping[str, CommandRow] = {
    "shape": CommandRow("shape.shape", "Move the DLO from a start shape to a goal shape, guided by a camera."),
    "demo": CommandRow(
        "shape.demo", "Watch a simulated arm move a rope from shape I to shape S, guided by a stereo camera."
    ),
    "track": CommandRow(
        "data.track",
        "Track the nodes of a DLO through recorded point clouds, or live in the pictures of a camera, without a robot.",
    ),
    "bench shaping": CommandRow(
        "bench.shaping",
        "Compare planners and observers on the same starts and goals; in the simulated cell the ground truth judges.",
    ),
    "bench observers": CommandRow(
        "bench.observers", "Compare observers on simulated and recorded sequences whose nodes are known."
    ),
    "bench stop": CommandRow(
        "bench.stop",
        "Kill and freeze the commander of a moving arm at random times on a busy machine, cut its feedback, "
        "press stop.",
    ),
    "bench faults": CommandRow(
        "bench.faults",
        "Inject faults into live runs at random times, and check that the runs end correctly with the arm stopped.",
    ),
    "info": CommandRow(
        "data.info",
        "Summarise a recording: its run, versions, settings, topics with counts and rates, calls with outcomes.",
    ),
    "export": CommandRow(
        "data.export",
        "Export recorded runs as data sets for learning, with all messages or a picture for each frame, or as videos.",
    ),
    "record": CommandRow(
        "data.record", "Record a running live system until Ctrl-C or until it ends: all topics and all skill calls."
    ),
    "replay": CommandRow(
        "data.replay",
        "Replay the recorded inputs of one component, and compare its outputs with the recorded ones.",
    ),
    "view": CommandRow(
        "data.view",
        "Watch a recorded run in the browser: play, pause and seek it on a timeline with its steps and actions.",
    ),
    "identify": CommandRow(
        "data.identify",
        "Estimate length, radius, stiffness, friction and plasticity of a DLO from its recorded runs.",
    ),
    "calibrate handeye": CommandRow(
        "calibrate.handeye",
        "Calibrate where the camera stands, from pictures of a ChArUco board in the hand of the arm.",
    ),
    "calibrate stereo": CommandRow(
        "calibrate.stereo",
        "Calibrate focal lengths, centre, lens distortion and baseline of the camera, from pictures of a ChArUco "
        "board.",
    ),
    "calibrate table": CommandRow(
        "calibrate.table",
        "Measure height and tilt of the table in the arm's world, from a ChArUco board that lies on it.",
    ),
    "calibrate box": CommandRow(
        "calibrate.box",
        "Choose the plane of the table and the workspace of the arm in the viewer, in the camera's live cloud.",
    ),
    "calibrate latency": CommandRow(
        "calibrate.latency",
        "Find by how much the stamps of a camera are late, by a ChArUco board in the hand of the arm that moves.",
    ),
    "calibrate pictures": CommandRow(
        "calibrate.pictures",
        "Take pictures of a ChArUco board with a camera that is not calibrated yet, for the other calibrations.",
    ),
    "calibrate board": CommandRow("calibrate.board", "Write the picture of a ChArUco board to print."),
    "call": CommandRow("operate.call", "Call one skill of a running system, and print its outcome."),
    "stop": CommandRow(
        "operate.stop", "Brake the arms of all your running systems now, keep them stopped, and end their tasks."
    ),
    "enable": CommandRow(
        "operate.enable", "Allow the arms of a running system to move again after an operator's stop."
    ),
    "resume": CommandRow(
        "shape.resume",
        "Resume a live run that was killed, failed or was cancelled, with the same goal and the remaining budget.",
    ),
    "ps": CommandRow(
        "operate.ps", "List the processes of your running systems: state, restarts, heartbeat, processor and memory."
    ),
    "certs": CommandRow(
        "operate.certs", "Create the certificates with which the hosts of a multi-machine run authenticate one another."
    ),
    "host": CommandRow(
        "operate.host", "Run the processes assigned to this machine in multi-machine runs, until Ctrl-C."
    ),
    "skills": CommandRow(
        "operate.skills", "List the skills of all components: arguments with types and units, time limit, and contract."
    ),
    "graph": CommandRow("operate.graph", "Print the system as Mermaid charts, generated from its tables."),
    "doctor": CommandRow(
        "doctor.doctor", "Check this machine for what dlokit needs, and print the commands that fix what is missing."
    ),
    "doctor franka": CommandRow(
        "doctor.franka",
        "Check a Franka step by step before its first run: network, kernel, thresholds, camera, stop, first grasp.",
    ),
    "completion": CommandRow(
        "completion", "Print a script with which TAB completes commands, options and choices in your shell."
    ),
}
"""The commands by name."""

GROUPS: Mapping[str, str] = {
    "bench": "Compare and measure; every bench prints a table and writes JSON with --json.",
    "calibrate": "Calibrate the camera with a ChArUco board: its optics, where it stands, and the table before it.",
}
"""The command groups; their names are followed by a second word."""


def execute(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    command, rest = _command(arguments)
    return command.run(_parsed(command, arguments, rest))


def parse(arguments: Sequence[str]) -> Any:
    """Parse the command line into the argument class of its command; exits with 2 and a hint on a mistake."""
    command, rest = _command(arguments)
    return _parsed(command, arguments, rest)


def _command(arguments: Sequence[str]) -> tuple[CliCommand[Any], Sequence[str]]:
    """The command that the first words name, and the remaining words."""
    for words in (2, 1):
        name = " ".join(arguments[:words])
        if name in COMMANDS:
            command: CliCommand[Any] = import_module(f"{__package__}.{COMMANDS[name].module}").COMMAND
            return command, arguments[words:]
    return _list(arguments)


def _parsed(command: CliCommand[Any], arguments: Sequence[str], rest: Sequence[str]) -> Any:
    words = " ".join(("dlokit", *arguments[: len(arguments) - len(rest)]))
    given, page = asked_page(rest)
    default = _default(command, given)
    if page is not None and default is not None and printed(words, default, page):
        sys.exit(0)
    return tyro.cli(
        command.arguments,
        args=given,
        prog=words,
        default=tyro.MISSING_NONPROP if default is None else default,
        config=OPTIONS,
    )


def _default(command: CliCommand[A], given: Sequence[str]) -> A | None:
    """The arguments that hold where the command line says nothing; None where some must be given."""
    if command.defaults is not None:
        return command.defaults(given)
    settings: Any = command.arguments
    required = any(field.default is MISSING and field.default_factory is MISSING for field in fields(settings))
    return None if required else command.arguments()


def _list(arguments: Sequence[str]) -> NoReturn:
    """List all commands or those of a group, and end the process.

    Raises `InputError` for an unknown command.
    """
    if arguments and arguments[0] in GROUPS:
        group = arguments[0]
        offered = {name.split()[1]: row.summary for name, row in COMMANDS.items() if name.startswith(f"{group} ")}
        words, description, arguments = f"dlokit {group}", GROUPS[group], arguments[1:]
    else:
        offered = {name: row.summary for name, row in COMMANDS.items() if " " not in name} | dict(GROUPS)
        words, description = "dlokit", DESCRIPTION
    if arguments and arguments[0] not in (*offered, *HELP):
        raise InputError(_no_such_command(words, arguments[0], offered))
    nothings = (_list_entry(name, summary) for name, summary in offered.items())
    tyro.cli(reduce(or_, nothings), args=list(arguments), prog=words, description=description)
    raise AssertionError("the list of commands does not run a command")


def _no_such_command(words: str, typed: str, offered: Iterable[str]) -> str:
    similar = get_close_matches(typed, offered, n=1)
    hint = f" Did you mean {similar[0]!r}?" if similar else ""
    return f"There is no command {typed!r} of {words}.{hint} {words} --help lists the commands."


def _list_entry(name: str, summary: str) -> Any:
    return Annotated[make_dataclass(name, ()), tyro.conf.subcommand(name, description=summary)]
