"""`dlokit skills`: what every component can be asked to do."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.markdown import Markdown
from rich.table import Table
from rich.text import Text

from dlokit.app.command import Command
from dlokit.app.skill_table import all_skills, arguments_of, entry, markdown, skill_named
from dlokit.errors import InputError

BEGIN, END = "<!-- dlokit skills -->", "<!-- end -->"


@dataclass(frozen=True, kw_only=True)
class SkillsArgs:
    """List the skills of all components: arguments with types and units, time limit, and contract.

    Try
      dlokit skills                      one line a skill
      dlokit skills robot.move_linear    all of one
    """

    skill: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="COMPONENT.SKILL")] = None
    """One of them."""
    write: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Renew the list in a Markdown file, between its two marks."""


def run(args: SkillsArgs) -> int:
    """Print, or renew a page."""
    console = Console()
    if args.write is not None:
        args.write.write_text(renewed(args.write.read_text(encoding="utf-8"), str(args.write)), encoding="utf-8")
    elif args.skill is not None:
        console.print(Markdown(entry(skill_named(args.skill))))
    else:
        console.print(_table())
    return 0


def renewed(page: str, name: str) -> str:
    """The page with the list as it is now. Raises `InputError` when it lacks the marks."""
    head, begin, rest = page.partition(BEGIN)
    _, end, tail = rest.partition(END)
    if not (begin and end):
        raise InputError(f"{name} has no lines {BEGIN} and {END}: write them where the list shall stand.")
    return f"{head}{BEGIN}\n{markdown()}{END}{tail}"


def _table() -> Table:
    table = Table()
    for heading in ("skill", "arguments", "within", "does"):
        table.add_column(heading, no_wrap=heading == "skill")
    for key, skill in all_skills().items():
        arguments = [f"{row.name}={row.default}" if row.default else row.name for row in arguments_of(skill)]
        table.add_row(key, Text(", ".join(arguments)), f"{skill.timeout_s:g} s", Text(skill.doc.split("\n")[0]))
    return table


COMMAND = Command(SkillsArgs, run)
