"""Distance of a shape from the usable table, the camera's view and the arm's reach, and the shortest move into them.

Each node is considered separately, without the constraints of the rod. The distance is therefore a lower bound: if it
is above a threshold, no shape within that threshold satisfies the limits.
"""

import math
from collections.abc import Callable

import daqp
import numpy as np

from dlokit import geometry
from dlokit.skills.planning.verdict.feasibility import HANDLED_FROM_M, VIEW_MARGIN_PX, Workplace
from dlokit.types.arrays import Float64Array

_LATTICE_M = 0.02  # grid spacing of the positions at which the arm's reach is tested
_OFF_LATTICE_M = _LATTICE_M / math.sqrt(2.0)  # largest distance of a position from the lattice
_FARTHEST_M = 0.2  # positions farther from a node are not tested
_TURNS = 12  # yaws of the gripper per position; half a turn is another posture of the arm

Inequalities = tuple[Float64Array, Float64Array]
"""(C, 2) and (C,) of ``A x ≤ b``."""


def unreachable_rmse_m(nodes_world: Float64Array, place: Workplace) -> float:
    """Lower bound of the RMSE [m] between a goal (M, 3) [m] and any shape on the table, in view and in reach.

    Infinite if the camera sees no part of the table.
    """
    away_m = np.maximum(_from_seen_table(nodes_world, place), _from_reach(nodes_world, place))
    return float(np.sqrt(np.mean(away_m**2)))


def _from_seen_table(nodes_world: Float64Array, place: Workplace) -> Float64Array:
    """Distance (M,) [m] of each node from the usable and visible part of the table, which is convex."""
    sides, limits = _seen_table(place, float(nodes_world[:, 2].mean()))
    points = nodes_world[:, :2]
    away_m = np.zeros(len(points))
    for node in np.flatnonzero((points @ sides.T > limits).any(axis=1)):
        upper = limits - sides @ points[node]
        step, _, flag, _ = daqp.solve(np.eye(2), np.zeros(2), sides, upper, np.full(len(upper), -1e30))
        away_m[node] = np.linalg.norm(step) if flag > 0 else np.inf
    return away_m


def _seen_table(place: Workplace, height_m: float) -> Inequalities:
    (x0, x1), (y0, y1) = place.config.table_x_m, place.config.table_y_m
    sides = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    limits = np.array([x1, -x0, y1, -y0])
    if place.calibration is None:
        return sides, limits
    camera, margin = place.calibration, VIEW_MARGIN_PX
    corners = np.array([[0.0, 0.0, height_m], [1.0, 0.0, height_m], [0.0, 1.0, height_m]])
    origin, *others = geometry.transform(geometry.inverse(camera.T_world_camera), corners)
    along = np.column_stack([other - origin for other in others])  # (3, 2): camera coordinates a metre of x, y
    # A pixel u is right of the margin where fx X + (cx - margin) Z ≥ 0, which is linear; so are the other borders.
    borders = np.array(
        [
            [-camera.fx_px, 0.0, margin - camera.cx_px],
            [camera.fx_px, 0.0, camera.cx_px - (camera.width_px - 1 - margin)],
            [0.0, -camera.fy_px, margin - camera.cy_px],
            [0.0, camera.fy_px, camera.cy_px - (camera.height_px - 1 - margin)],
        ]
    )
    borders /= np.linalg.norm(borders @ along, axis=1, keepdims=True)
    return np.vstack((sides, borders @ along)), np.concatenate((limits, -borders @ origin))


def _from_reach(nodes_world: Float64Array, place: Workplace) -> Float64Array:
    """Lower bound of the distance (M,) [m] of each node from the arm's reach, for any yaw of the gripper."""
    reached: dict[tuple[int, int], bool] = {}
    offsets = _offsets()

    def at(cell: tuple[int, int]) -> bool:
        if cell not in reached:
            reached[cell] = _reaches(_LATTICE_M * cell[0], _LATTICE_M * cell[1], place)
        return reached[cell]

    def distance_m(x: float, y: float) -> float:
        if _reaches(x, y, place):
            return 0.0
        column, row = round(x / _LATTICE_M), round(y / _LATTICE_M)
        for i, j in offsets:
            if at((column + i, row + j)):
                return _LATTICE_M * math.hypot(i, j)
        return _FARTHEST_M

    away_m = np.array([distance_m(x, y) for x, y in nodes_world[:, :2]])
    # Neither the node nor the edge of the reach need be on the lattice, so both distances to it are subtracted.
    return np.maximum(away_m - 2.0 * _OFF_LATTICE_M - HANDLED_FROM_M, 0.0)


def _offsets() -> list[tuple[int, int]]:
    """Steps on the lattice, the nearest first."""
    most = int(_FARTHEST_M / _LATTICE_M)
    steps = [(i, j) for i in range(-most, most + 1) for j in range(-most, most + 1) if math.hypot(i, j) <= most]
    return sorted(steps, key=lambda step: (math.hypot(*step), step))


def _reaches(x: float, y: float, place: Workplace) -> bool:
    """Whether the gripper reaches a position on the table [m] with any yaw."""
    height_m = place.grasp_height_m
    return any(
        place.reachable(geometry.downward((x, y, height_m), 2.0 * math.pi * turn / _TURNS)) for turn in range(_TURNS)
    )


_STEP_M = 0.01  # distance between two rings of moves
_RINGS = 40
_DIRECTIONS = 16
_HALVINGS = 4  # of the last step, for an accuracy of less than a millimetre


def moved_within_bounds(nodes_world: Float64Array, inside: Callable[[Float64Array], bool]) -> Float64Array | None:
    """A shape (M, 3) [m] after the shortest translation for which `inside` is true; None if none up to 0.4 m is found.

    Translations are tried in rings of 16 directions.
    """
    if inside(nodes_world):
        return nodes_world
    for ring in range(1, _RINGS + 1):
        for turn in range(_DIRECTIONS):
            angle = 2.0 * math.pi * turn / _DIRECTIONS
            direction = np.array([math.cos(angle), math.sin(angle), 0.0])
            if inside(nodes_world + ring * _STEP_M * direction):
                return _shortened(nodes_world, direction, ring * _STEP_M, inside)
    return None


def _shortened(
    nodes_world: Float64Array, direction: Float64Array, far_m: float, inside: Callable[[Float64Array], bool]
) -> Float64Array:
    near_m = far_m - _STEP_M
    for _ in range(_HALVINGS):
        middle_m = (near_m + far_m) / 2.0
        if inside(nodes_world + middle_m * direction):
            far_m = middle_m
        else:
            near_m = middle_m
    return nodes_world + far_m * direction
