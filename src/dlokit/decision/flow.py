"""Flow charts as data: a table of steps and outcome → next step (paper, Fig. 6).

The same table is run, logged, drawn by the viewer with the active step highlighted, and printed as Mermaid.
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
    """An incomplete flow chart: an outcome without an arrow, an arrow to nowhere, a step that runs too early."""


class FaultKind(enum.Enum):
    """How a step ends when a skill that it called did not succeed."""

    REFUSED = "refused"
    """The robot refused or aborted the motion: another grasp may succeed."""
    INTERRUPTED = "interrupted"
    """An arm braked on its own, without a defect."""
    LOST = "lost"
    """A component of perception or of the model, or the camera, is lost; the flow waits for it."""
    FAILED = "failed"


class StepFault(DlokitError):
    """Raised in a step that cannot reach one of its outcomes; the interpreter follows the arrow of the fault."""

    def __init__(self, kind: FaultKind, why: str, *, skill: str = "", reason: str = "") -> None:
        """`why` is for people; `reason` is the failure's name in the `skill`'s api, empty without an answer."""
        super().__init__(f"{skill} {why}" if skill else why)
        self.kind = kind
        self.why = why
        self.reason = reason


@dataclass(frozen=True)
class Step(Generic[Task, O]):
    """One step of a flow chart."""

    name: str
    run: Callable[[Task], Awaitable[O]]
    """Does the work; the outcome is one of an enum."""
    then: Mapping[O | FaultKind, str]
    """Outcome or fault → name of the next step, or of an end. A fault without its own arrow follows the arrow of
    FAILED; a step without fault arrows calls no skill."""
    doc: str = ""
    """What the step does, for people."""
    mode: Mode | None = None
    """How the step changes the shape, if it does."""
    motion: str = ""
    """How an arm moves in it, for the question to the operator; empty: none moves."""

    def expected(self) -> list[enum.Enum]:
        """The outcomes that must have an arrow: all outcomes, and FAILED if any fault has an arrow."""
        kinds: set[type[enum.Enum]] = {type(outcome) for outcome in self.then}
        faults: list[enum.Enum] = [FaultKind.FAILED] if FaultKind in kinds else []
        return [outcome for kind in kinds - {FaultKind} for outcome in kind] + faults


@dataclass(frozen=True)
class End:
    """An end of a flow, with its outcome."""

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
            raise FlowError(f"flow {self.name!r} has two steps of one name: {sorted(names)}")
        for name in (self.start, *(target for _, _, target in self.edges())):
            if name not in names:
                raise FlowError(f"flow {self.name!r} has an arrow to {name!r}; its steps are {names}")
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

    `entered(step, last_outcome)` is awaited at each step before it runs, and at the end; it may delay the flow (pause).
    `faulted` is called with each `StepFault` before its arrow is followed; in a step without an arrow for faults the
    fault is an error of the chart, and is raised.
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
    """The flow as a Mermaid chart, the current step highlighted."""
    lines = ["flowchart TD"]
    lines += [f'    {step.name}["{step.name.replace("_", " ")}"]' for step in flow.steps]
    lines += [f'    {end.name}(["{end.name.replace("_", " ")}"])' for end in flow.ends]
    lines.append(f"    start((start)) --> {flow.start}")
    lines += [f"    {source} -->|{outcome.replace('_', ' ')}| {target}" for source, outcome, target in flow.edges()]
    if current is not None:
        lines.append(f"    style {current} fill:#fb923c,stroke:#9a3412,color:#000")
    return "\n".join(lines) + "\n"
