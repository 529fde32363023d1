"""`check_planner`: whether an action strategy keeps to its protocol."""

import asyncio
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from dlokit import geometry
from dlokit.communication.wire import codec
from dlokit.description.arm.franka import FRANKA_HAND
from dlokit.description.shapes import builtin_shape, moved, random_shape
from dlokit.extras.checks.checks import Check, findings, require_none
from dlokit.extras.checks.settings import settings_checks
from dlokit.rod.believed import BelievedDlo, topology
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import ActionStrategy, PlanningTools, StrategyConfig
from dlokit.skills.planning.config import strategies
from dlokit.types.action import Action, ActionBase, Marks, kind_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.pose import Pose

DLO = BelievedDlo()
STARTS: dict[str, Float64Array] = {
    "straight": builtin_shape("I", DLO.length_m, DLO.nodes),
    "moved": moved(builtin_shape("I", DLO.length_m, DLO.nodes), (0.05, 0.05), 0.7),
    "random": random_shape(np.random.default_rng(3), DLO.length_m, DLO.nodes),
}
"""Starts (M, 3) [m] of the checks."""
GOAL = GoalShape(stamp_ns=0, nodes_world=builtin_shape("S", DLO.length_m, DLO.nodes))

LARGEST_TURN_RAD = 0.5
"""Largest turn of the gripper from pose to pose: with more, the arm may turn the other way."""
NEAR_THE_ROD_M = 0.02
"""A grasp is on the rod, up to half a segment and the inset of an end off its node."""
LEAST_LIFT_M = 0.019
"""Height of a carry above the release, at least."""

Build = Callable[[PlanningTools], ActionStrategy]


def _everywhere(T_world_tcp: Pose) -> bool:
    return True


def shape_at(nodes_world: Float64Array) -> DloState:
    """The state of a DLO at nodes (M, 3) [m]."""
    return DloState(stamp_ns=5, nodes_world=nodes_world, topology=topology(DLO))


def proposals(
    build: Build,
    start: str,
    marked: Sequence[int] = (),
    reachable: Callable[[Pose], bool] = _everywhere,
) -> list[Action]:
    """All actions that a planner proposes for a start of `STARTS`."""
    strategy = build(PlanningTools(reachable=reachable, actions=ActionConfig(), model=DLO))
    marks = Marks(invalid_nodes=np.array(marked, dtype=np.int64))

    async def collect() -> list[Action]:
        return [action async for action in strategy.propose(shape_at(STARTS[start]), GOAL, marks)]

    return asyncio.run(collect())


def _builds(build: Build) -> Iterator[str]:
    strategy = build(PlanningTools(reachable=_everywhere, actions=ActionConfig(), model=DLO))
    if not callable(getattr(strategy, "propose", None)):
        yield f"build(tools) gives a {type(strategy).__name__} without propose"


def _actions(build: Build) -> Iterator[str]:
    for start in STARTS:
        actions = proposals(build, start)
        if not actions:
            yield f"nothing is proposed for the {start} DLO"
        for action in actions:
            if not isinstance(cast(object, action), ActionBase):
                yield f"a {type(action).__name__} is proposed"
                return


def _grasps(build: Build) -> Iterator[str]:
    for start, nodes in STARTS.items():
        for action in proposals(build, start):
            node, opening_m = action.grasp.node, action.grasp.opening_m
            if not 0 <= node < len(nodes):
                yield f"node {node} of {len(nodes)} is grasped"
                return
            off_m = float(np.linalg.norm(action.grasp.T_world_tcp.position_m[:2] - nodes[node, :2]))
            if not action.facts.grasps:
                if opening_m != 0.0 or off_m < NEAR_THE_ROD_M / 2:
                    begins = f"begins {off_m * 1e3:.0f} mm beside it, {opening_m * 1e3:.0f} mm open"
                    yield f"a {kind_of(action)} at node {node} {begins}"
            elif not 0.0 < opening_m <= FRANKA_HAND.open_width_m:
                yield f"the fingers open {opening_m * 1e3:.0f} mm at node {node}"
            elif off_m >= NEAR_THE_ROD_M:
                yield f"the grasp of node {node} is {off_m * 1e3:.0f} mm away from it"


def _paths(build: Build) -> Iterator[str]:
    for start in STARTS:
        for action in proposals(build, start):
            yield from (f"{kind_of(action)} of node {action.grasp.node}: {wrong}" for wrong in _path_flaws(action))


def _path_flaws(action: Action) -> Iterator[str]:
    grasp, end = action.grasp.T_world_tcp, action.path[-1]
    poses = (grasp, *action.path)
    turns_rad = (np.diff([_yaw_rad(pose) for pose in poses]) + np.pi) % (2.0 * np.pi) - np.pi
    if np.abs(turns_rad).max() >= LARGEST_TURN_RAD:
        yield f"the gripper turns by {np.abs(turns_rad).max():.1f} rad from one pose to the next"
    if any(geometry.rotation(pose)[2, 2] > -1.0 + 1e-6 for pose in poses):
        yield "the gripper does not point down"
    if abs(end.position_m[2] - grasp.position_m[2]) > 1e-6:
        yield f"it is released {(end.position_m[2] - grasp.position_m[2]) * 1e3:.0f} mm above the height of the grasp"
    lift_m = max(pose.position_m[2] for pose in action.path) - end.position_m[2]
    if action.facts.lifts and lift_m < LEAST_LIFT_M:
        yield f"it is carried {lift_m * 1e3:.0f} mm above the table, as if it were not lifted"


def _yaw_rad(T: Pose) -> float:
    R = geometry.rotation(T)
    return float(np.arctan2(R[1, 0], R[0, 0]))


def _marked(build: Build) -> Iterator[str]:
    first = proposals(build, "straight")[0].grasp.node
    if first in {action.grasp.node for action in proposals(build, "straight", (first,))}:
        yield f"node {first} is proposed although it is marked"
    if left := proposals(build, "straight", range(DLO.nodes)):
        yield f"all nodes are marked, and {len(left)} actions are proposed"


def _reach(build: Build) -> Iterator[str]:
    def near(T_world_tcp: Pose) -> bool:
        return bool(T_world_tcp.position_m[1] < 0.1)

    for action in proposals(build, "straight", reachable=near):
        if not (near(action.grasp.T_world_tcp) and near(action.path[-1])):
            yield f"the {kind_of(action)} of node {action.grasp.node} stops where the arm does not reach"


def _repeats(build: Build) -> Iterator[str]:
    first, second = proposals(build, "random"), proposals(build, "random")
    if [codec.encode(action) for action in first] != [codec.encode(action) for action in second]:
        yield "another instance proposes other actions for the same shape and goal"


def _untouched(build: Build) -> Iterator[str]:
    strategy = build(PlanningTools(reachable=_everywhere, actions=ActionConfig(), model=DLO))
    # What comes over the bus is read-only.
    shape = codec.decode(codec.encode(shape_at(STARTS["straight"])), DloState)
    goal = codec.decode(codec.encode(GOAL), GoalShape)
    asyncio.run(_first(strategy, shape, goal))
    yield from ()


BUILDS: Check[Build] = Check(
    name="builds", wanted="build(tools) of the settings gives an object with propose(shape, goal, marks)", run=_builds
)

PLANNER_CHECKS: tuple[Check[Build], ...] = (
    Check(name="actions", wanted="at least one action for a shape that is not the goal", run=_actions),
    Check(
        name="grasps",
        wanted=f"a node of the DLO, the fingers on it and up to {FRANKA_HAND.open_width_m * 1e3:.0f} mm open; "
        "take_to_goal makes such an action",
        run=_grasps,
    ),
    Check(
        name="paths",
        wanted="the gripper points down, turns little from pose to pose, is lifted and ends at the height of the grasp",
        run=_paths,
    ),
    Check(name="marks", wanted="no node of marks.invalid_nodes is proposed; nothing, when all are marked", run=_marked),
    Check(name="reach", wanted="tools.reachable holds where the tool grasps and releases", run=_reach),
    Check(
        name="repeatable",
        wanted="the same actions for the same arguments; seed what is random in propose, e.g. by shape.stamp_ns",
        run=_repeats,
    ),
    Check(name="arguments untouched", wanted="shape and goal may be read-only: copy before you change", run=_untouched),
)
"""What an action strategy keeps to; how its settings do is in `settings`."""


@dataclass(frozen=True, kw_only=True)
class PlannerReport:
    """What is known of a planner that passed every check."""

    name: str
    passed: tuple[str, ...]
    """Names of the checks."""
    kinds: tuple[str, ...]
    """Kinds of actions that it proposed."""
    decision_p50_s: float
    """Half of the decisions took less time until the first action [s]."""

    def __str__(self) -> str:
        return (
            f"{self.name}: {len(self.passed)} checks passed; proposes {', '.join(self.kinds)}; the first action takes "
            f"{self.decision_p50_s * 1e3:.0f} ms (p50)"
        )


def check_planner(planner: StrategyConfig | type[StrategyConfig]) -> PlannerReport:
    """Try every requirement of the planner protocol on built-in shapes.

    `planner` is a configuration class, checked with its defaults, or an instance of one; it need not be installed.
    Raises `CheckFailed`, which lists all that is wrong.
    """
    kind = planner if isinstance(planner, type) else type(planner)
    found = findings(settings_checks("planner", dict(strategies())), kind)

    def build(tools: PlanningTools) -> ActionStrategy:
        return (planner() if isinstance(planner, type) else planner).build(replace(tools))

    cannot = findings((BUILDS,), build)
    found += cannot or findings(PLANNER_CHECKS, build)
    require_none(f"planner {kind.__module__}:{kind.__qualname__}", found)
    return _report(kind.name, build)


def _report(name: str, build: Build) -> PlannerReport:
    kinds = {kind_of(action): None for start in STARTS for action in proposals(build, start)}
    took_s: list[float] = []
    for nodes in STARTS.values():
        strategy = build(PlanningTools(reachable=_everywhere, actions=ActionConfig(), model=DLO))
        begin = time.perf_counter()
        asyncio.run(_first(strategy, shape_at(nodes), GOAL))
        took_s.append(time.perf_counter() - begin)
    passed = (*settings_checks("planner", {}), BUILDS, *PLANNER_CHECKS)
    return PlannerReport(
        name=name,
        passed=tuple(check.name for check in passed),
        kinds=tuple(kinds),
        decision_p50_s=float(np.median(took_s)),
    )


async def _first(strategy: ActionStrategy, shape: DloState, goal: GoalShape) -> Action | None:
    return await anext(strategy.propose(shape, goal, Marks(invalid_nodes=np.array([], dtype=np.int64))), None)
