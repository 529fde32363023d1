"""Markers for RViz: state, goal, next action, workspaces and fixtures, in the colours of dlokit's page.

Each array holds all markers, so that the last one is enough for a late subscriber. What has been shown and is gone is
deleted in every array, because a slow subscriber may not get the one after which it was gone.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from dlokit import geometry
from dlokit.description.arm.mounts import WorkspaceBox
from dlokit.description.scene import Scene
from dlokit.extras.ros2.definitions import Definitions
from dlokit.extras.ros2.published.outgoing import header, point_list, ros_pose, vector
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.palette import Rgb
from dlokit.types.action import APPROACH_HEIGHT_M, Action, Grasp, kind_of
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

_ARROW, _LINE_STRIP, _LINE_LIST, _TEXT = 0, 4, 5, 9
_ADD, _DELETE = 0, 2
_PATH_M, _WORKSPACE_M, _EDGE_M = 0.003, 0.002, 0.0015
"""Widths of lines [m]."""
_SHAFT_M, _HEAD_M = 0.006, 0.014
"""Diameters of an arrow's shaft and head [m]."""
_LETTERS_M = 0.02
"""Height of letters [m]."""

Key = tuple[str, int]
"""Namespace and id of a marker."""
STATE: Final[Key] = ("state", 0)
GOAL: Final[Key] = ("goal", 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """What one marker shows."""

    type: int
    """`Marker.type`."""
    scale: tuple[float, float, float]
    """`Marker.scale`; its meaning depends on the type [m]."""
    color: tuple[float, float, float, float]
    """Red, green, blue and opacity, 0 to 1."""
    points: list[Any] = field(default_factory=list[Any])
    """``geometry_msgs/msg/Point``."""
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Of a text [m]."""
    text: str = ""


_GONE = Shown(type=_ARROW, scale=(0.0, 0.0, 0.0), color=(0.0, 0.0, 0.0, 0.0))


class Markers:
    """The markers that are shown, by namespace and id."""

    def __init__(self, ros: Definitions) -> None:
        self._ros = ros
        self._shown: dict[Key, Shown] = {}
        self._ever: dict[Key, None] = {}

    def show(self, markers: Mapping[Key, Shown], namespaces: Iterable[str]) -> None:
        """Replace all markers of the namespaces."""
        replaced = frozenset(namespaces)
        self._shown = {key: shown for key, shown in self._shown.items() if key[0] not in replaced} | dict(markers)
        self._ever |= dict.fromkeys(self._shown)

    def array(self, stamp: int) -> Any:
        """The MarkerArray of all markers, and of the deletion of those that are gone."""
        return self._ros.make(
            "visualization_msgs/msg/MarkerArray",
            markers=[_marker(self._ros, stamp, key, self._shown.get(key)) for key in self._ever],
        )


def rod(ros: Definitions, key: Key, nodes_world: Float64Array, radius_m: float) -> dict[Key, Shown]:
    """The nodes (M, 3) [m] of a state or goal as a line as thick as the DLO; nothing for fewer than two finite ones."""
    color = _rgba(palette.STATE.color, 1.0) if key == STATE else _rgba(palette.GOAL.color, 0.7)
    return _line(ros, key, nodes_world, 2.0 * radius_m, color)


def workspaces(ros: Definitions, boxes: Sequence[WorkspaceBox]) -> dict[Key, Shown]:
    """The edges of the boxes that the tools of the arms never leave."""
    color = _rgba(palette.TABLE_AREA_RGB, 0.6)
    return {
        ("workspace", number): Shown(
            type=_LINE_LIST, scale=(_WORKSPACE_M, 0.0, 0.0), color=color, points=point_list(ros, _edges(box))
        )
        for number, box in enumerate(boxes)
    }


def fixtures(ros: Definitions, scene: Scene) -> dict[Key, Shown]:
    """The edges of the believed fixtures, and their names above them."""
    if not scene.fixtures:
        return {}
    color = _rgba(palette.FIXTURES.color, 1.0)
    edges = point_list(ros, scene.edges_world.reshape(-1, 3))
    found: dict[Key, Shown] = {
        ("fixtures", 0): Shown(type=_LINE_LIST, scale=(_EDGE_M, 0.0, 0.0), color=color, points=edges)
    }
    for number, fixture in enumerate(scene.fixtures, start=1):
        x, y, _ = fixture.position_m
        above = (x, y, fixture.top_m + _LETTERS_M)
        found["fixtures", number] = Shown(
            type=_TEXT, scale=(0.0, 0.0, _LETTERS_M), color=color, position_m=above, text=fixture.name
        )
    return found


ACTION_NAMESPACES = ("action", "grasp", "path", "predicted")


def action_markers(ros: Definitions, action: Action, radius_m: float) -> dict[Key, Shown]:
    """The next action: its kind as a text, the descents as arrows, the paths and the predicted shape as lines.

    The ids of descents and paths are 0 for the arm of the action, and 1 for its partner.
    """
    color = _rgba(palette.ACTION.color, 1.0)
    arms = [(action.grasp, action.path)]
    if action.partner is not None:
        arms.append((action.partner.grasp, action.partner.path))
    found: dict[Key, Shown] = {}
    for number, (grasp, path) in enumerate(arms):
        found |= _arm_markers(ros, number, grasp, path, color)
    if action.predicted_nodes_world is not None:
        faint = _rgba(palette.ACTION.color, 0.6)
        found |= _line(ros, ("predicted", 0), action.predicted_nodes_world, 2.0 * radius_m, faint)
    above = geometry.lifted(action.grasp.T_world_tcp, APPROACH_HEIGHT_M + _LETTERS_M).position_m.tolist()
    x, y, z = above
    found["action", 0] = Shown(
        type=_TEXT, scale=(0.0, 0.0, _LETTERS_M), color=color, position_m=(x, y, z), text=kind_of(action)
    )
    return found


def _arm_markers(
    ros: Definitions, number: int, grasp: Grasp, path: Sequence[Pose], color: tuple[float, float, float, float]
) -> dict[Key, Shown]:
    at = grasp.T_world_tcp
    descent = np.stack((geometry.lifted(at, APPROACH_HEIGHT_M).position_m, at.position_m))
    arrow = Shown(type=_ARROW, scale=(_SHAFT_M, _HEAD_M, _HEAD_M), color=color, points=point_list(ros, descent))
    corners = np.stack([pose.position_m for pose in (at, *path)])
    return {("grasp", number): arrow} | _line(ros, ("path", number), corners, _PATH_M, color)


def _line(
    ros: Definitions, key: Key, points_world: Float64Array, width_m: float, color: tuple[float, float, float, float]
) -> dict[Key, Shown]:
    points = points_world[np.isfinite(points_world).all(axis=1)]
    if len(points) < 2:
        return {}
    return {key: Shown(type=_LINE_STRIP, scale=(width_m, 0.0, 0.0), color=color, points=point_list(ros, points))}


def _edges(box: WorkspaceBox) -> Float64Array:
    """The ends of the 12 edges of a box, (24, 3) [m]."""
    corners = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, -1).T  # (8, 3)
    pairs = [(a, b) for a in range(8) for b in range(a) if np.abs(corners[a] - corners[b]).sum() == 1]
    lower, upper = np.array(box.lower_m), np.array(box.upper_m)
    return (lower + corners * (upper - lower))[np.array(pairs).ravel()]


def _rgba(rgb: Rgb, opacity: float) -> tuple[float, float, float, float]:
    red, green, blue = rgb
    return red / 255.0, green / 255.0, blue / 255.0, opacity


def _marker(ros: Definitions, stamp: int, key: Key, shown: Shown | None) -> Any:
    what = _GONE if shown is None else shown
    red, green, blue, opacity = what.color
    head = header(ros, stamp)
    no_bytes = np.zeros(0, dtype=np.uint8)
    return ros.make(
        "visualization_msgs/msg/Marker",
        header=head,
        ns=key[0],
        id=key[1],
        type=what.type,
        action=_DELETE if shown is None else _ADD,
        pose=ros_pose(ros, what.position_m),
        scale=vector(ros, what.scale),
        color=ros.make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=opacity),
        lifetime=ros.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=what.points,
        colors=[],
        texture_resource="",
        texture=ros.make("sensor_msgs/msg/CompressedImage", header=head, format="", data=no_bytes),
        uv_coordinates=[],
        text=what.text,
        mesh_resource="",
        mesh_file=ros.make("visualization_msgs/msg/MeshFile", filename="", data=no_bytes),
        mesh_use_embedded_materials=False,
    )
