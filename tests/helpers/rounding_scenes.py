"""Results that must not depend on rounding: each scene computes one from inputs that may be perturbed.

As a script, it writes the results of all scenes to a file: `python rounding_scenes.py OUT.npz`. So they can be run with
kernels compiled for another processor.
"""

import asyncio
import logging
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from dlokit.communication import topics
from dlokit.description.arm.franka import PANDA
from dlokit.description.default_cameras import default_calibration
from dlokit.description.shapes import builtin_shape, moved, random_shape
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.recording.reader import read_recording
from dlokit.rod.believed import BelievedDlo, as_configured, topology
from dlokit.rod.equilibrium import nearest_static
from dlokit.skills.model.carry import Carry
from dlokit.skills.model.tracking import PdTracker
from dlokit.skills.observer.config import OURS, ObserverConfig
from dlokit.skills.observer.following import followed
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.skills.planning.verdict import goal_verdict
from dlokit.skills.planning.verdict.feasibility import Workplace
from dlokit.skills.planning.verdict.goal_verdict import judge
from dlokit.types.action import Action, Marks, kind_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape, TargetPoints
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.observation import GraspState, Observation
from dlokit.types.robot import RobotState

Rounded = Callable[[Float64Array], Float64Array]
"""Returns an input unchanged, or perturbed by as much as rounding may."""
Outcome = dict[str, Float64Array | str]
"""Lengths [m] and texts, by name."""

MODEL = BelievedDlo()
GOALS = {name: builtin_shape(name, MODEL.length_m, MODEL.nodes) for name in ("I", "S")}
STIFF_N_M2 = (5e-5, 2e-4, 1e-3)
RECORDING = Path(__file__).parents[1] / "replay" / "references" / "rollout.mcap"
"""A run whose rod is carried, half behind the arm."""


def observed(rounded: Rounded) -> Outcome:
    """Every observer's targets for every cloud of a recorded run, from the states that the run had."""
    found: Outcome = {}
    for config in OURS:
        observer = ObserverConfig(strategy=config())
        strategy = observer.strategy.build(MODEL)
        for number, (seen, prior) in enumerate(_looks()):
            moved_prior = replace(prior, nodes_world=rounded(prior.nodes_world))
            found[f"{config.name} {number}"] = followed(strategy, seen, moved_prior, observer).targets.nodes_world
    return found


def _looks() -> list[tuple[Observation, DloState]]:
    prior: DloState | None = None
    found = list[tuple[Observation, DloState]]()
    for one in read_recording(RECORDING, {topics.OBSERVATION.name, topics.STATE.name}):
        if isinstance(one.message, DloState):
            prior = one.message
        elif isinstance(one.message, Observation) and prior is not None:
            found.append((one.message, prior))
    return found


def tracked(rounded: Rounded) -> Outcome:
    """The model pulled to the target points of a recorded run, some of which are hidden."""
    tracker, found, before_ns = PdTracker(MODEL), Outcome(), -1
    for number, one in enumerate(read_recording(RECORDING, {topics.TARGETS.name})):
        seen = one.message
        assert isinstance(seen, TargetPoints)
        if number == 0 or seen.stamp_ns == before_ns:  # ordered from scratch, in the order of the goal
            tracker.place(rounded(seen.nodes_world))
        before_ns = seen.stamp_ns
        found[f"look {number}"] = tracker.track(rounded(seen.nodes_world), seen.visible).nodes_world
    return found


def carried(rounded: Rounded) -> Outcome:
    """The model while a recorded tool carries the rod, and after its release."""
    carry, tools, found = Carry(MODEL), dict[str, RobotState](), Outcome()
    carry.place(rounded(GOALS["I"]))
    names = {topics.ROBOT_STATE.name, topics.GRIPPED.name}
    for number, one in enumerate(read_recording(RECORDING, names)):
        match one.message:
            case RobotState():
                tools[one.message.robot] = one.message
                if carry.move(one.message):
                    found[f"state {number}"] = carry.nodes_world
            case GraspState(node=None):
                carry.release(one.message.robot)
                found[f"released {number}"] = carry.nodes_world
            case GraspState(node=int(node)):
                carry.take_hold(one.message.robot, node, tools[one.message.robot])
            case _:
                pass
    return found


def held(rounded: Rounded) -> Outcome:
    """The nearest shapes that friction holds, of an S and of ten random curves, for stiff rods."""
    curves = [GOALS["S"], *(random_shape(np.random.default_rng(k), 0.5, 31, min_bend_radius_m=0.03) for k in range(10))]
    weight_n_m = MODEL.friction * 9.81 * MODEL.mass_kg_m
    return {
        f"curve {k} EI {stiff}": nearest_static(rounded(curve), stiff / weight_n_m / 0.75).nodes_world
        for k, curve in enumerate(curves)
        for stiff in STIFF_N_M2
    }


def verdicts(rounded: Rounded) -> Outcome:
    """Verdicts on goals near the edge of the table, and tight ones, with the nearest shape that holds."""
    found: Outcome = {}
    for k in range(12):
        curve = random_shape(np.random.default_rng(100 + k), 0.5, 31, min_bend_radius_m=0.02)
        goal = moved(curve, (0.02 * k, 0.0), 0.1 * k)
        verdict = asyncio.run(_verdict(rounded(goal)))
        problems = sorted(finding.problem.value for finding in verdict.findings)
        found[f"goal {k} verdict"] = " ".join([verdict.standing.value, *problems])
        if verdict.nearest_world is not None:
            found[f"goal {k} nearest"] = verdict.nearest_world
    return found


async def _verdict(goal_world: Float64Array) -> GoalVerdict:
    planning, threshold_m = PlanningConfig(), 0.012
    place = Workplace(MODEL, planning.feasibility, ArmKinematics(PANDA).reachable, default_calibration())

    async def try_goal(nodes_world: Float64Array) -> goal_verdict.HoldVerdict:
        return goal_verdict.try_goal(MODEL, as_configured(MODEL, 0), nodes_world, threshold_m, planning.feasibility)

    goal = GoalShape(stamp_ns=0, nodes_world=goal_world)
    return await judge(goal, threshold_m, place=place, try_goal=try_goal)


def planned(rounded: Rounded) -> Outcome:
    """First action of the default planner: kind, node and path, from an I and a random curve to an S."""
    found: Outcome = {}
    for name, start in (("I", GOALS["I"]), ("random", random_shape(np.random.default_rng(7), 0.5, 31))):
        action = asyncio.run(_first_action(rounded(start), rounded(GOALS["S"])))
        found[f"{name} action"] = f"{kind_of(action)} at node {action.grasp.node}"
        poses = (action.grasp.T_world_tcp, *action.path)
        found[f"{name} path"] = np.array([pose.position_m for pose in poses])
    return found


async def _first_action(start_world: Float64Array, goal_world: Float64Array) -> Action:
    tools = PlanningTools(reachable=lambda T: True, actions=ActionConfig(), model=MODEL)
    strategy = RolloutConfig(search=SearchConfig(rollouts=160, finalists=2)).build(tools)
    shape = DloState(stamp_ns=0, nodes_world=start_world, topology=topology(MODEL))
    marks = Marks(invalid_nodes=np.zeros(0, dtype=np.int64))
    return await anext(aiter(strategy.propose(shape, GoalShape(stamp_ns=0, nodes_world=goal_world), marks)))


SCENES = (observed, tracked, carried, held, verdicts, planned)


def all_scenes() -> dict[str, Any]:
    """Result of every scene for unperturbed inputs."""
    return {f"{scene.__name__}: {key}": value for scene in SCENES for key, value in scene(lambda array: array).items()}


def main(out: Path) -> None:
    """Write the result of every scene for unperturbed inputs."""
    logging.disable()
    np.savez(out, **all_scenes())


if __name__ == "__main__":
    main(Path(sys.argv[1]))
