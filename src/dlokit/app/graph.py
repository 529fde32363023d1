"""`dlokit graph`: the system drawn from its own tables."""

from dataclasses import dataclass
from typing import Literal

from dlokit.communication.topics import TOPICS
from dlokit.decision.flow import mermaid
from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.system.build import COMPONENTS
from dlokit.system.processes import PROCESSES

Drawing = Literal["flow", "topics", "processes", "all"]


@dataclass(frozen=True, kw_only=True)
class GraphArgs:
    """Print the system as Mermaid charts, drawn from the tables that run it.

    Paste the output into any Mermaid viewer, or into Markdown between ```mermaid fences.
    """

    what: Drawing = "all"
    """flow: the chart of the shape task (the paper's Fig. 6). topics: who publishes and who reads (Fig. 3).
    processes: what runs where when live."""


def topics_mermaid() -> str:
    """Components as boxes, topics as arrows from their publisher to each reader."""
    lines = ["flowchart LR"]
    lines += [f"    {name}[{name}]" for name in sorted(COMPONENTS)]
    for topic in TOPICS:
        readers = [name for name, component in COMPONENTS.items() if topic in component.subscribes()]
        label = f"{topic.name}<br/>{topic.type.__name__}"
        lines += [f'    {topic.publisher} -->|"{label}"| {reader}' for reader in sorted(readers)]
    return "\n".join(lines) + "\n"


def processes_mermaid() -> str:
    """Processes as boxes around the components that they host, in start order."""
    lines = ["flowchart TB"]
    for row in PROCESSES:
        lines.append(f"    subgraph {row.name}")
        lines += [f"        {row.name}_{component}[{component}]" for component in row.components]
        lines.append("    end")
    return "\n".join(lines) + "\n"


DRAWINGS = {
    "flow": lambda: mermaid(SHAPE_DLO),
    "topics": topics_mermaid,
    "processes": processes_mermaid,
}


def run(args: GraphArgs) -> int:
    """Print the charts."""
    names = list(DRAWINGS) if args.what == "all" else [args.what]
    for name in names:
        if len(names) > 1:
            print(f"%% {name}")
        print(DRAWINGS[name]())
    return 0
