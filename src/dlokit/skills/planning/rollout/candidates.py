"""Candidates: parameter vectors, converted to motions of the tool that gripper and arm can execute."""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from dlokit import geometry
from dlokit.rod.rollout import Motion, closed_fingers
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.grasp import (
    RodPoint,
    fitting_openings_m,
    grasp_fraction,
    grasp_pose,
    grasp_yaw,
    rod_point,
    wrapped,
)
from dlokit.types.action import Action, Grasp, Partner, VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

_LARGEST_TURN_RAD = 2.6  # above it, the wrist rarely has room
_POSE_EVERY_RAD = 0.3  # between poses of a path at most, so that the interpolation follows the intended direction


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A motion, and what it was made from."""

    kind: type[Action]
    numbers: Float64Array
    """What the family made it from."""
    motion: Motion
    opening_m: float
    """Finger opening at which the gripper fits around the rod [m]."""
    partner_opening_m: float = 0.0
    """The same for the partner's, if there is one [m]."""


class Family(Protocol):
    """A kind of candidates with parameters (D,), whose meaning and units each family defines."""

    kind: type[Action]

    def first(self, count: int, rng: np.random.Generator) -> list[Float64Array]:
        """Parameters of `count` initial candidates."""
        ...

    @property
    def spread(self) -> Float64Array:
        """Spread of the parameters in the first refinement of a good candidate."""
        ...

    def aimed(self, numbers: Float64Array, nodes_world: Float64Array) -> Float64Array:
        """The parameters, corrected for the difference between the reached shape (M, 3) [m] and the goal."""
        ...

    def make(self, numbers: Float64Array) -> Candidate | None:
        """The candidate with these parameters; None when the gripper does not fit or the arm does not reach."""
        ...


@dataclass(frozen=True)
class NodeToGoal:
    """A node that can be grasped, with its position in the goal."""

    node: int
    here: RodPoint
    there: RodPoint
    openings_m: tuple[float, ...]
    """Finger openings at which the gripper fits around the rod, the widest first."""


_FOLLOW_M = 0.08  # neighbours this far along the rod follow a carried node by a third


class PlanningScene:
    """A shape, its goal, and the grasps that are possible."""

    def __init__(
        self, nodes_world: Float64Array, goal_world: Float64Array, marked: frozenset[int], tools: PlanningTools
    ) -> None:
        """Both shapes (M, 3) [m]; `marked` nodes are not grasped."""
        self.nodes_world, self.goal_world, self.marked, self.tools = nodes_world, goal_world, marked, tools
        self._holds: dict[tuple[int, bool], NodeToGoal | None] = {}

    @property
    def count(self) -> int:
        """Number of nodes M."""
        return len(self.nodes_world)

    @cached_property
    def error_m(self) -> Float64Array:
        """Distance of every node to its goal (M,) [m]."""
        return np.linalg.norm(self.goal_world - self.nodes_world, axis=1)

    @cached_property
    def length_m(self) -> float:
        """Length of the goal [m]."""
        return float(geometry.arc_lengths(self.goal_world)[-1])

    @cached_property
    def nodes_to_move(self) -> tuple[int, ...]:
        """Every other node, the farthest from its goal first; then those far from their goal and from earlier nodes.

        Any beginning of the list covers the rod, so that a short search has tried all parts of it.
        """
        left = np.argsort(-self.error_m, kind="stable")[::2].tolist()
        order = [left.pop(0)]
        while left:
            away = [min(abs(node - other) for other in order) for node in left]
            order.append(left.pop(int(np.argmax(self.error_m[left] * away))))
        return tuple(order)

    def helpful(self, node: float, error_m: Float64Array, fraction: float) -> Float64Array:
        """`fraction` times the displacement (2,) [m] of a node that best reduces `error_m` (M, 2) [m] around it.

        Neighbours are assumed to follow a carried node by their usual fraction.
        """
        away = np.abs(np.arange(self.count) - node) * self.length_m / (self.count - 1)
        follow = np.exp(-((away / _FOLLOW_M) ** 2))
        move: Float64Array = fraction * follow @ error_m / (follow @ follow)
        return move

    @cached_property
    def closed_fingers(self) -> Float64Array:
        """What the first arm pushes with, as `Motion` takes it."""
        return closed_fingers(self.tools.arm.gripper)

    @cached_property
    def second_tools(self) -> PlanningTools:
        """What the second arm may use."""
        return self.tools.of_second

    def hold(self, node: int, *, second: bool = False) -> NodeToGoal | None:
        """The grasp of a node by the first or the second arm; None when it is marked or the gripper does not fit."""
        key = (node, second)
        if key not in self._holds:
            self._holds[key] = self._find(node, self.second_tools if second else self.tools)
        return self._holds[key]

    def _find(self, node: int, tools: PlanningTools) -> NodeToGoal | None:
        if node in self.marked:
            return None
        fraction = grasp_fraction(self.nodes_world, node)
        here = rod_point(self.nodes_world, fraction)
        openings_m = tuple(fitting_openings_m(tools.arm.gripper, self.nodes_world, here, tools.model.radius_m))
        if not openings_m:
            return None
        return NodeToGoal(node=node, here=here, there=rod_point(self.goal_world, fraction), openings_m=openings_m)

    def start(self, hold: NodeToGoal, more_turn_rad: float, *, second: bool = False) -> tuple[Float64Array, float]:
        """The tool at the grasp (4,): x, y, z [m], yaw [rad]; and how far it turns to the goal's tangent and more."""
        tools = self.second_tools if second else self.tools
        turn = wrapped(hold.there.yaw_rad - hold.here.yaw_rad) + more_turn_rad
        turn = min(max(turn, -_LARGEST_TURN_RAD), _LARGEST_TURN_RAD)
        yaw = grasp_yaw(tools.arm, hold.here, turn, tools.place_m)
        return np.array([*hold.here.position_world[:2], tools.grasp_height_m, yaw]), turn

    def candidate(
        self, kind: type[Action], numbers: Float64Array, hold: NodeToGoal, tool: Float64Array, velocity: VelocityProfile
    ) -> Candidate | None:
        """A candidate from waypoints (W, 4) of the tool; None when the arm does not reach one of them, or the hand has
        no room among the fixtures."""
        opening_m = self.tools.room.opening_m(tool, hold.openings_m, holds=kind.facts.grasps)
        if opening_m is None or not all(self.tools.reachable(tool_pose(point)) for point in tool):
            return None
        fingers = None if kind.facts.grasps else self.closed_fingers
        motion = Motion(node=hold.node, waypoints=tool, velocity=velocity, fingers=fingers)
        return Candidate(kind=kind, numbers=numbers, motion=motion, opening_m=opening_m)


def to_action(candidate: Candidate, stamp_ns: int, predicted_nodes_world: Float64Array, tools: PlanningTools) -> Action:
    """The action of a candidate, with the predicted shape (M, 3) [m]."""
    motion, partner = candidate.motion, None
    grasp, path = _handled(motion, candidate.opening_m, tools)
    if motion.partner is not None:
        assert tools.second is not None
        other_grasp, other_path = _handled(motion.partner, candidate.partner_opening_m, tools.of_second)
        partner = Partner(
            robot=tools.second.robot, grasp=other_grasp, path=other_path, velocity=motion.partner.velocity
        )
    return candidate.kind(
        stamp_ns=stamp_ns,
        grasp=grasp,
        path=path,
        velocity=motion.velocity,
        predicted_nodes_world=predicted_nodes_world,
        partner=partner,
    )


def _handled(motion: Motion, opening_m: float, tools: PlanningTools) -> tuple[Grasp, tuple[Pose, ...]]:
    """Grasp and path of one tool."""
    tool = motion.waypoints
    poses: list[Pose] = []
    for start, end in itertools.pairwise(tool):
        count = max(1, math.ceil(abs(end[3] - start[3]) / _POSE_EVERY_RAD))
        poses += [tool_pose(start + fraction * (end - start)) for fraction in np.linspace(0.0, 1.0, count + 1)[1:]]
    first = RodPoint(s_m=0.0, position_world=tool[0, :3], yaw_rad=0.0)
    T_world_tcp = grasp_pose(first, float(tool[0, 3]), tools.grasp_height_m)
    return Grasp(node=motion.node, T_world_tcp=T_world_tcp, opening_m=opening_m), tuple(poses)


def tool_pose(point: Float64Array) -> Pose:
    """The pose of a tool (4,) that points down: x, y, z [m], yaw [rad]."""
    # `geometry.downward`, inlined, because it is called for every waypoint of every candidate.
    half = 0.5 * point[3]
    return Pose(position_m=point[:3].copy(), wxyz=np.array([0.0, np.cos(half), np.sin(half), 0.0]))
