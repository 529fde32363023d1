"""A kind of action that a test adds to the table: it is simulated, executed and named without another line."""

import functools
import io
import operator
from collections.abc import AsyncIterator
from dataclasses import dataclass
from types import UnionType
from typing import Any, ClassVar, get_args, get_origin

import numpy as np
import pytest
from ideal_lab import ROD, I, Trace, lab, shape
from made_results import made_action, made_run
from page_code import blocks
from rich.console import Console

from dlokit import geometry
from dlokit.app.report.figures import error_curve
from dlokit.app.shape.outcome_text import grip_text
from dlokit.app.shape.terminal import action_table
from dlokit.communication.wire import codec
from dlokit.decision.config import TaskConfig
from dlokit.description.arm.franka import FRANKA_HAND
from dlokit.description.shapes import moved
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import predict
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.rollout.candidates import PlanningScene, to_action
from dlokit.skills.planning.rollout.score import usual_error_m
from dlokit.system.results.run_result import RunRecord
from dlokit.types import action
from dlokit.types.action import KINDS, Action, ActionBase, Grasp, KindFacts, Marks, VelocityProfile, kind_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape

GOAL = moved(I, (0.05, 0.0))


class Lift(ActionBase, frozen=True, kw_only=True, eq=False, tag="lift"):
    """Grasp a node, lift it, and put it down elsewhere."""

    facts = KindFacts(does="Lifts a node", usual_error_m=0.02)


class Sweep(ActionBase, frozen=True, kw_only=True, eq=False, tag="sweep"):
    """Push the rod with closed fingers."""

    facts = KindFacts(does="Sweeps the DLO aside", usual_error_m=0.004, grasps=False, lifts=False, corrected=False)


def added(kind: type[Lift | Sweep], nodes_world: Float64Array) -> Any:
    """An action of the kind, at the middle of the rod, which it moves towards the goal."""
    node = len(nodes_world) // 2
    x, y, _ = nodes_world[node]
    aside_m = 0.0 if kind is Lift else 0.03
    height_m = FRANKA_HAND.grasp_height_m()
    here, over, there = (
        geometry.downward((x - aside_m + along_m, y, z_m), 0.0)
        for along_m, z_m in ((0.0, height_m), (0.025, height_m + (0.04 if kind is Lift else 0.0)), (0.05, height_m))
    )
    opening_m = 0.04 if kind is Lift else 0.0
    grasp = Grasp(node=node, T_world_tcp=here, opening_m=opening_m)
    return kind(stamp_ns=0, grasp=grasp, path=(over, there), velocity=VelocityProfile())


@dataclass(frozen=True, kw_only=True)
class Planner:
    """Proposes nothing but actions of one kind."""

    kind: type[Lift | Sweep]
    name: ClassVar[str] = "added"

    def build(self, tools: object) -> "Planner":
        return self

    async def propose(self, shape: DloState, goal: GoalShape, marks: Marks) -> AsyncIterator[Any]:
        yield added(self.kind, shape.nodes_world)


def executed(kind: type[Lift | Sweep]) -> Trace:
    """A run of one action in the ideal lab."""
    return shape(lab(I), GOAL, TaskConfig(max_actions=1), planning=PlanningConfig(strategy=Planner(kind=kind)))


def _with_added(wanted: Any) -> Any:
    """A type of the bus, with the added kinds wherever it has the union of all kinds."""
    if wanted == Action:
        return Action | Lift | Sweep
    parts = get_args(wanted)
    changed = tuple(_with_added(part) for part in parts)
    if changed == parts:
        return wanted
    return functools.reduce(operator.or_, changed) if isinstance(wanted, UnionType) else get_origin(wanted)[changed]


@pytest.fixture(autouse=True)
def table(monkeypatch: pytest.MonkeyPatch) -> None:
    """What members of the union have: a row in the table, and a tag that the bus decodes."""
    decoder = codec._decoder  # pyright: ignore[reportPrivateUsage]
    monkeypatch.setattr(codec, "_decoder", lambda wanted: decoder(_with_added(wanted)))  # pyright: ignore[reportUnknownArgumentType, reportUnknownLambdaType]
    for kind in (Lift, Sweep):
        monkeypatch.setitem(KINDS, str(kind.__struct_config__.tag), kind.facts)  # pyright: ignore[reportArgumentType]


def test_it_is_simulated_by_what_it_holds() -> None:
    lifted, swept = (predict(ROD, I, added(kind, I), FRANKA_HAND)[10] - I[10] for kind in (Lift, Sweep))
    # A node that is held moves with the tool; closed fingers first cover the distance to the rod.
    assert lifted[0] == pytest.approx(0.05, abs=0.01)
    assert 0.025 < swept[0] < 0.04


@pytest.mark.parametrize(
    ("kind", "taken", "others"),
    [
        (Lift, ("grasp", "held", "move_to_goal"), ("grasp", "beside", "push")),
        (Sweep, ("grasp", "beside", "push"), ("grasp", "held", "move_to_goal")),
    ],
)
def test_the_flow_chart_executes_it_by_what_it_holds(
    kind: type[Lift | Sweep], taken: tuple[str, str, str], others: tuple[str, str, str]
) -> None:
    trace = executed(kind)
    assert taken in trace.edges()
    assert others not in trace.edges()
    assert ("grasp" in trace.calls) == kind.facts.grasps
    (record,) = trace.result.history
    assert record.kind == kind_of(kind)  # pyright: ignore[reportArgumentType]
    assert record.expected_world is not None


def test_the_kind_of_the_how_to_is_proposed_as_written(monkeypatch: pytest.MonkeyPatch) -> None:
    row, family = blocks("docs/how-to/add-a-kind-of-action.md")
    types, planner = {**vars(action), "__name__": action.__name__}, {"__name__": "flipping"}
    exec(compile(row, "row", "exec"), types)
    monkeypatch.setattr(action, "Flip", types["Flip"], raising=False)
    exec(compile(family, "family", "exec"), planner)
    tools = PlanningTools(reachable=lambda pose: True, actions=ActionConfig(), model=ROD)
    flipping: Any = planner["Flipping"](PlanningScene(I, GOAL, frozenset(), tools))  # pyright: ignore[reportCallIssue]
    candidates = [flipping.make(numbers) for numbers in flipping.first(20, np.random.default_rng(0))]
    assert {candidate.motion.node for candidate in candidates} == {*range(0, 5, 2), *range(16, 21, 2)}
    flip = to_action(candidates[0], 1, I, tools)
    heights_m = [pose.position_m[2] - flip.grasp.T_world_tcp.position_m[2] for pose in flip.path]
    assert kind_of(flip) == "flip"
    assert (max(heights_m), heights_m[-1]) == (pytest.approx(0.025), pytest.approx(0.0))
    assert flip.facts.grasps


def test_its_usual_error_counts_in_the_score() -> None:
    assert usual_error_m(Lift, BelievedDlo()) == 0.02  # pyright: ignore[reportArgumentType]


def test_the_terminal_names_it_and_its_grasp() -> None:
    rows = (made_action(1, "lift"), made_action(2, "sweep", grasp_ok=False))
    assert [grip_text(row) for row in rows] == ["held", "pushed"]
    console = Console(width=100, file=io.StringIO())
    console.print(action_table(rows, threshold_m=0.012))
    assert isinstance(console.file, io.StringIO)
    assert all(word in console.file.getvalue() for word in ("lift", "sweep"))


def test_the_report_draws_only_a_grasp_that_held_nothing_as_lost() -> None:
    def lost(kind: str) -> bool:
        run = made_run((made_action(1, kind, grasp_ok=False),))
        return "grasp not held" in error_curve(RunRecord(name="I", result=run, goal_nodes_world=GOAL))

    assert (lost("lift"), lost("sweep")) == (True, False)
