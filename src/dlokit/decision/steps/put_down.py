"""How a hand lays what it holds on the table: a DLO that is let go in the air falls into a heap across itself."""

import math
from collections.abc import Sequence

import numpy as np

from dlokit import geometry
from dlokit.description.clearance import clear_of
from dlokit.description.scene import Fixture
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

VELOCITY = VelocityProfile(speed_m_s=0.15, acceleration_m_s2=0.6, jerk_m_s3=6.0)
"""As slow as a lay-down, so that what hangs does not swing."""

_IN_HAND_M = 0.03
"""Largest distance of a tool from the node that it holds [m]; farther, the shape is not that of the held DLO."""
_LIES_M = 0.01
"""Largest height above the lowest node of a node that lies on the table [m]."""
_END_NODES = 4
"""Nodes next to an end that may hang behind the held one: the DLO hangs on one side of the hand only."""
_APART_M = 0.03
"""Smallest distance of the part that is laid from the part that lies already, fixtures, and the table's border [m]."""
_MOST_RAD = math.pi / 2.0
"""Largest turn of the hand [rad]: a symmetric gripper would go round the other way."""
_TURNS_RAD = np.radians([0.0, 20.0, -20.0, 40.0, -40.0, 60.0, -60.0, 90.0, -90.0])
"""Directions in which the hanging part is laid, against that in which the DLO leaves the table; best first."""


def paths_down(
    nodes_world: Float64Array, T_world_tcp: Pose, fixtures: Sequence[Fixture] = ()
) -> tuple[tuple[Pose, ...], ...]:
    """Paths of a tool after which what it holds is on the table, best first.

    A DLO held near an end is laid out straight: on from where it leaves the table, not across what lies and stands
    there and within the part of the table where DLOs lie; or, where it leaves no room for that, along the middle of
    that part, if no fixture stands there. The last path is straight down. `nodes_world` (M, 3) [m] is the shape with
    the held part. Empty if the tool is not at the DLO, or what it holds is on the table.
    """
    distance_m = np.linalg.norm(nodes_world - T_world_tcp.position_m, axis=1)
    held, rest_m = int(distance_m.argmin()), float(nodes_world[:, 2].min())
    drop_m = float(nodes_world[held, 2]) - rest_m
    if distance_m[held] > _IN_HAND_M or drop_m < _LIES_M:
        return ()
    straight_down = (geometry.lifted(T_world_tcp, -drop_m),)
    # From the end that lies on the table to the one in the hand.
    nodes = nodes_world if held >= len(nodes_world) / 2.0 else nodes_world[::-1]
    held = max(held, len(nodes) - 1 - held)
    if held < len(nodes) - 1 - _END_NODES:
        return (straight_down,)
    return (
        *_straight_on(nodes[: held + 1], rest_m, T_world_tcp, drop_m, fixtures),
        *_along_the_middle(nodes[: held + 1], rest_m, T_world_tcp, drop_m, fixtures),
        straight_down,
    )


def _straight_on(
    nodes: Float64Array, rest_m: float, T_world_tcp: Pose, drop_m: float, fixtures: Sequence[Fixture]
) -> list[tuple[Pose, ...]]:
    """Paths that lay the hanging part of nodes (K, 3), of which the last is held, on from the part that lies."""
    lies = np.flatnonzero(nodes[:, 2] < rest_m + _LIES_M)
    if len(lies) < 2:
        return []
    last = int(lies[-1])
    hanging_m = float(geometry.arc_lengths(nodes[last:])[-1])
    leaves_rad = _heading(nodes[last] - nodes[max(last - 2, 0)])
    paths = list[tuple[Pose, ...]]()
    for turn in _TURNS_RAD:
        along = _direction(leaves_rad + float(turn))
        end_xy = nodes[last, :2] + hanging_m * along
        laid = np.array([nodes[last], [*end_xy, rest_m]])
        if _is_usable(end_xy) and _is_free(nodes[lies, :2], along, hanging_m) and clear_of(laid, fixtures, _APART_M):
            paths.append((_laid(nodes, T_world_tcp, drop_m, end_xy, along),))
    return paths


def _along_the_middle(
    nodes: Float64Array, rest_m: float, T_world_tcp: Pose, drop_m: float, fixtures: Sequence[Fixture]
) -> list[tuple[Pose, ...]]:
    """The path over the nearer side of the table, and from there across its middle; what lies follows."""
    middle = np.array([np.mean(TABLE_X_M), np.mean(TABLE_Y_M)])
    length_m = min(float(geometry.arc_lengths(nodes)[-1]), TABLE_Y_M[1] - TABLE_Y_M[0] - 2.0 * _APART_M)
    along = np.array([0.0, -math.copysign(1.0, T_world_tcp.position_m[1] - middle[1])])
    begin_xy, end_xy = middle - 0.5 * length_m * along, middle + 0.5 * length_m * along
    if not clear_of([[*begin_xy, rest_m], [*end_xy, rest_m]], fixtures, _APART_M):
        return []
    begin = geometry.pose(np.array([*begin_xy, T_world_tcp.position_m[2]]), T_world_tcp.wxyz)
    return [(begin, _laid(nodes, T_world_tcp, drop_m, end_xy, along))]


def _laid(nodes: Float64Array, T_world_tcp: Pose, drop_m: float, end_xy: Float64Array, along: Float64Array) -> Pose:
    """The tool at the end of a DLO that lies in a direction; the hand is turned with what it holds, the last node."""
    position = np.array([*end_xy, T_world_tcp.position_m[2] - drop_m])
    turn = math.remainder(_heading(along) - _heading(nodes[-1] - nodes[-2]), 2.0 * math.pi)
    R = geometry.rotation(T_world_tcp)
    return geometry.downward(position, math.atan2(R[1, 0], R[0, 0]) + min(max(turn, -_MOST_RAD), _MOST_RAD))


def _is_usable(place_xy: Float64Array) -> bool:
    """Whether a place is on the part of the table where DLOs lie."""
    sides = zip(place_xy, (TABLE_X_M, TABLE_Y_M), strict=True)
    return all(low + _APART_M <= value <= high - _APART_M for value, (low, high) in sides)


def _is_free(lies_xy: Float64Array, along: Float64Array, length_m: float) -> bool:
    """Whether a part of a length, laid on from the last of the places (K, 2) [m], keeps apart from the others."""
    end = lies_xy[-1]
    distances = np.linspace(_APART_M, length_m + _APART_M, max(2, math.ceil(length_m / _APART_M) + 1))
    laid = end + distances[:, None] * along
    others = lies_xy[np.linalg.norm(lies_xy - end, axis=1) > _APART_M]
    return bool(np.linalg.norm(laid[:, None] - others[None], axis=-1).min(initial=math.inf) > _APART_M)


def _heading(direction: Float64Array) -> float:
    return math.atan2(direction[1], direction[0])


def _direction(heading_rad: float) -> Float64Array:
    return np.array([math.cos(heading_rad), math.sin(heading_rad)])
