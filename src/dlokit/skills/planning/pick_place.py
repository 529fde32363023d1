"""A pick-and-place of one node to its position in the goal, with its path, or the reason why it is invalid."""

import enum
import math

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.rod.rollout import waypoints_of
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.grasp import (
    fitting_openings_m,
    grasp_fraction,
    grasp_pose,
    grasp_yaw,
    rod_point,
    wrapped,
)
from dlokit.types.action import Grasp, PickPlace
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.pose import Pose

_POSE_EVERY_M = 0.03  # largest distance between poses of a carry
_POSE_EVERY_RAD = 0.3  # nor turned further, so that the interpolation follows the intended direction of rotation
_LARGEST_TURN_RAD = 1.6  # largest turn of the gripper during one carry


def carry_path(
    start_world: Float64Array, end_world: Float64Array, yaw_rad: float, turn_rad: float, lift_m: float
) -> tuple[Pose, ...]:
    """Tool poses from above `start_world` (3,) [m] down to `end_world` (3,) [m], turning by `turn_rad` on the carry.

    The carry is `lift_m` above the start [m].
    """
    lift = np.array([0.0, 0.0, lift_m])
    distance = float(np.linalg.norm(end_world - start_world))
    count = max(1, math.ceil(distance / _POSE_EVERY_M), math.ceil(abs(turn_rad) / _POSE_EVERY_RAD))
    carry = [
        geometry.downward(start_world + fraction * (end_world - start_world) + lift, yaw_rad + fraction * turn_rad)
        for fraction in np.linspace(0.0, 1.0, count + 1)
    ]
    return (*carry, geometry.downward(end_world, yaw_rad + turn_rad))


class Invalid(enum.Enum):
    """Why a grasp is not valid (Fig. 6)."""

    GRIPPER_DOES_NOT_FIT = "gripper_does_not_fit"
    OUT_OF_REACH = "out_of_reach"
    NO_ROOM = "no_room_among_fixtures"


def take_to_goal(
    shape: DloState, goal_world: Float64Array, node: int, tools: PlanningTools, *, whole_turn: bool = False
) -> PickPlace | Invalid:
    """The action that carries `node` of `shape` to its position in `goal_world` (M, 3) [m], if it is valid.

    With `whole_turn` the gripper must turn the rod completely to the goal's tangent, otherwise the action is invalid.
    """
    height_m, path = tools.grasp_height_m, tools.actions.path
    nodes = shape.nodes_world
    fraction = grasp_fraction(nodes, node)
    here, there = rod_point(nodes, fraction), rod_point(goal_world, fraction)
    openings_m = tuple(fitting_openings_m(tools.arm.gripper, nodes, here, tools.model.radius_m))
    if not openings_m:
        return Invalid.GRIPPER_DOES_NOT_FIT
    whole = wrapped(there.yaw_rad - here.yaw_rad)
    part = float(np.clip(whole, -_LARGEST_TURN_RAD, _LARGEST_TURN_RAD))
    invalid = Invalid.OUT_OF_REACH
    # A carry with a turn may be out of reach although one without a turn is not.
    for turn_rad in (whole,) if whole_turn else dict.fromkeys((part, 0.0)):
        yaw = grasp_yaw(tools.arm, here, turn_rad, tools.place_m)
        T_world_tcp = grasp_pose(here, yaw, height_m)
        end = np.array([*there.position_world[:2], height_m])
        poses = carry_path(T_world_tcp.position_m, end, yaw, turn_rad, path.lift_m)
        if not all(tools.reachable(pose) for pose in (T_world_tcp, poses[0], poses[-2], poses[-1])):
            continue
        action = PickPlace(
            stamp_ns=shape.stamp_ns,
            grasp=Grasp(node=node, T_world_tcp=T_world_tcp, opening_m=openings_m[0]),
            path=poses,
            velocity=path.velocity(path.speed_m_s),
        )
        opening_m = tools.room.opening_m(waypoints_of(action), openings_m)
        if opening_m is not None:
            return msgspec.structs.replace(action, grasp=msgspec.structs.replace(action.grasp, opening_m=opening_m))
        invalid = Invalid.NO_ROOM
    return invalid


def goal_in_order(nodes_world: Float64Array, goal_world: Float64Array, *, ends_interchangeable: bool) -> Float64Array:
    """The goal (M, 3) [m] in the order that is nearer to the shape (M, 3), where its ends may be exchanged."""
    if ends_interchangeable and geometry.rmse_m(nodes_world, goal_world[::-1]) < geometry.rmse_m(
        nodes_world, goal_world
    ):
        return goal_world[::-1]
    return goal_world
