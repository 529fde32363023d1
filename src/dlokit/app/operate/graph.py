"""`dlokit graph`: the system drawn from its own tables."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro

from dlokit.app.commands import CliCommand, flag
from dlokit.communication.topic import Topic
from dlokit.communication.topics import TOPICS
from dlokit.decision.flow import mermaid
from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.errors import InputError
from dlokit.system.table import COMPONENTS, PROCESSES

Drawing = Literal["flow", "topics", "processes", "all"]


@dataclass(frozen=True, kw_only=True)
class GraphArgs:
    """Print the system as Mermaid charts, drawn from the tables that run it.

    Paste the output into any Mermaid viewer, or into Markdown between ```mermaid fences.
    """

    what: Annotated[Drawing, tyro.conf.Positional] = "all"
    """flow: the chart of the shape task (the paper's Fig. 6). topics: who publishes and who reads (Fig. 3).
    processes: what runs where when live."""
    write: Annotated[Path | None, flag("FILE")] = None
    """Instead of printing, renew the charts in this Markdown file: what stands between
    `<!-- dlokit graph flow -->` and `<!-- end -->`, for each chart that the file has a place for."""


def topics_mermaid() -> str:
    """Components as boxes, topics as arrows from their publisher to each reader."""
    lines = ["flowchart LR"]
    # Those that there is more than one of are drawn once: each has the same topics.
    kinds = {component.name: component for component in (row.load() for row in COMPONENTS.values())}
    lines += [f"    {name}[{name}]" for name in sorted(kinds)]
    for topic in TOPICS:
        readers = [name for name, component in kinds.items() if topic in component.subscribes()]
        label = f"{topic.name}<br/>{_type_name(topic)}"
        lines += [f'    {topic.publisher} -->|"{label}"| {reader}' for reader in sorted(readers)]
    return "\n".join(lines) + "\n"


def _type_name(topic: Topic[Any]) -> str:
    members = get_args(topic.type) or (topic.type,)
    return " or ".join(member.__name__ for member in members)


def processes_mermaid() -> str:
    """Processes as boxes around the components that they host, in start order."""
    lines = ["flowchart TB"]
    for row in PROCESSES:
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
    """A Markdown page with every chart that it has a place for as the tables are now.

    Raises `InputError` when it has no place, or one for a chart that there is not.
    """
    names = [place.group(2) for place in _PLACE.finditer(page)]
    if not names or not set(names) <= set(DRAWINGS):
        raise InputError(
            f"the page has places for the charts {names}; write at least one of "
            + ", ".join(f"`<!-- dlokit graph {name} -->`" for name in DRAWINGS)
            + ", each with `<!-- end -->` on a later line."
        )
    return _PLACE.sub(
        lambda place: f"{place.group(1)}```mermaid\n{DRAWINGS[place.group(2)]()}```\n{place.group(3)}", page
    )


def run(args: GraphArgs) -> int:
    """Print the charts, or write them into a page."""
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
        raise InputError(f"--write {path}: {error}; name a Markdown file that may be changed.") from error


COMMAND = CliCommand(GraphArgs, run)
