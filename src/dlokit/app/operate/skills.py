"""`dlokit skills`: list the skills of every component, with arguments, units, contract and reasons of failure."""

import inspect
import types
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Union, get_args, get_origin

import tyro
from rich.console import Console
from rich.markdown import Markdown
from rich.table import Table
from rich.text import Text

from dlokit.app.commands import CliCommand
from dlokit.communication.skill import Condition, ReportingSkill, Skill
from dlokit.errors import InputError
from dlokit.system.table import component_table

_UNITS = (
    ("_m_s2", "m/s²"),
    ("_m_s3", "m/s³"),
    ("_rad_s", "rad/s"),
    ("_m_s", "m/s"),
    ("_rad", "rad"),
    ("_hz", "Hz"),
    ("_ns", "ns"),
    ("_nm", "N·m"),
    ("_n", "N"),
    ("_s", "s"),
    ("_m", "m"),
    ("_world", "m, in the world"),
)
"""Unit by the suffix of an argument's name; longer suffixes first."""


@dataclass(frozen=True, kw_only=True)
class ArgumentRow:
    """One argument of a skill."""

    name: str
    kind: str
    """Short form of its type."""
    unit: str
    """Unit given by the suffix of its name; empty: it has none, or its type gives it."""
    default: str
    """Empty: the argument is required."""


def all_skills() -> dict[str, Skill[..., Any]]:
    """Every skill of every component, by ``component.skill``."""
    return {skill.key: skill for component in component_table().values() for skill in component.skills()}


def skill_named(key: str) -> Skill[..., Any]:
    """The skill ``component.skill`` or ``component.instance.skill``. Raises `InputError` that lists the known ones."""
    component, _, name = key.rpartition(".")
    kind, _, instance = component.partition(".")
    found = all_skills().get(f"{kind}.{name}")
    if found is not None:
        return found.at(instance)
    if kind in component_table():
        names = ", ".join(sorted(skill.key for skill in component_table()[kind].skills()))
        raise InputError(f"There is no skill {key!r}; {kind} has {names}.")
    raise InputError(f"There is no skill {key!r}: give COMPONENT.SKILL, with one of {', '.join(component_table())}.")


def arguments_of(skill: Skill[..., Any]) -> tuple[ArgumentRow, ...]:
    """The arguments of a skill, in order."""
    return tuple(
        ArgumentRow(
            name=name,
            kind=type_text(skill.types[name]),
            unit=next((unit for end, unit in _UNITS if name.endswith(end)), ""),
            default="" if parameter.default is inspect.Parameter.empty else repr(parameter.default),
        )
        for name, parameter in inspect.signature(skill.signature).parameters.items()
    )


def type_text(hint: Any) -> str:
    """A short description of a type."""
    if hint is type(None):
        return "None"
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return " or ".join(type_text(part) for part in parts)
    name = str(getattr(hint, "__name__", hint))
    if name == "ndarray":
        return f"array of {get_args(parts[1])[0].__name__}"
    if name == "Literal":
        return " or ".join(str(part) for part in parts)
    if origin is tuple:
        return f"several {type_text(parts[0])}"
    return name


def markdown() -> str:
    """The list of skills, one section per component."""
    sections = [
        "\n".join((f"## {name}", "", *(entry(skill) for skill in component.skills())))
        for name, component in component_table().items()
        if component.skills()
    ]
    return "\n".join(sections)


def entry(skill: Skill[..., Any]) -> str:
    """The description of one skill, as Markdown."""
    result = type_text(skill.types["return"])
    lines = [f"### {skill.key}", "", skill.doc, ""]
    lines += [f"- `{row.name}`: {_about(row)}" for row in arguments_of(skill)]
    lines.append(f"- returns: {result}; within {skill.timeout_s:g} s")
    if isinstance(skill, ReportingSkill):
        lines.append(f"- reports: {type_text(skill.reports)}")
    for what, conditions in (
        ("requires", skill.preconditions),
        ("keeps", skill.keeps),
        ("ensures", skill.postconditions),
    ):
        if conditions:
            lines.append(f"- {what}: {_all_of(conditions)}")
    if skill.exclusive:
        lines.append(f"- exclusive with all skills that use the {skill.exclusive}; otherwise rejected as `busy`")
    return "\n".join((*lines, ""))


def _about(row: ArgumentRow) -> str:
    kind = f"{row.kind} [{row.unit}]" if row.unit else row.kind
    return f"{kind}, default `{row.default}`" if row.default else kind


def _all_of(conditions: Iterable[Condition]) -> str:
    return "; ".join(
        f"{condition.text} (`{condition.reason}`)" if condition.reason else condition.text for condition in conditions
    )


BEGIN, END = "<!-- dlokit skills -->", "<!-- end -->"


@dataclass(frozen=True, kw_only=True)
class SkillsArgs:
    """List the skills of all components: arguments with types and units, time limit and contract.

    Try
      dlokit skills                      one line per skill
      dlokit skills robot.move_linear    the full description of one skill
    """

    skill: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="COMPONENT.SKILL")] = None
    """Describe only this skill."""
    write: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Update the list in a Markdown file, between its two marks."""


def run(args: SkillsArgs) -> int:
    """Print the list, or update a page."""
    console = Console()
    if args.write is not None:
        _write(args.write)
    elif args.skill is not None:
        console.print(Markdown(entry(skill_named(args.skill))))
    else:
        console.print(_table())
    return 0


def _write(path: Path) -> None:
    try:
        page = path.read_text(encoding="utf-8")
        path.write_text(renewed(page, str(path)), encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"--write {path}: {error}; name a Markdown file that you may write to.") from error


def renewed(page: str, name: str) -> str:
    """The page with the current list. Raises `InputError` when it lacks the marks."""
    head, begin, rest = page.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise InputError(f"{name} has no lines {BEGIN} and {END}: add them where the list belongs.")
    return f"{head}{BEGIN}\n{markdown()}{END}{tail}"


def _table() -> Table:
    table = Table()
    for heading in ("skill", "arguments", "within", "does"):
        table.add_column(heading, no_wrap=heading == "skill")
    for key, skill in all_skills().items():
        arguments = [f"{row.name}={row.default}" if row.default else row.name for row in arguments_of(skill)]
        table.add_row(key, Text(", ".join(arguments)), f"{skill.timeout_s:g} s", Text(skill.doc.split("\n")[0]))
    return table


COMMAND = CliCommand(SkillsArgs, run)
