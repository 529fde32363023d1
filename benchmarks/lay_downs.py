"""Where the prediction errors of lay-downs come from.

    python benchmarks/lay_downs.py
    python benchmarks/lay_downs.py --count 30 --json lay_downs.json

Plans lay-downs with `rollout` from the true shape of the cell's DLO, executes each in the cell, and predicts its result
again, from the true shape and the path of the tool as it was executed: with the planning rod, and with a rod in
MuJoCo whose nodes between the pads follow the tool. Both have the parameters that the system believes, or the true
ones. Prints the distance of each prediction from the true result (RMSE over the nodes).
"""

import asyncio
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.dlo import SOFT_ROPE
from dlokit.errors import ConfigError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.shaping.experiments import Experiment
from dlokit.extras.bench.shaping.suites import paper_suite
from dlokit.extras.bench.statistics import median
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.rod.believed import BelievedDlo, fit_length, topology
from dlokit.rod.rollout import Motion, PlanningRod, simulate, waypoints_of
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.types.action import Action, LayDown, Marks
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.robot import JointTrajectory, RobotMode
from parts.command import check_json, run_study, write_figures
from parts.held_rod import TICK_S, HeldRod

BELIEVED = BelievedDlo()
TRUE = replace(
    BELIEVED,
    bending_stiffness_n_m2=SOFT_ROPE.bending_stiffness_n_m2,
    mass_kg_m=SOFT_ROPE.mass_per_length_kg_m,
    friction=SOFT_ROPE.friction,
)
_HEIGHT_M = 0.06  # of approach and retreat, as in a task
_FORCE_N = 20.0
_REST_S = 2.0  # from the arrival at home to the look at the result
_LONGEST_GRIP_S = 3.0
_FREE_S = 0.4  # from the release to the end of a prediction in MuJoCo


@dataclass(frozen=True, kw_only=True)
class Args:
    """Compare predictions of lay-downs with their results in the cell."""

    count: int = 20
    """Number of lay-downs, taken in turn from the paper's experiments."""
    seed: int = 700
    """First seed of random starts and of the planner's candidates."""
    json: Path | None = None
    """Also write every figure to this file."""


@dataclass(frozen=True, kw_only=True)
class Laid:
    """One lay-down as it was executed."""

    case: str
    action: Action
    before_world: Float64Array
    """True nodes (Mc, 3) [m] in the closed gripper."""
    tool: Float64Array
    """The tool (T, 4) every 10 ms: x, y, z [m], yaw [rad]."""
    after_world: Float64Array
    """True nodes (M, 3) [m] at the end."""


def run(args: Args) -> int:
    """Execute, predict and print; exit code 0."""
    if args.count < 1:
        raise ConfigError(f"--count is {args.count}; it must be 1 or greater.")
    check_json(args.json)
    console = Console()
    with console.status("lay-downs in the cell"):
        done = list(itertools.islice(_executed(args.seed), args.count))
        errors_m = {name: [predict(one) for one in done] for name, predict in _predictions().items()}
    figures = [_figure(name, values) for name, values in errors_m.items()]
    console.print(_table(errors_m, [one.case for one in done]))
    write_figures(args.json, "lay_downs", figures, {"count": args.count, "seed": args.seed}, console)
    return 0


def _figure(name: str, errors_m: Sequence[float]) -> BenchFigure:
    return figure("all", name, "prediction error", median(errors_m), "m")


def _executed(seed: int) -> Iterator[Laid]:
    """Lay-downs of all experiments in turn, each with another seed."""
    bench = CellBench()
    for number, experiment in enumerate(itertools.cycle(paper_suite())):
        laid = bench.lay(experiment, seed + number)
        if laid is not None:
            yield laid


class CellBench:
    """The cell, driven without perception and without the bus."""

    def __init__(self) -> None:
        self._cell = Cell(CellConfig(), seed=0)
        self._kinematics = ArmKinematics(PANDA)

    def lay(self, experiment: Experiment, seed: int) -> Laid | None:
        """Plan an action from the true shape and execute it; None if it is no lay-down, or the arm cannot follow."""
        cell = self._cell
        cell.place_dlo(experiment.start_world(SOFT_ROPE, seed))
        goal = fit_length(BELIEVED, experiment.goal.nodes_world(BELIEVED.length_m, BELIEVED.radius_m))
        action = asyncio.run(self._planned(cell.true_nodes_world(), goal, seed))
        if not isinstance(action, LayDown):
            return None
        self._grip(action.grasp.opening_m)
        above = self._kinematics.inverse(geometry.lifted(action.grasp.T_world_tcp, _HEIGHT_M), self._q(), Yaw.EITHER)
        self._follow(joint_move(self._q(), above, PANDA.limits))
        self._follow(tool_move(self._kinematics, self._q(), (action.grasp.T_world_tcp,), action.velocity))
        self._grip(0.0)
        before = cell.true_nodes_world()
        tool = self._follow(tool_move(self._kinematics, self._q(), action.path, action.velocity))
        self._grip(action.grasp.opening_m)
        up = geometry.lifted(action.path[-1], _HEIGHT_M)
        self._follow(tool_move(self._kinematics, self._q(), (up,), action.velocity))
        self._follow(joint_move(self._q(), PANDA.home_q_rad, PANDA.limits))
        cell.step(_REST_S)
        after = geometry.resample(cell.true_nodes_world(), BELIEVED.nodes)
        return Laid(case=experiment.name, action=action, before_world=before, tool=tool, after_world=after)

    async def _planned(self, nodes_world: Float64Array, goal_world: Float64Array, stamp_ns: int) -> Action:
        tools = PlanningTools(reachable=self._kinematics.reachable, actions=ActionConfig(), model=BELIEVED)
        seen = fit_length(BELIEVED, geometry.resample(nodes_world, BELIEVED.nodes))
        shape = DloState(stamp_ns=stamp_ns, nodes_world=seen, topology=topology(BELIEVED))
        goal = GoalShape(stamp_ns=stamp_ns, nodes_world=goal_world)
        none = Marks(invalid_nodes=np.zeros(0, dtype=np.int64))
        return await anext(aiter(RolloutConfig().build(tools).propose(shape, goal, none)))

    def _q(self) -> Float64Array:
        return self._cell.arm.setpoint(self._cell.time_s).q_rad.copy()

    def _follow(self, trajectory: JointTrajectory) -> Float64Array:
        """Execute a trajectory; the tool (T, 4) at every tick of it."""
        cell = self._cell
        cell.arm.start_follow(trajectory, cell.time_s)
        tool = list[Float64Array]()
        while not tool or cell.arm.mode is not RobotMode.IDLE:
            cell.step(TICK_S)
            T = geometry.matrix(cell.arm.T_world_tcp)
            tool.append(np.array([*T[:3, 3], np.arctan2(T[1, 0], T[0, 0])]))
        track = np.array(tool)
        track[:, 3] = np.unwrap(track[:, 3])
        return track

    def _grip(self, width_m: float) -> None:
        self._cell.arm.fingers.start_grip(width_m, _FORCE_N)
        for _ in range(round(_LONGEST_GRIP_S / TICK_S)):
            self._cell.step(TICK_S)
            if self._cell.arm.fingers.at_rest:
                return


def _predictions() -> Mapping[str, Callable[[Laid], float]]:
    """Prediction error [m] of a lay-down by method."""
    believed = replace(
        SOFT_ROPE,
        bending_stiffness_n_m2=BELIEVED.bending_stiffness_n_m2,
        mass_per_length_kg_m=BELIEVED.mass_kg_m,
        friction=BELIEVED.friction,
    )
    rods = {
        "MuJoCo rod, believed parameters": HeldRod(believed),
        "MuJoCo rod, true but for the friction": HeldRod(replace(SOFT_ROPE, friction=BELIEVED.friction)),
        "MuJoCo rod, true but for the stiffness": HeldRod(
            replace(SOFT_ROPE, bending_stiffness_n_m2=BELIEVED.bending_stiffness_n_m2)
        ),
        "MuJoCo rod, true parameters": HeldRod(SOFT_ROPE),
    }
    return {
        "planning rod, believed parameters": lambda laid: _planning_rod_m(BELIEVED, laid),
        "planning rod, true parameters": lambda laid: _planning_rod_m(TRUE, laid),
        **{name: partial(_held_rod_m, rod) for name, rod in rods.items()},
    }


def _planning_rod_m(config: BelievedDlo, laid: Laid) -> float:
    action, waypoints, track = laid.action, waypoints_of(laid.action), laid.tool.copy()
    track[:, 3] += np.pi * round((float(waypoints[0, 3]) - float(track[0, 3])) / np.pi)  # the gripper's symmetry
    motion = Motion(node=action.grasp.node, waypoints=waypoints, velocity=action.velocity, track=track)
    played = simulate(config, laid.before_world, (PlanningRod(),), (motion,), TICK_S)
    return geometry.rmse_m(played.nodes_world[0, 0], laid.after_world)


def _held_rod_m(rod: HeldRod, laid: Laid) -> float:
    after = rod.after(laid.before_world, laid.tool, _FREE_S)
    return geometry.rmse_m(geometry.resample(after, BELIEVED.nodes), laid.after_world)


def _table(errors_m: Mapping[str, Sequence[float]], cases: Sequence[str]) -> Table:
    table = Table(title=f"prediction errors of {len(cases)} lay-downs [mm]")
    for title in ("method", "median", "mean", "80 %", "largest"):
        table.add_column(title, justify="left" if title == "method" else "right")
    for name, values in errors_m.items():
        mm = 1e3 * np.array(values)
        table.add_row(name, *(f"{value:.1f}" for value in (np.median(mm), mm.mean(), np.percentile(mm, 80), mm.max())))
    return table


if __name__ == "__main__":
    run_study(Args, run, __doc__)
