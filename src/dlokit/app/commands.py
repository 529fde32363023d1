"""The commands of `dlokit`: those below, and those that annexes and other packages add by entry points.

Each is a module with a COMMAND; it is imported when the command is called. No command waits for the libraries of
another; `dlokit stop` in particular must start fast.
"""

import ast
import logging
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, make_dataclass
from difflib import get_close_matches
from functools import cache, reduce
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from operator import or_
from pathlib import Path
from typing import Annotated, Any, Generic, NoReturn, TypeVar, cast

import tyro

from dlokit.app.help_pages import HELP, asked_page, printed
from dlokit.errors import EXIT_BAD_INPUT, ConfigError, InputError, MachineError
from dlokit.system.configuration.renamed import check_options

log = logging.getLogger(__name__)

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
    unused: frozenset[str] = frozenset()
    """Options, as `--start`, that the first page of the help omits: the command sets them, or has no use for them."""


def flag(metavar: str, default: str = "") -> Any:
    """A flag that is unset by default; `default` describes the value that is then used."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=f"(default: {default})" if default else "")


def file_after(flag: str, arguments: Sequence[str]) -> Path | None:
    """The file after `--config` or another flag."""
    name = value_of(arguments, flag)
    return None if name is None else Path(name)


def value_of(arguments: Sequence[str], flag: str) -> str | None:
    """The last value of a flag, as argument parsers interpret it. Raises `ConfigError` where it is missing."""
    value: str | None = None
    for index, argument in enumerate(arguments):
        if argument == flag:
            if index + 1 == len(arguments):
                raise ConfigError(f"{flag} has no value; --help lists the allowed values.")
            value = arguments[index + 1]
        elif argument.startswith(f"{flag}="):
            value = argument.removeprefix(f"{flag}=")
    return value


DESCRIPTION = """Bring cables, ropes and wires into the shape you want with a robot and a camera.

`dlokit COMMAND --help` explains a command, `dlokit --version` prints the version."""

OPTIONS = (tyro.conf.AvoidSubcommands,)
"""A flag chooses a strategy (`--observer cpd`); the strategy's settings are flags like all others."""

ADDED = "dlokit.commands"
"""Group of entry points through which others add commands: `calibrate.board = "module"`, a dot for the blank."""

COMMANDS: Mapping[str, str] = {
    "shape": "dlokit.app.shape.shape",
    "demo": "dlokit.app.shape.demo",
    "track": "dlokit.app.data.track",
    "info": "dlokit.app.data.info",
    "record": "dlokit.app.data.record",
    "replay": "dlokit.app.data.replay",
    "view": "dlokit.app.data.view",
    "call": "dlokit.app.operate.call",
    "stop": "dlokit.app.operate.stop",
    "enable": "dlokit.app.operate.enable",
    "resume": "dlokit.app.shape.resume",
    "ps": "dlokit.app.operate.ps",
    "skills": "dlokit.app.operate.skills",
    "graph": "dlokit.app.operate.graph",
    "doctor": "dlokit.app.doctor.doctor",
    "completion": "dlokit.app.completion",
}
"""Commands of the heart by name, each with the module that defines it."""

GONE: Mapping[str, str] = {"bench faults": "benchmarks/faults.py", "bench stop": "benchmarks/stops.py"}
"""Commands of earlier versions, each with the study that it has become."""

_WORD = re.compile("[a-z][a-z0-9-]*")


@cache
def all_commands() -> dict[str, str]:
    """All commands by name, each with its module: those of the heart, then those that are added, sorted by name.

    One that has the name of another is skipped, with a warning.
    """
    found = dict(COMMANDS)
    for entry in sorted(entry_points(group=ADDED)):
        name = entry.name.replace(".", " ")
        if found.setdefault(name, entry.value) != entry.value:
            log.warning("skipped: command %r of %s, which %s has already", name, entry.value, found[name])
    return found


def groups() -> dict[str, str]:
    """The command groups (`bench`, `calibrate`), each with the summary of the package of its first command."""
    found: dict[str, str] = {}
    for name, module in all_commands().items():
        group, blank, _ = name.partition(" ")
        if blank and group not in found and group not in all_commands():
            package = module.rpartition(".")[0]
            tree = _tree_of(package or module)
            found[group] = f"(missing: {module})" if tree is None else _first_paragraph(tree)
    return found


def load(name: str) -> CliCommand[Any]:
    """Import a command. Raises `MachineError` when its package is missing."""
    module = COMMANDS[name] if name in COMMANDS else all_commands()[name]
    try:
        loaded = import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise
        raise MachineError(f"`dlokit {name}` needs {module}, which is missing: install its package again.") from error
    if not isinstance(command := getattr(loaded, "COMMAND", None), CliCommand):
        raise MachineError(f"`dlokit {name}` needs {module}, which has no COMMAND = CliCommand(Args, run).")
    return cast(CliCommand[Any], command)


def summary_of(name: str) -> str:
    """The first paragraph of a command's help text, read from its source: listing the commands imports none of them."""
    module = all_commands()[name]
    tree = _tree_of(module)
    if tree is None:
        return f"(missing: {module})"
    assigned = {ast.unparse(node.targets[0]): node.value for node in tree.body if isinstance(node, ast.Assign)}
    match assigned.get("COMMAND"):
        case ast.Call(args=[arguments, *_]):
            for node in tree.body:
                if isinstance(node, ast.ClassDef) and node.name == ast.unparse(arguments):
                    return _first_paragraph(node)
        case _:
            pass
    return f"(in {module})"  # another package's, which has its arguments from elsewhere


def _first_paragraph(documented: ast.Module | ast.ClassDef) -> str:
    return " ".join((ast.get_docstring(documented) or "").partition("\n\n")[0].split())


def _tree_of(module: str) -> ast.Module | None:
    """The source of a module or package, which is not imported; None where it is missing."""
    top, *below = module.split(".")
    spec = find_spec(top)
    if spec is None or spec.origin is None:
        return None
    place = Path(spec.origin)
    if below:
        place = place.parent.joinpath(*below)
        place = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    return ast.parse(place.read_text(encoding="utf-8")) if place.is_file() else None


def execute(arguments: Sequence[str]) -> int:
    """Run one command and return its exit code."""
    command, rest = _command(arguments)
    return command.run(_parsed(command, arguments, rest))


def parse(arguments: Sequence[str]) -> Any:
    """Parse the command line into the argument class of its command; exits with 2 and a hint on a mistake."""
    command, rest = _command(arguments)
    return _parsed(command, arguments, rest)


def name_of(arguments: Sequence[str]) -> str:
    """The command that the first words name; empty where they name none."""
    names = (" ".join(arguments[:words]) for words in (2, 1))
    return next((name for name in names if name in all_commands()), "")


def _command(arguments: Sequence[str]) -> tuple[CliCommand[Any], Sequence[str]]:
    """The command that the first words name, and the remaining words; the heart's are found without a search."""
    if arguments and arguments[0] in COMMANDS and not _WORD.fullmatch("".join(arguments[1:2])):
        return load(arguments[0]), arguments[1:]
    for words in (2, 1):
        name = " ".join(arguments[:words])
        if name in all_commands():
            return load(name), arguments[words:]
        if name in GONE:
            raise InputError(f"`dlokit {name}` is a study now: python {GONE[name]}, in a clone of the sources.")
    return _list(arguments)


def _parsed(command: CliCommand[Any], arguments: Sequence[str], rest: Sequence[str]) -> Any:
    words = " ".join(("dlokit", *arguments[: len(arguments) - len(rest)]))
    given, page = asked_page(rest)
    check_options(given)
    default = _default(command, given)
    if page is not None and default is not None and printed(words, default, page, command.unused):
        sys.exit(0)
    # Its value may begin with a sign, which tyro would take for another flag.
    joined = "\0".join(given).replace("--beside\0", "--beside=").split("\0") if given else []
    return tyro.cli(
        command.arguments,
        args=joined,
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
    commands, grouped = all_commands(), groups()
    if arguments and arguments[0] in grouped:
        group = arguments[0]
        offered = {name.split()[1]: summary_of(name) for name in commands if name.startswith(f"{group} ")}
        words, description, arguments = f"dlokit {group}", grouped[group], arguments[1:]
    else:
        offered = {name: summary_of(name) for name in commands if " " not in name} | grouped
        words, description = "dlokit", DESCRIPTION
    if arguments and arguments[0] not in (*offered, *HELP):
        raise InputError(_no_such_command(words, arguments[0], offered))
    if len(offered) == 1:  # tyro would take the only one as chosen
        ((name, summary),) = offered.items()
        print(f"usage: {words} {name}\n\n{description}\n\n  {name}  {summary}")
        sys.exit(0 if arguments else EXIT_BAD_INPUT)
    nothings = (_list_entry(name, summary) for name, summary in offered.items())
    tyro.cli(reduce(or_, nothings), args=list(arguments), prog=words, description=description)
    raise AssertionError("the list of commands does not run a command")


def _no_such_command(words: str, typed: str, offered: Iterable[str]) -> str:
    similar = get_close_matches(typed, offered, n=1)
    hint = f" Did you mean {similar[0]!r}?" if similar else ""
    return f"There is no command {typed!r} of {words}.{hint} {words} --help lists the commands."


def _list_entry(name: str, summary: str) -> Any:
    return Annotated[make_dataclass(name, ()), tyro.conf.subcommand(name, description=summary)]
