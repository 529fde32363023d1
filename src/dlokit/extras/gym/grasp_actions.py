"""The action space of `dlokit/Shape-v0`: a vector of numbers in -1 to 1 encodes one action from grasp to release."""

import itertools
import math
from typing import Literal, get_args

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.errors import ConfigError
from dlokit.rod.rollout import waypoints_of
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.grasp import (
    END_INSET_M,
    RodPoint,
    fitting_opening_m,
    grasp_fraction,
    grasp_pose,
    grasp_yaw,
    rod_point,
)
from dlokit.skills.planning.pick_place import Invalid
from dlokit.types.action import Action, Drag, Grasp, PickPlace, VelocityProfile
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.pose import Pose

GraspBy = Literal["node", "place"]
"""Encoding of the grasp: the position along the DLO, or a place on the table."""
PathBy = Literal["carry", "poses"]
"""Encoding of the path: the numbers of a carry, or the poses of the tool."""

BESIDE = "beside_the_dlo"
"""Reason of the refusal of a grasp at a place without the DLO."""
POSES = 10
"""Number of poses of a path: the corners of the longest path of dlokit's planners."""
_BESIDE_M = 0.03  # at a place farther from the DLO than this, it is not between the open fingers
_AT_NODE_M = 1e-4  # a grasp nearer to its node than this is at the node
_MARGIN_M = 0.1  # the tool may leave the usable table by this: it leads where the last end is laid down
_HIGHEST_CARRY_M = 0.25  # of a carry; the DLO hangs from higher paths, as in lay-downs
_LARGEST_LIFT = 0.9  # of a path of poses, as a fraction of the DLO's length
_BOW = 0.5
_SPEED_M_S = (0.1, 0.5)
_GENTLE = (0.6, 6.0)  # acceleration [m/s²] and jerk [m/s³] with which a hanging DLO does not swing
_ON_TABLE_M = 0.01  # a path that stays below this drags the DLO over the table
_YAW_M = 0.1  # metres per radian of yaw when a path is simplified
_POSE_EVERY_RAD = 0.3  # largest turn between two poses, so that the interpolation turns the intended displacement
_SAME = 1e-5  # corners that are nearer [m, rad] are one

Path = Float64Array
"""A path of the tool (W, 4): x, y [m], height over the grasp [m], turn since the grasp [rad]."""


class GraspActions:
    """Converts vectors to actions and back.

    A vector is the grasp, the path, and the speed of the tool; each number goes from -1 to 1.

    grasp ``"node"``: the position along the observed DLO, from its first end to its last.
    grasp ``"place"``: x, y on the table; the nearest point of the DLO is grasped, the fingers across it.
    path ``"carry"``: x, y of the release, turn of the gripper (±pi), lift (0 to 25 cm), and bow, the distance of the
    path's middle from the straight line as a fraction (±0.5) of its length.
    path ``"poses"``: ten times x, y, height over the grasp (0 to 0.9 of the DLO's length) and turn since the grasp
    (±pi) of the tool; the last is the release, and equal ones count once.
    speed: 0.1 to 0.5 m/s.
    """

    def __init__(
        self,
        grasp: GraspBy,
        path: PathBy,
        *,
        table_x_m: tuple[float, float],
        table_y_m: tuple[float, float],
        length_m: float,
    ) -> None:
        """`table_x_m` and `table_y_m` are the usable table, `length_m` the length of the DLO [m]."""
        for argument, value, allowed in (("grasp", grasp, get_args(GraspBy)), ("path", path, get_args(PathBy))):
            if value not in allowed:
                raise ConfigError(f"{argument} is {value!r}; allowed are {' and '.join(allowed)}.")
        self._grasp, self._path = grasp, path
        self._low = np.array([table_x_m[0], table_y_m[0]]) - _MARGIN_M
        self._high = np.array([table_x_m[1], table_y_m[1]]) + _MARGIN_M
        self._lift_m = _LARGEST_LIFT * length_m if path == "poses" else _HIGHEST_CARRY_M
        size = (1 if grasp == "node" else 2) + (4 * POSES if path == "poses" else 5) + 1
        self.space = spaces.Box(-1.0, 1.0, (size,), np.float32)
        """The action space."""

    def decode(self, vector: Float32Array, nodes_world: Float64Array, tools: PlanningTools) -> Action | str:
        """The action that a vector (D,) encodes, at a DLO (M, 3) [m]; or why gripper or arm cannot execute it."""
        numbers = np.clip(np.asarray(vector, dtype=np.float64), -1.0, 1.0)
        at = 1 if self._grasp == "node" else 2
        if self._grasp == "node":
            fraction = 0.5 * (numbers[0] + 1.0)
        else:
            fraction, beside_m = nearest_fraction(nodes_world, self._place(numbers[:2]))
            if beside_m > _BESIDE_M:
                return BESIDE
        here, node = _inner_point(nodes_world, fraction)
        opening_m = fitting_opening_m(tools.arm.gripper, nodes_world, here, tools.model.radius_m)
        if opening_m is None:
            return Invalid.GRIPPER_DOES_NOT_FIT.value
        path = self._poses(numbers[at:-1]) if self._path == "poses" else self._carry(numbers[at:-1], here)
        yaw = grasp_yaw(tools.arm, here, float(path[-1, 3]), tools.place_m)
        height_m = tools.grasp_height_m
        T_world_tcp = grasp_pose(here, yaw, height_m)
        first = np.array([*here.position_world[:2], 0.0, 0.0])
        poses = tuple(_tool(point, yaw, height_m) for point in _subdivided(np.vstack((first, path))))
        if not all(tools.reachable(pose) for pose in (T_world_tcp, *poses)):
            return Invalid.OUT_OF_REACH.value
        kind = Drag if path[:, 2].max() < _ON_TABLE_M else PickPlace
        return kind(
            stamp_ns=0,
            grasp=Grasp(node=node, T_world_tcp=T_world_tcp, opening_m=opening_m),
            path=poses,
            velocity=_velocity(_between(numbers[-1], *_SPEED_M_S), path, tools),
        )

    def encode(self, action: Action, nodes_world: Float64Array) -> Float32Array:
        """The vector (D,) that encodes `action` at a DLO (M, 3) [m] best."""
        tool = waypoints_of(action)
        path = tool[1:] - np.array([0.0, 0.0, tool[0, 2], tool[0, 3]])
        fraction = _fraction_of(action.grasp.node, nodes_world, tool[0, :2])
        grasp = [2.0 * fraction - 1.0] if self._grasp == "node" else self.number_of(tool[0, :2])
        numbers = (
            self._of_poses(_simplified(tool[0], path, POSES))
            if self._path == "poses"
            else self._of_carry(tool[0, :2], path)
        )
        speed = _number(action.velocity.speed_m_s, *_SPEED_M_S)
        return np.clip(np.concatenate((grasp, numbers, [speed])), -1.0, 1.0).astype(np.float32)

    def _place(self, numbers: Float64Array) -> Float64Array:
        return self._low + 0.5 * (numbers + 1.0) * (self._high - self._low)

    def number_of(self, place_m: ArrayLike) -> Float64Array:
        """The action's numbers (…, 2) for places (…, 2) [m] on the table."""
        return 2.0 * (np.asarray(place_m, dtype=np.float64) - self._low) / (self._high - self._low) - 1.0

    def _poses(self, numbers: Float64Array) -> Path:
        rows = numbers.reshape(POSES, 4)
        height_m = 0.5 * (rows[:, 2] + 1.0) * self._lift_m
        path = np.column_stack((self._place(rows[:, :2]), height_m, math.pi * rows[:, 3]))
        new = np.abs(np.diff(path, axis=0)).max(axis=1) > _SAME
        return path[np.concatenate(([True], new))]

    def _of_poses(self, path: Path) -> Float64Array:
        filled = np.vstack((path, np.repeat(path[-1:], POSES - len(path), axis=0)))
        heights = 2.0 * filled[:, 2] / self._lift_m - 1.0
        return np.column_stack((self.number_of(filled[:, :2]), heights, filled[:, 3] / math.pi)).ravel()

    def _carry(self, numbers: Float64Array, here: RodPoint) -> Path:
        x, y = self._place(numbers[:2])
        turn, lift_m = math.pi * numbers[2], _between(numbers[3], 0.0, self._lift_m)
        first, last = np.array([*here.position_world[:2], 0.0, 0.0]), np.array([x, y, 0.0, turn])
        up, displacement = np.array([0.0, 0.0, lift_m, 0.0]), last - first
        across = np.array([-displacement[1], displacement[0], 0.0, 0.0])
        middle = first + 0.5 * displacement + _BOW * numbers[4] * across
        return np.stack((first + up, middle + up, last + up, last))

    def _of_carry(self, start_m: Float64Array, path: Path) -> Float64Array:
        last = path[-1]
        displacement = last[:2] - start_m
        length_m = float(np.hypot(*displacement))
        across = np.array([-displacement[1], displacement[0]]) / max(length_m, 1e-9)
        beside_m = (path[:, :2] - start_m) @ across
        bow = beside_m[np.argmax(np.abs(beside_m))] / max(length_m, 1e-9)
        lift = _number(float(path[:, 2].max()), 0.0, self._lift_m)
        return np.array([*self.number_of(last[:2]), last[3] / math.pi, lift, bow / _BOW])


def nearest_fraction(nodes_world: Float64Array, place_m: Float64Array) -> tuple[float, float]:
    """Position along a DLO (M, 3) [m] nearest to a place (2,) [m], as a fraction of its length; and distance [m]."""
    lengths, starts = geometry.arc_lengths(nodes_world), nodes_world[:-1, :2]
    edges = np.diff(nodes_world[:, :2], axis=0)
    along = np.sum((place_m - starts) * edges, axis=1) / np.maximum(np.sum(edges**2, axis=1), 1e-12)
    along = np.clip(along, 0.0, 1.0)
    away_m = np.linalg.norm(starts + along[:, None] * edges - place_m, axis=1)
    edge = int(np.argmin(away_m))
    s = lengths[edge] + along[edge] * (lengths[edge + 1] - lengths[edge])
    return float(s / lengths[-1]), float(away_m[edge])


def _fraction_of(node: int, nodes_world: Float64Array, place_m: Float64Array) -> float:
    """Position along a DLO (M, 3) [m] of a grasp of a node at a place (2,) [m], as a fraction of its length.

    It is the position of the node if the grasp is at the node or was moved inwards from an end.
    """
    fraction, _ = nearest_fraction(nodes_world, place_m)
    lengths = geometry.arc_lengths(nodes_world)
    if abs(fraction - grasp_fraction(nodes_world, node)) * lengths[-1] < _AT_NODE_M:
        return float(lengths[node] / lengths[-1])
    return fraction


def _inner_point(nodes_world: Float64Array, fraction: float) -> tuple[RodPoint, int]:
    """The point of a DLO (M, 3) [m] at a fraction of its length, away from the ends; and its nearest node."""
    lengths = geometry.arc_lengths(nodes_world)
    node = int(np.argmin(np.abs(lengths - fraction * lengths[-1])))
    inset = min(END_INSET_M / lengths[-1], 0.5)
    return rod_point(nodes_world, float(np.clip(fraction, inset, 1.0 - inset))), node


def _velocity(speed_m_s: float, path: Path, tools: PlanningTools) -> VelocityProfile:
    pace = tools.actions.path
    acceleration, jerk = pace.acceleration_m_s2, pace.jerk_m_s3
    if path[:, 2].max() > _HIGHEST_CARRY_M + _SAME:
        acceleration, jerk = min(acceleration, _GENTLE[0]), min(jerk, _GENTLE[1])
    return VelocityProfile(speed_m_s=speed_m_s, acceleration_m_s2=acceleration, jerk_m_s3=jerk)


def _tool(point: Float64Array, yaw_rad: float, height_m: float) -> Pose:
    x, y, above_m, turn_rad = (float(number) for number in point)
    return geometry.downward((x, y, height_m + above_m), yaw_rad + turn_rad)


def _subdivided(path: Path) -> Path:
    """The path after its first point, with enough poses that no turn between two exceeds the limit."""
    points: list[Float64Array] = []
    for start, end in itertools.pairwise(path):
        count = max(1, math.ceil(abs(end[3] - start[3]) / _POSE_EVERY_RAD))
        points += [start + fraction * (end - start) for fraction in np.linspace(0.0, 1.0, count + 1)[1:]]
    return np.array(points)


def _simplified(start: Float64Array, path: Path, most: int) -> Path:
    """At most `most` points of a path; the points whose removal changes it least are removed, never the last."""
    scale = np.array([1.0, 1.0, 1.0, _YAW_M])
    origin = np.array([start[0], start[1], 0.0, 0.0])
    kept = list(path)
    while len(kept) > most:
        corners = [origin, *kept]
        change = [
            _distance(scale * corners[k], scale * corners[k - 1], scale * corners[k + 1])
            for k in range(1, len(corners) - 1)
        ]
        kept.pop(int(np.argmin(change)))
    return np.array(kept)


def _distance(point: Float64Array, start: Float64Array, end: Float64Array) -> float:
    """Distance of a point from a straight piece, all (4,)."""
    displacement = end - start
    fraction = np.clip((point - start) @ displacement / max(float(displacement @ displacement), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(start + fraction * displacement - point))


def _between(number: float, low: float, high: float) -> float:
    return low + 0.5 * (float(number) + 1.0) * (high - low)


def _number(value: float, low: float, high: float) -> float:
    return 2.0 * (value - low) / (high - low) - 1.0
