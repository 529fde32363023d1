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
    """A flow chart that is not complete: an outcome without an arrow, an arrow to nowhere, a box before its time."""


class FaultKind(enum.Enum):
    """How a box ends when a skill that it called did not succeed."""

    REFUSED = "refused"
    """The robot does not do the motion, or broke it off: another grasp may do."""
    INTERRUPTED = "interrupted"
    """An arm braked by itself though nothing is broken."""
    LOST = "lost"
    """A component that is needed to see is gone; it is started again."""
    FAILED = "failed"


class StepFault(DlokitError):
    """Raised in a box that cannot end as it should; the interpreter follows the arrow of its fault."""

    def __init__(self, kind: FaultKind, why: str, *, skill: str = "", reason: str = "") -> None:
        """`why` is for people; `reason` is the `skill`'s name of the failure, empty where none answered."""
        super().__init__(f"{skill} {why}" if skill else why)
        self.kind = kind
        self.why = why
        self.reason = reason


@dataclass(frozen=True)
class Step(Generic[Task, O]):
    """One box of a flow chart."""

    name: str
    run: Callable[[Task], Awaitable[O]]
    """Does the work; the outcome is one of an enum."""
    then: Mapping[O | FaultKind, str]
    """Outcome or fault → name of the next step, or of an end. A fault without an arrow of its own takes that of FAILED;
    a box without any calls no skill."""
    doc: str = ""
    """What the box says, for people."""
    mode: Mode | None = None
    """How the box changes the shape, if it does."""

    def expected(self) -> list[enum.Enum]:
        """What must have an arrow: every outcome, and FAILED where any fault has one."""
        kinds: set[type[enum.Enum]] = {type(outcome) for outcome in self.then}
        faults: list[enum.Enum] = [FaultKind.FAILED] if FaultKind in kinds else []
        return [outcome for kind in kinds - {FaultKind} for outcome in kind] + faults


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
            missing = [outcome for outcome in step.expected() if outcome not in step.then]
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


async def run_flow(
    flow: Flow[Task],
    task: Task,
    entered: Callable[[str, str], Awaitable[None]],
    faulted: Callable[[StepFault], None] = lambda fault: None,
) -> End:
    """Run a flow to one of its ends.

    `entered(step, last_outcome)` is awaited at each box, before it runs, the end included; it may hold the flow up
    (pause). `faulted` is told of each `StepFault` before its arrow is followed; in a box without an arrow for faults it
    is a mistake in the chart, and is raised.
    """
    name, last = flow.start, ""
    while (step := flow.step(name)) is not None:
        await entered(name, last)
        try:
            outcome = await step.run(task)
        except StepFault as fault:
            if FaultKind.FAILED not in step.then:
                raise
            faulted(fault)
            outcome = fault.kind if fault.kind in step.then else FaultKind.FAILED
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
