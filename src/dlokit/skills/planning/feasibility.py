"""Whether a start or goal shape can be worked with: named findings that say what is wrong and where."""

from collections.abc import Iterator

import numpy as np

from dlokit import geometry
from dlokit.skills.planning.actions import FeasibilityConfig, GraspConfig
from dlokit.skills.planning.base import Reachable
from dlokit.skills.planning.grasp import grasp_pose, grasp_yaw, rod_point
from dlokit.types.arrays import Float64Array
from dlokit.types.feasibility import Finding, Problem, Verdict
from dlokit.types.image import CameraCalibration


def check_start(
    nodes_world: Float64Array,
    config: FeasibilityConfig,
    grasp: GraspConfig,
    reachable: Reachable,
    calibration: CameraCalibration | None,
) -> Verdict:
    """Whether a rod lying as `nodes_world` (M, 3) [m] can be shaped at all; no `calibration`: views are not checked."""
    found = _on_table(nodes_world, config), _in_reach(nodes_world, grasp, reachable)
    seen = _in_view(nodes_world, config, calibration)
    return _verdict(*found, seen, _crossing(nodes_world))


def check_goal(
    nodes_world: Float64Array,
    config: FeasibilityConfig,
    grasp: GraspConfig,
    reachable: Reachable,
    calibration: CameraCalibration | None,
) -> Verdict:
    """Whether `nodes_world` (M, 3) [m] can be a goal: all that a start must keep to, and no bend too tight."""
    verdict = check_start(nodes_world, config, grasp, reachable, calibration)
    bend = _bend(nodes_world, config)
    return verdict if bend is None else Verdict(findings=(*verdict.findings, bend))


def _verdict(*findings: Finding | None) -> Verdict:
    return Verdict(findings=tuple(finding for finding in findings if finding is not None))


def _place(nodes_world: Float64Array, node: int) -> str:
    x, y = nodes_world[node, :2]
    return f"node {node} at ({x:.3f}, {y:.3f}) m"


def _on_table(nodes_world: Float64Array, config: FeasibilityConfig) -> Finding | None:
    (x0, x1), (y0, y1) = config.table_x_m, config.table_y_m
    lower, upper = np.array([x0, y0]), np.array([x1, y1])
    outside = np.maximum(lower - nodes_world[:, :2], nodes_world[:, :2] - upper).max(axis=1)  # (M,) [m]
    node = int(outside.argmax())
    if outside[node] <= 0.0:
        return None
    return Finding(
        problem=Problem.OFF_TABLE,
        node=node,
        text=f"The shape is off the table: {_place(nodes_world, node)} lies {outside[node]:.3f} m outside; allowed "
        f"is x {x0:.2f} to {x1:.2f} m, y {y0:.2f} to {y1:.2f} m. Move the shape.",
    )


def _in_reach(nodes_world: Float64Array, grasp: GraspConfig, reachable: Reachable) -> Finding | None:
    last = len(nodes_world) - 1
    for node in range(last + 1):
        point = rod_point(nodes_world, node / last)
        yaw = grasp_yaw(point, 0.0, grasp)
        # A grasp may take the rod from either side; one that the arm reaches is enough.
        if not any(reachable(grasp_pose(point, yaw + turn, grasp)) for turn in (0.0, np.pi, -np.pi)):
            return Finding(
                problem=Problem.OUT_OF_REACH,
                node=node,
                text=f"The shape is out of the arm's reach: it cannot grasp {_place(nodes_world, node)}, across a rod "
                f"that points to {np.degrees(point.yaw_rad):.0f}°. Move the shape towards (0.52, 0) m.",
            )
    return None


def _in_view(
    nodes_world: Float64Array, config: FeasibilityConfig, calibration: CameraCalibration | None
) -> Finding | None:
    if calibration is None:
        return None
    camera = geometry.transform(geometry.inverse(calibration.T_world_camera), nodes_world)  # x right, y down, z forward
    depth = np.maximum(camera[:, 2], 1e-6)
    u = calibration.fx_px * camera[:, 0] / depth + calibration.cx_px
    v = calibration.fy_px * camera[:, 1] / depth + calibration.cy_px
    width, height = calibration.width_px, calibration.height_px
    outside_px = np.max([-u, u - (width - 1), -v, v - (height - 1)], axis=0) + config.view_margin_px
    outside_px[camera[:, 2] <= 0.0] = np.inf
    node = int(outside_px.argmax())
    if outside_px[node] <= 0.0:
        return None
    return Finding(
        problem=Problem.OUT_OF_VIEW,
        node=node,
        text=f"The shape is out of the camera's view: {_place(nodes_world, node)} projects to pixel "
        f"({u[node]:.0f}, {v[node]:.0f}); the picture is {width} x {height} with a margin of "
        f"{config.view_margin_px:.0f}. Move the shape or the camera.",
    )


def _bend(nodes_world: Float64Array, config: FeasibilityConfig) -> Finding | None:
    edges = np.diff(nodes_world[:, :2], axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    headings = np.arctan2(edges[:, 1], edges[:, 0])
    turns = np.abs((np.diff(headings) + np.pi) % (2.0 * np.pi) - np.pi)  # (M - 2,) [rad]
    radii = (lengths[:-1] + lengths[1:]) / 2.0 / np.maximum(turns, 1e-9)
    node = int(radii.argmin()) + 1
    if radii[node - 1] >= config.min_bend_radius_m:
        return None
    return Finding(
        problem=Problem.BENDS_TOO_TIGHTLY,
        node=node,
        text=f"The shape bends too tightly: the radius is {radii[node - 1]:.3f} m at {_place(nodes_world, node)}; "
        f"at least {config.min_bend_radius_m:.3f} m is allowed. Use a smoother shape.",
    )


def _crossing(nodes_world: Float64Array) -> Finding | None:
    for first, second in _crossings(nodes_world[:, :2]):
        return Finding(
            problem=Problem.CROSSES_ITSELF,
            node=first,
            text=f"The DLO lies across itself: between {_place(nodes_world, first)} and the next it crosses "
            f"the part after node {second}. Only shapes that do not cross themselves are allowed; lay it open.",
        )
    return None


def _crossings(nodes: Float64Array) -> Iterator[tuple[int, int]]:
    """Pairs of edges (M, 2) that cross, by their first nodes; neighbouring edges only touch and do not count."""
    start, along = nodes[:-1], np.diff(nodes, axis=0)
    for first in range(len(start) - 2):
        later = slice(first + 2, None)
        offset = start[later] - start[first]
        area = _cross(along[first], along[later])
        with np.errstate(divide="ignore", invalid="ignore"):
            here = _cross(offset, along[later]) / area
            there = _cross(offset, along[first]) / area
        hits = np.flatnonzero((here > 0.0) & (here < 1.0) & (there > 0.0) & (there < 1.0))
        for hit in hits:
            yield first, first + 2 + int(hit)


def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
