"""`dlokit graph`: draw the system from its own tables."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro

from dlokit.app.commands import CliCommand, flag
from dlokit.communication.topic import Topic
from dlokit.communication.topics import all_topics
from dlokit.decision.flow import mermaid
from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.errors import InputError
from dlokit.system.table import component_table, process_table

Drawing = Literal["flow", "topics", "processes", "all"]


@dataclass(frozen=True, kw_only=True)
class GraphArgs:
    """Print the system as Mermaid charts, generated from its tables.

    Paste the output into any Mermaid viewer, or into Markdown between ```mermaid fences.
    """

    what: Annotated[Drawing, tyro.conf.Positional] = "all"
    """flow: the steps of the shape task (the paper's Fig. 6). topics: publishers and subscribers (Fig. 3).
    processes: which process runs which components in a live system."""
    write: Annotated[Path | None, flag("FILE")] = None
    """Instead of printing, update the charts in this Markdown file: the text between
    `<!-- dlokit graph flow -->` and `<!-- end -->`, for each chart that the file has marks for."""


def topics_mermaid() -> str:
    """Components as nodes, topics as arrows from their publisher to each subscriber."""
    lines = ["flowchart LR"]
    # Components with several instances are drawn once, because each instance has the same topics.
    kinds = {component.name: component for component in (row.load() for row in component_table().values())}
    lines += [f"    {name}[{name}]" for name in sorted(kinds)]
    for topic in all_topics():
        readers = [name for name, component in kinds.items() if topic in component.subscribes()]
        label = f"{topic.name}<br/>{_type_name(topic)}"
        lines += [f'    {topic.publisher} -->|"{label}"| {reader}' for reader in sorted(readers)]
    return "\n".join(lines) + "\n"


def _type_name(topic: Topic[Any]) -> str:
    members = get_args(topic.type) or (topic.type,)
    return " or ".join(member.__name__ for member in members)


def processes_mermaid() -> str:
    """Processes as frames around their components, in start order."""
    lines = ["flowchart TB"]
    for row in process_table():
        lines.append(f"    subgraph {row.name}")
        lines += [f"        {row.name}_{name.replace('.', '_')}[{name}]" for name in row.components]
        lines.append("    end")
    return "\n".join(lines) + "\n"


DRAWINGS = {
    "flow": lambda: mermaid(SHAPE_DLO),
    "topics": topics_mermaid,
    "processes": processes_mermaid,
}


_PLACE = re.compile(r"(<!-- dlokit graph (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def with_charts(page: str) -> str:
    """Return a Markdown page with all its charts updated from the tables.

    Raises `InputError` when the page has no marks, or marks for an unknown chart.
    """
    names = [place.group(2) for place in _PLACE.finditer(page)]
    if not names or not set(names) <= set(DRAWINGS):
        raise InputError(
            f"the page has marks for the charts {names}; it must have marks for at least one of "
            + ", ".join(f"`<!-- dlokit graph {name} -->`" for name in DRAWINGS)
            + ", each with `<!-- end -->` on a later line."
        )
    return _PLACE.sub(
        lambda place: f"{place.group(1)}```mermaid\n{DRAWINGS[place.group(2)]()}```\n{place.group(3)}", page
    )


def run(args: GraphArgs) -> int:
    """Print the charts, or update them in a page."""
    if args.write is not None:
        _write(args.write)
        return 0
    names = list(DRAWINGS) if args.what == "all" else [args.what]
    for name in names:
        if len(names) > 1:
            print(f"%% {name}")
        print(DRAWINGS[name]())
    return 0


def _write(path: Path) -> None:
    try:
        page = path.read_text(encoding="utf-8")
        path.write_text(with_charts(page), encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"--write {path}: {error}; name a Markdown file that you may write to.") from error


COMMAND = CliCommand(GraphArgs, run)
