"""The commands of `dlokit`. Each is a module with a COMMAND; it is imported when the command is called.

No command waits for the libraries of another; `dlokit stop` in particular must start fast.
"""

import ast
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, make_dataclass
from difflib import get_close_matches
from functools import reduce
from importlib import import_module
from operator import or_
from pathlib import Path
from typing import Annotated, Any, Generic, NoReturn, TypeVar

import tyro

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


DESCRIPTION = """Bring cables, ropes and wires into the shape you want with a robot and a camera.

`dlokit COMMAND --help` explains a command, `dlokit --version` prints the version."""

OPTIONS = (tyro.conf.AvoidSubcommands,)
"""A flag chooses a strategy (`--observer cpd`); the strategy's settings are flags like all others."""


COMMANDS: Mapping[str, str] = {
    "shape": "shape.shape",
    "demo": "shape.demo",
    "track": "data.track",
    "bench shaping": "bench.shaping",
    "bench observers": "bench.observers",
    "info": "data.info",
    "export": "data.export",
    "record": "data.record",
    "replay": "data.replay",
    "view": "data.view",
    "identify": "data.identify",
    "calibrate handeye": "calibrate.handeye",
    "calibrate stereo": "calibrate.stereo",
    "calibrate table": "calibrate.table",
    "calibrate box": "calibrate.box",
    "calibrate latency": "calibrate.latency",
    "calibrate pictures": "calibrate.pictures",
    "calibrate board": "calibrate.board",
    "call": "operate.call",
    "stop": "operate.stop",
    "enable": "operate.enable",
    "resume": "shape.resume",
    "ps": "operate.ps",
    "certs": "operate.certs",
    "host": "operate.host",
    "skills": "operate.skills",
    "graph": "operate.graph",
    "doctor": "doctor.doctor",
    "doctor franka": "doctor.franka",
    "completion": "completion",
}
"""The commands by name, each with the module below `dlokit.app` that defines it."""

GONE: Mapping[str, str] = {"bench faults": "benchmarks/faults.py", "bench stop": "benchmarks/stops.py"}
"""Commands of earlier versions, each with the study that it has become."""

GROUPS: Mapping[str, str] = {
    "bench": "Compare and measure; every bench prints a table and writes JSON with --json.",
    "calibrate": "Calibrate the camera with a ChArUco board: its optics, where it stands, and the table before it.",
}
"""The command groups; their names are followed by a second word."""


def summary_of(name: str) -> str:
    """The first paragraph of a command's help text, read from its source: listing the commands imports none of them."""
    file = Path(__file__).parent / f"{COMMANDS[name].replace('.', '/')}.py"
    tree = ast.parse(file.read_text(encoding="utf-8"))
    assigned = {ast.unparse(node.targets[0]): node.value for node in tree.body if isinstance(node, ast.Assign)}
    command = assigned["COMMAND"]
    assert isinstance(command, ast.Call), "each module ends with COMMAND = CliCommand(Args, run)"
    arguments = ast.unparse(command.args[0])
    (about,) = (
        ast.get_docstring(node) for node in tree.body if isinstance(node, ast.ClassDef) and node.name == arguments
    )
    return " ".join((about or "").partition("\n\n")[0].split())


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
            command: CliCommand[Any] = import_module(f"{__package__}.{COMMANDS[name]}").COMMAND
            return command, arguments[words:]
        if name in GONE:
            raise InputError(f"`dlokit {name}` is a study now: python {GONE[name]}, in a clone of the sources.")
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
        offered = {name.split()[1]: summary_of(name) for name in COMMANDS if name.startswith(f"{group} ")}
        words, description, arguments = f"dlokit {group}", GROUPS[group], arguments[1:]
    else:
        offered = {name: summary_of(name) for name in COMMANDS if " " not in name} | dict(GROUPS)
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
