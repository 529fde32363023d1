"""Names in the scene, each on the side of its point where it covers no other name."""

import math
from typing import Literal, NamedTuple

import numpy as np
import viser

from dlokit import geometry
from dlokit.skills.viewer.viewpoint import VISITOR_FOV_RAD, VISITOR_LOOK_AT_M, viewpoint
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

Anchor = Literal[
    "bottom-center", "top-center", "bottom-left", "bottom-right", "top-left", "top-right", "center-left", "center-right"
]
"""The part of a name that is at its point: the name is above a point at its ``bottom-center``."""
_ANCHORS: dict[Anchor, tuple[float, float]] = {
    "bottom-center": (-0.5, -1.0),
    "top-center": (-0.5, 0.0),
    "bottom-left": (0.0, -1.0),
    "bottom-right": (-1.0, -1.0),
    "top-left": (0.0, 0.0),
    "top-right": (-1.0, 0.0),
    "center-left": (0.0, -0.5),
    "center-right": (-1.0, -0.5),
}
"""Anchor → left and top edge of the name, from its point, as fractions of its width and height."""
_LETTER_PX = (7.0, 18.0)
"""Width of a letter, and height of a name with its border [px]; viser draws names in one size in any window."""
_BORDER_PX = 8.0
_WINDOW_PX = 800.0
_RISE_M, _MOST_RISES = 0.025, 20
"""Where all sides are taken, a name is moved up by such steps."""
_EYES_M = (viewpoint(1.4), viewpoint(0.85))
"""Where visitors arrive whose windows are 1600 and 1024 pixels wide, of which the panel takes a part."""


class _Box(NamedTuple):
    left: float
    top: float
    right: float
    bottom: float

    def covers(self, other: "_Box") -> bool:
        return (
            self.left < other.right and other.left < self.right and self.top < other.bottom and other.top < self.bottom
        )


class Labels:
    """Adds names that do not move; no two lie on one another where a visitor arrives."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._taken: list[tuple[_Box, ...]] = []

    def add(
        self,
        node: str,
        text: str,
        T_world_parent: Pose,
        *,
        height_m: float = 0.0,
        size: float = 1.0,
        prefers: Anchor = "bottom-center",
    ) -> None:
        """Add a name at the height `height_m` [m] above its parent in the scene's tree, in letters of `size` times the
        usual one; on another side of its point than `prefers`, or higher, if it would cover an earlier name there."""
        places: list[tuple[Anchor, float]] = [(anchor, height_m) for anchor in (prefers, *_ANCHORS)]
        places += [(prefers, height_m + rise * _RISE_M) for rise in range(1, _MOST_RISES)]

        def boxes(place: tuple[Anchor, float]) -> tuple[_Box, ...]:
            point_world = geometry.transform(T_world_parent, (0.0, 0.0, place[1]))
            return _boxes(point_world, text, size, place[0])

        place = next((each for each in places if not self._covers(boxes(each))), places[0])
        self._taken.append(boxes(place))
        anchor, at_m = place
        self._scene.add_label(node, text, position=(0.0, 0.0, at_m), anchor=anchor, font_screen_scale=size)

    def _covers(self, boxes: tuple[_Box, ...]) -> bool:
        return any(one.covers(other) for taken in self._taken for one, other in zip(boxes, taken, strict=True))


def _boxes(point_world: Float64Array, text: str, size: float, anchor: Anchor) -> tuple[_Box, ...]:
    """Where a name is for each of the visitors [px]."""
    width, height = size * (_LETTER_PX[0] * len(text) + _BORDER_PX), size * _LETTER_PX[1]
    across, down = _ANCHORS[anchor]
    boxes: list[_Box] = []
    for eye in _EYES_M:
        u, v = _pixel(point_world, eye)
        left, top = u + across * width, v + down * height
        boxes.append(_Box(left, top, left + width, top + height))
    return tuple(boxes)


def _pixel(point_world: Float64Array, eye: Float64Array) -> tuple[float, float]:
    """Where a visitor at `eye` (3,) [m] sees a point (3,) [m], to the right of and below the window's middle [px]."""
    forward = np.array(VISITOR_LOOK_AT_M) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    offset = (point_world - eye) * (_WINDOW_PX / 2.0 / math.tan(VISITOR_FOV_RAD / 2.0))
    depth = float((point_world - eye) @ forward)
    return float(offset @ right) / depth, float(offset @ np.cross(forward, right)) / depth
