"""The scene: table, fixtures, robot, camera and the estimates of the DLO, each layer in its colour."""

from collections.abc import Sequence

import cv2
import numpy as np
import viser
from numpy.typing import NDArray

from dlokit import geometry
from dlokit.description.scene import Fixture, Scene
from dlokit.description.table import TABLE_THICKNESS_M, TABLE_X_M, TABLE_Y_M, Table
from dlokit.geometry.camera import project
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.fixture_figures import add_fixtures
from dlokit.skills.viewer.labels import Labels
from dlokit.skills.viewer.palette import Layer
from dlokit.skills.viewer.robot_figure import GripperGhost, RobotFigure, place
from dlokit.skills.viewer.viewpoint import fit_each_visitor
from dlokit.types.action import Action, Candidates
from dlokit.types.arrays import Float32Array, Float64Array, Int64Array, UInt8Array
from dlokit.types.dlo import DloState, GoalShape, TargetPoints
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.observation import Observation
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState


def tube_vertices(nodes: Float64Array, radius_m: float, sides: int) -> Float32Array:
    """Vertices (K * sides + 2, 3) [m] of a tube around the polyline `nodes` (K, 3) [m]: rings, then both ends.

    Each ring is turned as little as possible against the previous one, so that the tube is not twisted.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])  # (sides, 2)
    directions = geometry.tangents(nodes)
    normal = _any_normal(directions[0])
    rings = np.empty((len(nodes), sides, 3))
    for index, (node, direction) in enumerate(zip(nodes, directions, strict=True)):
        normal = normal - np.dot(normal, direction) * direction
        length = np.linalg.norm(normal)
        normal = normal / length if length > 1e-6 else _any_normal(direction)
        basis = np.stack([normal, np.cross(direction, normal)])  # (2, 3)
        rings[index] = node + radius_m * circle @ basis
    return np.concatenate([rings.reshape(-1, 3), nodes[[0, -1]]]).astype(np.float32)


def tube_faces(count: int, sides: int) -> Int64Array:
    """Triangles (2 * count * sides, 3) over `tube_vertices` of `count` nodes, closed, facing outwards."""
    ring = np.arange(sides)
    following = (ring + 1) % sides
    start = (np.arange(count - 1) * sides)[:, None]
    a, b, c, d = start + ring, start + following, start + sides + ring, start + sides + following
    walls = np.concatenate([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)]).reshape(-1, 3)
    first, last = count * sides, count * sides + 1
    end = (count - 1) * sides
    caps = np.concatenate(
        [
            np.column_stack([np.full(sides, first), following, ring]),
            np.column_stack([np.full(sides, last), end + ring, end + following]),
        ]
    )
    return np.concatenate([walls, caps])


def _any_normal(direction: Float64Array) -> Float64Array:
    """A unit vector (3,) across `direction` (3,)."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(direction))] = 1.0
    across: Float64Array = np.cross(direction, axis)
    return across / max(float(np.linalg.norm(across)), 1e-12)


_TUBE_SIDES = 10
_SPRINGS_M = 0.004
"""Least spring-back (RMSE) that is shown [m]: the radius of the default rope."""


class ViewerScene:
    """The three-dimensional part of the page. Layers appear with their first message."""

    def __init__(
        self,
        server: viser.ViserServer,
        around: Scene,
        dlo_radius_m: float,
        T_world_installation: Pose | None = None,
    ) -> None:
        """`around` has the believed table and fixtures, and the expected arms; an arm of another name is drawn like the
        first.

        `T_world_installation` is the frame in which people measure the installation; None: the world frame.
        """
        self._scene = server.scene
        self._radius_m = dlo_radius_m
        self._roots = {layer: self._scene.add_frame(f"/{layer.slug}", show_axes=False) for layer in palette.LAYERS}
        self._arm = around.arms[0].model
        self._models = {mount.robot: mount.model for mount in around.arms}
        self._robots: dict[str, RobotFigure] = {}
        self._clouds: dict[Layer, viser.PointCloudHandle] = {}
        self._tubes: dict[str, tuple[viser.MeshHandle, int]] = {}
        self._frustum: viser.CameraFrustumHandle | None = None
        self._ghosts: tuple[GripperGhost, GripperGhost] | None = None
        self._path: viser.LineSegmentsHandle | None = None
        _set_stage(server, around.table)
        self._labels = Labels(server.scene)
        add_fixtures(self._scene, self._labels, self._roots[palette.FIXTURES].name, around.fixtures)
        if T_world_installation is not None:
            _show_frames(server.scene, self._labels, T_world_installation)

    @property
    def shown(self) -> tuple[Layer, ...]:
        """The layers of the DLO and of actions that are in the scene and not hidden, in the order of the legend."""
        names = (*self._tubes, *(cloud.name for cloud in self._clouds.values()))
        return tuple(
            layer
            for layer, root in self._roots.items()
            if root.visible and any(name.startswith(f"{root.name}/") for name in names)
        )

    def set_visible(self, layer: Layer, visible: bool) -> None:
        """Show or hide one layer."""
        self._roots[layer].visible = visible

    def show_robot(self, state: RobotState) -> None:
        """Pose a robot; a new name adds a figure."""
        if state.robot not in self._robots:
            name = f"{self._roots[palette.ROBOT].name}/{state.robot}"
            self._robots[state.robot] = figure = RobotFigure(
                self._scene, name, self._models.get(state.robot, self._arm)
            )
            if state.T_world_base is not None:
                place(figure.root, state.T_world_base)
            if len(self._models) > 1:
                T_world_base = state.T_world_base or geometry.pose((0.0, 0.0, 0.0))
                self._labels.add(f"{name}/name", state.robot, T_world_base, prefers="top-center")
        self._robots[state.robot].show(state.q_rad, state.finger_width_m)

    def show_pictures(self, images: CameraPictures) -> None:
        """Show the picture of the (left) camera in its frustum."""
        picture = thumbnail(images.reference, PICTURE_WIDTH_PX)
        calibration = images.calibration
        if self._frustum is None:
            self._frustum = self._scene.add_camera_frustum(
                f"{self._roots[palette.CAMERA].name}/left",
                fov=2.0 * float(np.arctan2(calibration.height_px / 2.0, calibration.fy_px)),
                aspect=calibration.width_px / calibration.height_px,
                scale=0.15,
                thickness=0.004,
                color=palette.CAMERA.color,
                format="jpeg",
                jpeg_quality=80,
                cast_shadow=False,
            )
        self._frustum.image = picture
        place(self._frustum, calibration.T_world_camera)

    def show_cloud(self, seen: Observation) -> None:
        """Show the DLO's points from the last look."""
        self._points(palette.CLOUD, seen.points_world, 0.002)

    def show_targets(self, targets: TargetPoints) -> None:
        """Show the observer's target points, without hidden ones."""
        self._points(palette.TARGETS, targets.nodes_world[targets.visible].astype(np.float32), 0.006)

    def show_state(self, state: DloState) -> None:
        """Show the model's rod."""
        self._tube(palette.STATE, "rod", state.nodes_world, None)

    def show_goal(self, goal: GoalShape) -> None:
        """Show the goal."""
        self._tube(palette.GOAL, "rod", goal.nodes_world, 0.7)

    def show_verdict(self, verdict: GoalVerdict) -> None:
        """Show the spring-back of a goal that does not hold, and the nearest shape that holds."""
        self._ghost(palette.NEAREST, verdict.nearest_world)
        worst = verdict.springs_back
        springs = worst is not None and worst.rmse_m > _SPRINGS_M
        self._ghost(palette.SPRING_BACK, worst.nodes_world if worst is not None and springs else None)

    def _ghost(self, layer: Layer, nodes_world: Float64Array | None) -> None:
        if nodes_world is not None:
            self._tube(layer, "rod", nodes_world, 0.4)
            return
        name = f"{self._roots[layer].name}/rod"
        if self._tubes.pop(name, None) is not None:
            self._scene.remove_by_name(name)

    def show_action(self, action: Action) -> None:
        """Show the chosen action in place of the candidates: gripper at grasp and release, path, predicted shape."""
        self.hide_candidates(0)
        root = self._roots[palette.ACTION].name
        color = palette.ACTION.color
        if self._ghosts is None:
            grasp, release = (
                GripperGhost(self._scene, f"{root}/{name}", self._arm, color) for name in ("grasp", "release")
            )
            self._ghosts = (grasp, release)
        self._ghosts[0].show(action.grasp.T_world_tcp, action.grasp.opening_m)
        self._ghosts[1].show(action.path[-1] if action.path else action.grasp.T_world_tcp, action.grasp.opening_m)
        corners = np.array([p.position_m for p in (action.grasp.T_world_tcp, *action.path)], dtype=np.float32)
        # Line segments are drawn between each pair of neighbours: (K - 1, 2, 3).
        self._path = self._scene.add_line_segments(
            f"{root}/path", np.stack([corners[:-1], corners[1:]], axis=1), color, thickness=0.003
        )
        if action.predicted_nodes_world is not None:
            self._tube(palette.ACTION, "predicted", action.predicted_nodes_world, 0.6)

    def show_candidates(self, candidates: Candidates) -> None:
        """Show the predicted shapes of the best candidates in place of the last action, the best one most opaque."""
        self.hide_action()
        for rank, candidate in enumerate(candidates.best):
            self._tube(palette.CANDIDATES, f"{rank}", candidate.nodes_world, 0.35 / (1 + rank))
        self.hide_candidates(len(candidates.best))

    def hide_candidates(self, first: int) -> None:
        """Hide the candidates from number `first` on."""
        root = f"{self._roots[palette.CANDIDATES].name}/"
        for name in [name for name in self._tubes if name.startswith(root) and int(name[len(root) :]) >= first]:
            del self._tubes[name]
            self._scene.remove_by_name(name)

    def hide_action(self) -> None:
        """Hide the action after a task has ended or another one has begun."""
        if self._path is None or self._ghosts is None:
            return
        # The grippers stay: a browser may get updates of removed nodes, and complains of each in its console.
        for ghost in self._ghosts:
            ghost.hide()
        self._path.remove()
        self._path = None
        predicted = self._tubes.pop(f"{self._roots[palette.ACTION].name}/predicted", None)
        if predicted is not None:
            predicted[0].remove()

    def clear(self) -> None:
        """Remove everything that messages have added, except the robots, which always have a pose."""
        self.hide_action()
        for name in self._tubes:
            self._scene.remove_by_name(name)
        self._tubes.clear()
        for cloud in self._clouds.values():
            cloud.remove()
        self._clouds.clear()

    def _points(self, layer: Layer, points_world: Float32Array, size_m: float) -> None:
        known = self._clouds.get(layer)
        if known is not None:
            known.points = points_world
            return
        self._clouds[layer] = self._scene.add_point_cloud(
            f"{self._roots[layer].name}/points",
            points=points_world,
            colors=layer.color,
            point_size=size_m,
            point_shape="circle",
            # Half floats would round to 0.5 mm at the far end of the table.
            precision="float32",
        )

    def _tube(self, layer: Layer, part: str, nodes_world: Float64Array, opacity: float | None) -> None:
        name = f"{self._roots[layer].name}/{part}"
        vertices = tube_vertices(nodes_world, self._radius_m, _TUBE_SIDES)
        known = self._tubes.get(name)
        if known is not None and known[1] == len(nodes_world):
            known[0].vertices = vertices
            return
        mesh = self._scene.add_mesh_simple(
            name,
            vertices,
            tube_faces(len(nodes_world), _TUBE_SIDES),
            color=layer.color,
            opacity=opacity,
            cast_shadow=opacity is None,
        )
        self._tubes[name] = (mesh, len(nodes_world))


def _set_stage(server: viser.ViserServer, table: Table) -> None:
    """Set up light, table, the area in which a goal may lie, and the initial viewpoint."""
    scene = server.scene
    scene.world_axes.visible = False
    scene.configure_environment_map("studio", environment_intensity=0.15)
    # From a cool grey above to nearly white below: white meshes are visible on it.
    scene.set_background_image(np.linspace((205, 213, 222), (244, 246, 248), 64)[:, None].repeat(4, 1).astype(np.uint8))
    scene.add_box(
        "/table/top",
        color=palette.TABLE_RGB,
        dimensions=(*table.size_m, TABLE_THICKNESS_M),
        position=(*table.centre_m, -TABLE_THICKNESS_M / 2.0),
        cast_shadow=False,
    )
    (x0, x1), (y0, y1) = TABLE_X_M, TABLE_Y_M
    z = 0.0005  # slightly above the table, against flicker
    corners = np.array([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], dtype=np.float32)
    scene.add_line_segments(
        "/table/area",
        np.stack([corners, np.roll(corners, -1, axis=0)], axis=1),
        palette.TABLE_AREA_RGB,
        thickness=0.002,
    )
    fit_each_visitor(server)


_AXIS_M = 0.3
"""Length of the axes of a shown frame [m]: x red, y green, z blue."""


def _show_frames(scene: viser.SceneApi, labels: Labels, T_world_installation: Pose) -> None:
    """Show the frames of the installation and of the world, each with its name."""
    for name, pose in (("installation", T_world_installation), ("world", geometry.pose((0.0, 0.0, 0.0)))):
        frame = scene.add_frame(f"/{name}", axes_length=_AXIS_M, axes_radius=0.004, origin_radius=0.008)
        place(frame, pose)
        labels.add(f"/{name}/name", name, pose)


PICTURE_WIDTH_PX = 320
"""Width of the camera picture that is sent to the browser [px]: half a picture, a quarter of its bytes."""


def thumbnail(picture: UInt8Array, width_px: int) -> UInt8Array:
    """A picture (H, W, 3) or (H, W) as RGB, at most `width_px` wide, with its proportions."""
    rgb = picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)
    if rgb.shape[1] <= width_px:
        return rgb
    height_px = max(1, round(rgb.shape[0] * width_px / rgb.shape[1]))
    return np.asarray(cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def with_shapes(
    picture: UInt8Array,
    calibration: CameraCalibration,
    *,
    state_world: Float64Array | None,
    goal_world: Float64Array | None,
    fixtures: Sequence[Fixture] = (),
) -> UInt8Array:
    """A thumbnail (h, w, 3) with the goal (M, 3) [m] as a line, the nodes of the state (M, 3) [m] as dots, and the
    outlines of fixtures."""
    drawn = np.ascontiguousarray(picture).copy()
    scale = picture.shape[1] / calibration.width_px
    for fixture in fixtures:
        seen = _pixels(fixture.rims_world.reshape(-1, 3), calibration, scale)
        if len(seen):
            cv2.polylines(drawn, [cv2.convexHull(seen)], True, palette.FIXTURES.color, 1, cv2.LINE_AA)
    if goal_world is not None:
        cv2.polylines(drawn, [_pixels(goal_world, calibration, scale)], False, palette.GOAL.color, 1, cv2.LINE_AA)
    if state_world is not None:
        for u, v in _pixels(state_world, calibration, scale):
            cv2.circle(drawn, (int(u), int(v)), 2, palette.STATE.color, -1, cv2.LINE_AA)
    return drawn


def _pixels(nodes_world: Float64Array, calibration: CameraCalibration, scale: float) -> NDArray[np.int32]:
    projected = project(nodes_world, calibration)
    # Points behind the camera are omitted, pixels far outside of the picture clipped.
    return np.clip(projected.pixels[projected.depth_m > 0.0] * scale, -10_000, 10_000).round().astype(np.int32)
