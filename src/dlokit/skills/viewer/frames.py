"""The three draggable frames on the page: gizmos that slide on the table and turn about its normal."""

from collections.abc import Callable

import numpy as np
import viser
from scipy.spatial.transform import Rotation

from dlokit.skills.viewer import palette
from dlokit.skills.viewer.goal_handles import GoalHandles
from dlokit.skills.viewer.loop_gate import LoopGate

HEIGHT_M = 0.012
"""The gizmos float above the rod that they pull."""
SCALE_M = 0.09


class GoalFramesView:
    """Shows `GoalHandles`, and moves them as the operator drags."""

    def __init__(
        self, server: viser.ViserServer, handles: GoalHandles, gate: LoopGate, dragged: Callable[[], None]
    ) -> None:
        self._handles = handles
        self._dragged = dragged
        self._knobs: list[viser.IcosphereHandle] = []
        self._gizmos = [self._add(server, gate, index) for index in range(len(handles.handles))]
        self.place()

    def place(self) -> None:
        """Put the gizmos where the handles are."""
        for index in range(len(self._gizmos)):
            self._place(index)

    def _add(self, server: viser.ViserServer, gate: LoopGate, index: int) -> viser.TransformControlsHandle:
        gizmo = server.scene.add_transform_controls(
            f"/goal_frames/{index}",
            scale=SCALE_M,
            line_width=3.5,
            active_axes=(True, True, False),
            depth_test=False,
        )
        self._knobs.append(
            server.scene.add_icosphere(f"/goal_frames/{index}/knob", radius=0.009, color=palette.GOAL.color)
        )

        # A coroutine, though it waits for nothing: such callbacks come in the order of the drag.
        async def moved(event: viser.TransformControlsEvent) -> None:
            position, wxyz = event.target.position, event.target.wxyz
            yaw_rad = float(Rotation.from_quat(wxyz, scalar_first=True).as_euler("ZYX")[0])
            gate.post(self._drag, index, float(position[0]), float(position[1]), yaw_rad, event.phase == "end")

        gizmo.on_update(moved)
        return gizmo

    def _drag(self, index: int, x_m: float, y_m: float, yaw_rad: float, ended: bool) -> None:
        self._handles.drag(index, x_m, y_m, yaw_rad)
        if ended:
            # Moving it under the operator's hand would fight the mouse: it returns to the table at the end.
            self._place(index)
        self._dragged()

    def _place(self, index: int) -> None:
        handle, gizmo = self._handles.handles[index], self._gizmos[index]
        gizmo.position = np.array([handle.x_m, handle.y_m, HEIGHT_M])
        gizmo.wxyz = Rotation.from_euler("z", handle.yaw_rad).as_quat(scalar_first=True)
