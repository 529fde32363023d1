"""Drawing a goal on the table with the mouse."""

from collections.abc import Callable

import numpy as np
import viser

from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.goal.drawing import drawn_curve, on_plane
from dlokit.skills.viewer.goal.editor import RodOutline
from dlokit.skills.viewer.serving.page import LoopGate
from dlokit.types.arrays import Float64Array

_SHEET, _LINE = "/drawing/sheet", "/drawing/line"
_ABOVE_M = 0.001
"""Height of the sheet and the line above the table and the DLO [m], against flicker."""


class Pen:
    """While it is taken up, a sheet on the table catches the mouse; one line becomes a goal."""

    def __init__(
        self, server: viser.ViserServer, gate: LoopGate, rod: RodOutline, drawn: Callable[[Float64Array], None]
    ) -> None:
        """`drawn` gets the nodes (M, 3) [m] of a line, on the loop."""
        self._scene, self._gate, self._rod, self._drawn = server.scene, gate, rod, drawn
        self._points: list[Float64Array] = []
        self.ready = False
        """Whether the next drag on the table draws."""

    def take_up(self) -> None:
        """Lay the sheet on the table, or take it away again."""
        if self.ready:
            self.put_away()
            return
        self.ready = True
        (x0, x1), (y0, y1) = TABLE_X_M, TABLE_Y_M
        sheet = self._scene.add_box(
            _SHEET,
            color=palette.GOAL.color,
            opacity=0.12,
            dimensions=(x1 - x0, y1 - y0, _ABOVE_M),
            position=((x0 + x1) / 2.0, (y0 + y1) / 2.0, 2.0 * self._rod.radius_m),
            cast_shadow=False,
        )

        # A coroutine without awaiting: viser calls coroutines in the order of the drag.
        async def dragged(event: viser.SceneNodeDragEvent[viser.BoxHandle]) -> None:
            eye, through = np.array(event.client.camera.position), np.array(event.end_position)
            self._gate.post(self._draw, eye, through, event.phase == "start", event.phase == "end")

        sheet.on_drag("left")(dragged)

    def put_away(self) -> None:
        """Take the sheet and the line away."""
        if self.ready:
            self.ready = False
            self._points = []
            for name in (_SHEET, _LINE):
                self._scene.remove_by_name(name)

    def _draw(self, eye_world: Float64Array, through_world: Float64Array, begins: bool, ends: bool) -> None:
        if not self.ready:
            return
        if begins:
            self._points = []
        point = on_plane(eye_world, through_world, self._rod.radius_m)
        if point is not None:
            lower, upper = np.array([TABLE_X_M[0], TABLE_Y_M[0]]), np.array([TABLE_X_M[1], TABLE_Y_M[1]])
            self._points.append(np.clip(point, lower, upper))
        if ends:
            self._finish()
        elif len(self._points) > 1:
            self._show()

    def _show(self) -> None:
        height_m = 2.0 * self._rod.radius_m + 2.0 * _ABOVE_M
        line = np.array([(x, y, height_m) for x, y in self._points], dtype=np.float32)
        self._scene.add_line_segments(
            _LINE, np.stack([line[:-1], line[1:]], axis=1), palette.GOAL.color, thickness=0.004
        )

    def _finish(self) -> None:
        nodes = drawn_curve(np.array(self._points), self._rod.length_m, self._rod.radius_m, self._rod.nodes)
        if nodes is None:
            return  # a click: the sheet stays for another try
        self.put_away()
        self._drawn(nodes)
