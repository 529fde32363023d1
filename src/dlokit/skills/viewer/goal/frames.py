"""The paper's movable frames, initially three: the nodes that they pull, their poses, and the gizmos on the page."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.serving.page import LoopGate
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import GoalFrame, GoalFrames

TURNED_RAD = 0.02
"""A frame turned by less than this (1.1°) counts as not turned: its direction stays free."""


@dataclass(frozen=True)
class Handle:
    """One movable frame on the table."""

    node: int
    x_m: float
    y_m: float
    yaw_rad: float
    """Yaw at which the frame is drawn [rad]."""
    turned: bool = False
    """Whether the operator has turned it; then its direction is imposed on the rod."""


FIRST_FRAMES = 3
"""Initial number of frames, as in the paper: at the first, the middle and the last node."""


class GoalHandles:
    """Frames at equal distances along the goal rod, from its first to its last node.

    They follow the goal until the operator drags one; after that only the operator moves them.
    """

    def __init__(self, goal_nodes_world: Float64Array, x_m: tuple[float, float], y_m: tuple[float, float]) -> None:
        self._x_m, self._y_m = x_m, y_m
        self.dragged = False
        self._count = FIRST_FRAMES
        self._goal = goal_nodes_world
        self.handles = self._on(goal_nodes_world)

    def follow(self, goal_nodes_world: Float64Array) -> bool:
        """Follow a new goal (M, 3) [m], unless the operator has dragged; return whether the frames moved."""
        self._goal = goal_nodes_world
        if self.dragged:
            return False
        self.handles = self._on(goal_nodes_world)
        return True

    def set_count(self, count: int) -> None:
        """Place `count` frames, 2 or more, on the present goal."""
        self._count = count
        self.release()

    def release(self) -> None:
        """Return to the present goal, with free directions, and follow it again."""
        self.dragged = False
        self.handles = self._on(self._goal)

    def drag(self, index: int, x_m: float, y_m: float, yaw_rad: float) -> Handle:
        """Move frame `index` as the operator dragged it, within the table. Returns its pose."""
        old = self.handles[index]
        turn = (yaw_rad - old.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
        new = replace(
            old,
            x_m=float(np.clip(x_m, *self._x_m)),
            y_m=float(np.clip(y_m, *self._y_m)),
            # While the direction is free, the drawn yaw is kept, so that many small turns add up.
            yaw_rad=yaw_rad if old.turned or abs(turn) > TURNED_RAD else old.yaw_rad,
            turned=old.turned or abs(turn) > TURNED_RAD,
        )
        self.handles = (*self.handles[:index], new, *self.handles[index + 1 :])
        self.dragged = True
        return new

    def message(self, stamp_ns: int) -> GoalFrames:
        """The frames as the model receives them."""
        return GoalFrames(
            stamp_ns=stamp_ns,
            frames=tuple(
                GoalFrame(node=h.node, x_m=h.x_m, y_m=h.y_m, yaw_rad=h.yaw_rad if h.turned else None)
                for h in self.handles
            ),
        )

    def _on(self, nodes_world: Float64Array) -> tuple[Handle, ...]:
        directions = geometry.tangents(nodes_world)
        last = len(nodes_world) - 1
        return tuple(
            Handle(
                node=node,
                x_m=float(nodes_world[node, 0]),
                y_m=float(nodes_world[node, 1]),
                yaw_rad=float(np.arctan2(directions[node, 1], directions[node, 0])),
            )
            for node in (last * index // (self._count - 1) for index in range(self._count))
        )


DragPhase = Literal["start", "update", "end"]

HEIGHT_M = 0.012
"""Height of the gizmos above the rod that they pull [m]."""
SCALE_M = 0.09


class GoalFramesView:
    """Shows `GoalHandles`, and moves them as the operator drags."""

    def __init__(
        self, server: viser.ViserServer, handles: GoalHandles, gate: LoopGate, dragged: Callable[[DragPhase], None]
    ) -> None:
        """`dragged` is called on the loop after each movement of a frame, with the phase of the drag."""
        self._server, self._gate = server, gate
        self._handles = handles
        self._dragged = dragged
        self._root = server.scene.add_frame("/goal_frames", show_axes=False)
        self._knobs: list[viser.IcosphereHandle] = []
        self._gizmos: list[viser.TransformControlsHandle] = []
        self.place()

    def place(self) -> None:
        """Put the gizmos where the handles are."""
        while len(self._gizmos) > len(self._handles.handles):
            self._knobs.pop().remove()
            self._gizmos.pop().remove()
        for index in range(len(self._handles.handles)):
            if index == len(self._gizmos):
                self._gizmos.append(self._add(index))
            self._place(index)

    def show(self, visible: bool) -> None:
        """Show or hide the gizmos: hidden, they cannot be dragged."""
        if self._root.visible != visible:
            self._root.visible = visible

    def _add(self, index: int) -> viser.TransformControlsHandle:
        gizmo = self._server.scene.add_transform_controls(
            f"/goal_frames/{index}",
            scale=SCALE_M,
            line_width=3.5,
            active_axes=(True, True, False),
            depth_test=False,
        )
        self._knobs.append(
            self._server.scene.add_icosphere(f"/goal_frames/{index}/knob", radius=0.009, color=palette.GOAL.color)
        )

        # A coroutine without awaiting: viser calls coroutines in the order of the drag.
        async def moved(event: viser.TransformControlsEvent) -> None:
            position, wxyz = event.target.position, event.target.wxyz
            yaw_rad = float(Rotation.from_quat(wxyz, scalar_first=True).as_euler("ZYX")[0])
            self._gate.post(self._drag, index, float(position[0]), float(position[1]), yaw_rad, event.phase)

        gizmo.on_update(moved)
        return gizmo

    def _drag(self, index: int, x_m: float, y_m: float, yaw_rad: float, phase: DragPhase) -> None:
        if index >= len(self._handles.handles):
            return  # the frame was removed meanwhile
        if phase == "start":
            self._dragged(phase)
        self._handles.drag(index, x_m, y_m, yaw_rad)
        if phase == "end":
            # Moved only at the end of the drag: before, it would move away from the mouse.
            self._place(index)
        if phase != "start":
            self._dragged(phase)

    def _place(self, index: int) -> None:
        handle, gizmo = self._handles.handles[index], self._gizmos[index]
        gizmo.position = np.array([handle.x_m, handle.y_m, HEIGHT_M])
        gizmo.wxyz = Rotation.from_euler("z", handle.yaw_rad).as_quat(scalar_first=True)
