"""Flow charts as data: a table of steps and outcome → next step (paper, Fig. 6).

The same table is run, logged, drawn by the viewer with the current step lit, and printed as Mermaid.
"""

import enum
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from dlokit.errors import DlokitError
from dlokit.types.flow import Mode, RunOutcome

Task = TypeVar("Task")
O = TypeVar("O", bound=enum.Enum)  # noqa: E741  the outcome of a step, as in the design


class FlowError(DlokitError):
    """A flow chart that is not complete: an outcome without an arrow, an arrow to nowhere."""


@dataclass(frozen=True)
class Step(Generic[Task, O]):
    """One box of a flow chart."""

    name: str
    run: Callable[[Task], Awaitable[O]]
    """Does the work; the outcome is one of an enum."""
    then: Mapping[O, str]
    """Outcome → name of the next step, or of an end."""
    doc: str = ""
    """What the box says, for people."""
    mode: Mode | None = None
    """How the box changes the shape, if it does."""


@dataclass(frozen=True)
class End:
    """Where a flow stops, and what that means."""

    name: str
    outcome: RunOutcome


@dataclass(frozen=True)
class Flow(Generic[Task]):
    """A flow chart. Raises `FlowError` when an arrow is missing or leads nowhere."""

    name: str
    start: str
    steps: tuple[Step[Task, Any], ...]
    ends: tuple[End, ...]

    def __post_init__(self) -> None:
        names = [step.name for step in self.steps] + [end.name for end in self.ends]
        if len(set(names)) != len(names):
            raise FlowError(f"flow {self.name!r} has two boxes of one name: {sorted(names)}")
        for name in (self.start, *(target for _, _, target in self.edges())):
            if name not in names:
                raise FlowError(f"flow {self.name!r} has an arrow to {name!r}; its boxes are {names}")
        for step in self.steps:
            outcomes: type[enum.Enum] = type(next(iter(step.then)))
            missing = [outcome for outcome in outcomes if outcome not in step.then]
            if missing:
                raise FlowError(f"step {step.name!r} of flow {self.name!r} has no arrow for {missing}")

    def edges(self) -> list[tuple[str, str, str]]:
        """Every arrow: (step, outcome, next)."""
        return [(step.name, outcome.value, target) for step in self.steps for outcome, target in step.then.items()]

    def step(self, name: str) -> Step[Task, Any] | None:
        """The step of that name, or None for an end."""
        return next((step for step in self.steps if step.name == name), None)

    def end(self, name: str) -> End:
        """The end of that name."""
        return next(end for end in self.ends if end.name == name)


async def run_flow(flow: Flow[Task], task: Task, entered: Callable[[str, str], Awaitable[None]]) -> End:
    """Run a flow to one of its ends.

    `entered(step, last_outcome)` is awaited at each box, before it runs, the end included; it may hold the
    flow up (pause).
    """
    name, last = flow.start, ""
    while (step := flow.step(name)) is not None:
        await entered(name, last)
        outcome = await step.run(task)
        name, last = step.then[outcome], outcome.value
    await entered(name, last)
    return flow.end(name)


def mermaid(flow: Flow[Any], current: str | None = None) -> str:
    """The flow as a Mermaid chart, the current step lit."""
    lines = ["flowchart TD"]
    lines += [f'    {step.name}["{step.name.replace("_", " ")}"]' for step in flow.steps]
    lines += [f'    {end.name}(["{end.name.replace("_", " ")}"])' for end in flow.ends]
    lines.append(f"    start((start)) --> {flow.start}")
    lines += [f"    {source} -->|{outcome.replace('_', ' ')}| {target}" for source, outcome, target in flow.edges()]
    if current is not None:
        lines.append(f"    style {current} fill:#fb923c,stroke:#9a3412,color:#000")
    return "\n".join(lines) + "\n"
