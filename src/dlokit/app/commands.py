"""The commands of `dlokit`: each is a module with a COMMAND, which is imported when it is asked for.

A command must not wait for the libraries of another, `dlokit stop` least of all.
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

from dlokit.app.help_pages import HELP, asked_page, printed
from dlokit.errors import InputError

A = TypeVar("A")


@dataclass(frozen=True)
class CliCommand(Generic[A]):
    """One command; each has a module of its own, where it is called COMMAND."""

    arguments: type[A]
    """A dataclass: its fields are the flags, its docstring is the help."""
    run: Callable[[A], int]
    """Does it, and gives the exit code."""
    defaults: Callable[[Sequence[str]], A] | None = None
    """What holds where the command line says nothing, where that depends on the command line (`--config FILE`)."""


def flag(metavar: str, default: str = "") -> Any:
    """A flag that is not set unless it is given; `default` says in words what holds then."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=f"(default: {default})" if default else "")


DESCRIPTION = """Bring cables, ropes and wires into the shape you want with a robot and a camera.

`dlokit COMMAND --help` explains a command, `dlokit --version` prints the version."""

OPTIONS = (tyro.conf.AvoidSubcommands,)
"""A strategy is chosen by its flag (`--observer cpd`); its settings are flags like all others."""


@dataclass(frozen=True)
class CommandRow:
    """A row of the table of commands."""

    module: str
    """Below `dlokit.app`; it has the command as COMMAND."""
    summary: str
    """The first sentence of the command's own help: here, so that the list of all needs none of the modules."""


COMMANDS: Mapping[str, CommandRow] = {
    "shape": CommandRow(
        "shape.shape", "Bring the DLO from a start to a goal shape by looking at it with the stereo camera."
    ),
    "demo": CommandRow(
        "shape.demo", "Watch a simulated arm bring a rope from I to S by looking at it with a stereo camera."
    ),
    "track": CommandRow(
        "data.track", "Find the nodes of a DLO in recorded clouds, one after the other, and write them with a picture."
    ),
    "bench shaping": CommandRow(
        "bench.shaping",
        "Compare planners and observers on the same starts, goals and cells, in lockstep, judged by the hidden truth.",
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
        "Let something go wrong in live runs, at random times: do they still end as they should, with the arm stopped?",
    ),
    "info": CommandRow(
        "data.info",
        "Say what is in a recording: its run, versions, settings, topics with counts and rates, calls with outcomes.",
    ),
    "export": CommandRow(
        "data.export",
        "Hand recorded runs to people who learn from them: states, targets, goals, robot, actions, calls, pictures.",
    ),
    "record": CommandRow(
        "data.record", "Record a live system that runs, until Ctrl-C or until it ends: all topics, and all skill calls."
    ),
    "replay": CommandRow(
        "data.replay",
        "Feed one component what it received in a recorded run, and compare what it says now with what it said then.",
    ),
    "identify": CommandRow(
        "data.identify",
        "Say what the runs of one DLO tell of it: length, radius, stiffness, friction, and whether it takes a set.",
    ),
    "call": CommandRow("operate.call", "Call one skill on a running system, and print what became of it."),
    "stop": CommandRow(
        "operate.stop", "Brake the arms of every running system of yours, now, keep them stopped, and end their tasks."
    ),
    "enable": CommandRow("operate.enable", "Let the arms of a running system move again that a person has stopped."),
    "resume": CommandRow(
        "shape.resume",
        "Go on with a live run that was killed, failed or was cancelled: same goal, what is left of the budget.",
    ),
    "ps": CommandRow(
        "operate.ps", "List the processes of your running systems: state, restarts, heartbeat, processor and memory."
    ),
    "certs": CommandRow(
        "operate.certs", "Make the certificates with which the hosts of a run on several machines know one another."
    ),
    "host": CommandRow(
        "operate.host", "Run this machine's share of runs on several machines, one run after the other, until Ctrl-C."
    ),
    "skills": CommandRow(
        "operate.skills", "List the skills of all components: arguments with types and units, time limit, and contract."
    ),
    "graph": CommandRow("operate.graph", "Print the system as Mermaid charts, drawn from the tables that run it."),
    "doctor": CommandRow("doctor.doctor", "Tell what this machine has, what it lacks, and the command that mends it."),
    "completion": CommandRow(
        "completion", "Print a script with which TAB completes commands, options and choices in your shell."
    ),
}
"""The commands, by the words that call them."""

GROUPS: Mapping[str, str] = {"bench": "Compare and measure; every bench prints a table and writes JSON with --json."}
"""The first words that need a second one."""


def execute(arguments: Sequence[str]) -> int:
    """Run one command and give its exit code."""
    command, rest = _command(arguments)
    return command.run(_parsed(command, arguments, rest))


def parse(arguments: Sequence[str]) -> Any:
    """Arguments to the argument class of the command that they call; exits with 2 and a hint on a mistake."""
    command, rest = _command(arguments)
    return _parsed(command, arguments, rest)


def _command(arguments: Sequence[str]) -> tuple[CliCommand[Any], Sequence[str]]:
    """The command that the first words call, and the other words."""
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
    """List the commands, or those of a group; ends the process.

    Raises `InputError` for a word that is no command.
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
    nothings = (_does_nothing(name, summary) for name, summary in offered.items())
    tyro.cli(reduce(or_, nothings), args=list(arguments), prog=words, description=description)
    raise AssertionError("a list of commands runs none")


def _no_such_command(words: str, typed: str, offered: Iterable[str]) -> str:
    similar = get_close_matches(typed, offered, n=1)
    hint = f" Did you mean {similar[0]!r}?" if similar else ""
    return f"There is no command {typed!r} of {words}.{hint} {words} --help lists those that there are."


def _does_nothing(name: str, summary: str) -> Any:
    return Annotated[make_dataclass(name, ()), tyro.conf.subcommand(name, description=summary)]
