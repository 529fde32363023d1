"""Push: closed fingers descend beside the rod and move it over the table; for small corrections, and where no
gripper fits around the rod.
"""

import itertools
import math

import numpy as np

from dlokit import geometry
from dlokit.skills.planning.grasp import CLEARANCE_M, SAMPLE_M, RodPoint, rod_point, wrapped
from dlokit.skills.planning.rollout.candidates import Candidate, NodeToGoal, PlanningScene
from dlokit.types.action import Action, Push
from dlokit.types.arrays import Float64Array

_FROM_END_M = 0.04  # nearer to an end the rod slips off the fingers
_STEEPEST_RAD = 1.0  # largest angle from straight across the rod; at a larger one the fingers slide along it
_SPEED_M_S = (0.05, 0.3)
_OFFSET_M = (0.004, 0.05)
_LONGEST_M = 0.25
_LARGEST_YAW_RAD = 0.9
_USUAL_OFFSET_M = 0.006
_OVERSHOOTS = (0.0, 0.15)
_USUAL_SPEED_M_S = 0.15


class Pushing:
    """Parameters: position on the rod (fraction of its length), direction (from its left normal) [rad], offset of
    the fingers before they touch [m], length of the push [m], yaw of the fingers from the direction [rad], bow, speed.

    A direction beyond a quarter turn pushes to the right. The bow is the distance of the path's middle from the
    straight line, as a fraction of its length.
    """

    kind: type[Action] = Push

    def __init__(self, scene: PlanningScene) -> None:
        self._scene = scene
        nodes = scene.nodes_world
        self._rod = geometry.resample(nodes, int(geometry.arc_lengths(nodes)[-1] / SAMPLE_M) + 2)[:, :2]

    @property
    def spread(self) -> Float64Array:
        """Spread of the numbers."""
        return np.array([0.05, 0.25, 0.004, 0.012, 0.2, 0.1, 0.04])

    def first(self, count: int, rng: np.random.Generator) -> list[Float64Array]:
        """Nodes along the whole rod pushed to their goals, across the rod; then the same with an overshoot."""
        scene = self._scene
        found: list[Float64Array] = []
        for more, node in itertools.product(_OVERSHOOTS, scene.nodes_to_move):
            fraction = node / (scene.count - 1)
            to_goal = (scene.goal_world - scene.nodes_world)[node, :2]
            across = rod_point(scene.nodes_world, fraction).yaw_rad + 0.5 * math.pi
            aside = float(to_goal @ np.array([math.cos(across), math.sin(across)]))
            direction, length = (0.0 if aside > 0.0 else math.pi), (1.0 + more) * abs(aside)
            found.append(np.array([fraction, direction, _USUAL_OFFSET_M, length, 0.0, 0.0, _USUAL_SPEED_M_S]))
        return found[:count]

    def make(self, numbers: Float64Array) -> Candidate | None:
        """The candidate of these numbers; None where the fingers would slide along the rod or descend onto it."""
        scene = self._scene
        inset = min(_FROM_END_M / scene.length_m, 0.5)
        fraction, offset, length = min(max(float(numbers[0]), inset), 1.0 - inset), float(numbers[2]), float(numbers[3])
        offset, length = min(max(offset, _OFFSET_M[0]), _OFFSET_M[1]), min(length, _LONGEST_M)
        node, direction = round(fraction * (scene.count - 1)), wrapped(float(numbers[1]))
        steepness = abs(direction) if abs(direction) < 0.5 * math.pi else math.pi - abs(direction)
        if length <= 0.0 or node in scene.marked or steepness > _STEEPEST_RAD:
            return None
        here, there = rod_point(scene.nodes_world, fraction), rod_point(scene.goal_world, fraction)
        yaw = min(max(float(numbers[4]), -_LARGEST_YAW_RAD), _LARGEST_YAW_RAD)
        bow, speed = min(max(float(numbers[5]), -0.3), 0.3), min(max(float(numbers[6]), _SPEED_M_S[0]), _SPEED_M_S[1])
        tool = self._tool(here, direction, offset, length, yaw, bow)
        if not self._free(tool[0]):
            return None
        clean = np.array([fraction, direction, offset, length, yaw, bow, speed])
        hold = NodeToGoal(node=node, here=here, there=there, openings_m=(0.0,))
        return scene.candidate(self.kind, clean, hold, tool, scene.tools.actions.path.velocity(speed))

    def aimed(self, numbers: Float64Array, nodes_world: Float64Array) -> Float64Array:
        """The length, corrected by the remaining distance of the pushed node from its goal."""
        fraction, direction = float(numbers[0]), float(numbers[1])
        node = round(fraction * (self._scene.count - 1))
        ahead = self._ahead(rod_point(self._scene.nodes_world, fraction), direction)
        corrected = numbers.copy()
        corrected[3] += float((self._scene.goal_world - nodes_world)[node, :2] @ ahead)
        return corrected

    @staticmethod
    def _ahead(here: RodPoint, direction: float) -> Float64Array:
        """Unit vector of the push in the table plane (2,)."""
        heading = here.yaw_rad + 0.5 * math.pi + direction
        return np.array([math.cos(heading), math.sin(heading)])

    def _tool(
        self, here: RodPoint, direction: float, offset: float, length: float, yaw: float, bow: float
    ) -> Float64Array:
        """Waypoints (3, 4): beside the rod, half the distance, and the end of the push."""
        ahead = self._ahead(here, direction)
        heading = math.atan2(ahead[1], ahead[0])
        tool = np.empty((3, 4))
        tool[:, 2], tool[:, 3] = self._scene.tools.grasp_height_m, self._comfortable(heading + yaw, here)
        # From the middle of the fingers to the rod, along the path: a slanting rod is touched later.
        radii_m = self._scene.closed_fingers[1] + self._scene.tools.model.radius_m
        gap = (radii_m + offset) / math.cos(_across(direction))
        tool[0, :2] = here.position_world[:2] - gap * ahead
        tool[2, :2] = tool[0, :2] + (offset / math.cos(_across(direction)) + length) * ahead
        tool[1, :2] = 0.5 * (tool[0, :2] + tool[2, :2]) + bow * length * np.array([-ahead[1], ahead[0]])
        return tool

    def _comfortable(self, yaw_rad: float, here: RodPoint) -> float:
        """The yaw, or the yaw plus half a turn if the wrist then has more room [rad]."""
        tools = self._scene.tools
        x, y = here.position_world[:2] - np.array(tools.place_m)
        middle = math.atan2(y, x) + tools.arm.roomiest_yaw_rad
        return middle + (wrapped(2.0 * (yaw_rad - middle)) / 2.0)

    def _free(self, tool: Float64Array) -> bool:
        """Whether the closed fingers descend onto no part of the rod."""
        half_line_m, radius_m, _ = self._scene.closed_fingers
        line = np.array([math.sin(tool[3]), -math.cos(tool[3])])
        offsets = self._rod - tool[:2]
        along = np.clip(offsets @ line, -half_line_m, half_line_m)
        nearest_m = np.linalg.norm(offsets - along[:, None] * line, axis=1).min()
        return bool(nearest_m > radius_m + self._scene.tools.model.radius_m + CLEARANCE_M)


def _across(direction_rad: float) -> float:
    """Angle between a direction and the normal of the rod, to either side [rad]."""
    return wrapped(2.0 * direction_rad) / 2.0
