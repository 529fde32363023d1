"""A larger task whose flow calls `shape_dlo` twice: from I to S, and back to I."""

import enum
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib.pyplot as plt
from example_lab import draw_nodes, draw_table, run_example

from dlokit.decision.api import SHAPE_DLO, ShapeProgress
from dlokit.decision.flow import End, Flow, Step, run_flow
from dlokit.decision.records import ShapeResult
from dlokit.system.lockstep import LockstepSystem
from dlokit.types.flow import RunOutcome
from dlokit.types.outcome import Succeeded


class Shaped(enum.Enum):
    """Outcome of a shape task: whether the rope has the goal shape."""

    YES = "yes"
    NO = "no"


@dataclass
class ThereAndBack:
    """State of the larger task: the system and the result of each part."""

    system: LockstepSystem
    results: dict[str, ShapeResult] = field(default_factory=dict[str, ShapeResult])


def shape_to(goal: str) -> Callable[[ThereAndBack], Awaitable[Shaped]]:
    """A step that runs a whole shape task."""

    async def step(task: ThereAndBack) -> Shaped:
        outcome = await task.system.transport.call_reported(SHAPE_DLO, tell, goal)
        if not isinstance(outcome, Succeeded):
            print(f"  {outcome}")
            return Shaped.NO
        task.results[goal] = outcome.result
        return Shaped.YES if outcome.result.outcome is RunOutcome.CONVERGED else Shaped.NO

    return step


def tell(progress: ShapeProgress) -> None:
    if progress.action is not None and progress.rmse_m is not None:
        print(f"  action {progress.actions}: RMSE {progress.rmse_m * 1e3:.1f} mm")


THERE_AND_BACK: Flow[ThereAndBack] = Flow(
    name="there_and_back",
    start="there",
    steps=(
        Step("there", shape_to("S"), {Shaped.YES: "back", Shaped.NO: "given_up"}, "Lay the rope as an S."),
        Step("back", shape_to("I"), {Shaped.YES: "done", Shaped.NO: "given_up"}, "Straighten it again."),
    ),
    ends=(End("done", RunOutcome.CONVERGED), End("given_up", RunOutcome.FAILED)),
)


async def entered(step: str, last_outcome: str) -> None:
    print(step.replace("_", " "))


async def example(system: LockstepSystem, picture: Path) -> None:
    task = ThereAndBack(system)
    end = await run_flow(THERE_AND_BACK, task, entered)

    figure, axes = plt.subplots(1, len(task.results) or 1, figsize=(11, 5), squeeze=False)
    for part, (goal, result) in zip(axes[0], task.results.items(), strict=False):
        draw_table(part, f"to {goal}: {result.outcome.value}, {len(result.history)} actions")
        for nodes_world, style, label in (
            (result.start_nodes_world, "o-", "before"),
            (result.history[-1].nodes_world if result.history else None, "o-", "after"),
            (result.goal.nodes_world if result.goal is not None else None, "k--", "goal"),
        ):
            if nodes_world is not None:
                draw_nodes(part, nodes_world, style, label)
        part.legend()
    figure.savefig(picture, dpi=110)
    if end.outcome is not RunOutcome.CONVERGED:
        raise SystemExit("the rope did not get there and back")


if __name__ == "__main__":
    run_example("09_there_and_back.png", example, start="I")
