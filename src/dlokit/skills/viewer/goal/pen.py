"""A goal drawn with the mouse: where the line of sight meets the table, as a curve of the DLO's length."""

from collections.abc import Callable

import numpy as np
import viser
from scipy import ndimage

from dlokit import geometry
from dlokit.description.shapes import length
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.goal.editor import RodOutline
from dlokit.skills.viewer.serving.page import LoopGate
from dlokit.types.arrays import Float64Array

CLICK_M = 0.05
"""A drawn line shorter than this is a click [m]."""
_SMOOTH_M = 0.03
"""Standard deviation of the filter over the arc that removes the jitter of a hand [m]; less than half of the tightest
bend that friction holds."""
_STEP_M = 0.002
_MANY = 200


def on_plane(eye_world: Float64Array, through_world: Float64Array, z_m: float) -> Float64Array | None:
    """Where the line from an eye (3,) [m] through a point (3,) [m] meets the plane of height `z_m`, (2,) [m].

    None if the eye is not above the plane or does not look down.
    """
    drop = eye_world[2] - through_world[2]
    if drop <= 1e-9 or eye_world[2] <= z_m:
        return None
    factor = (eye_world[2] - z_m) / drop
    return (eye_world + factor * (through_world - eye_world))[:2]


def drawn_curve(points: Float64Array, rod: RodOutline) -> Float64Array | None:
    """The drawn points (K, 2) [m] on the table as a goal (M, 3) [m] of the rod's length; None for a click.

    The line is smoothed, then cut where it is longer than the rod, or continued straight where it is shorter, so that
    the goal is where it was drawn.
    """
    if len(points) < 2:
        return None
    apart = np.concatenate(([True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6))
    line = points[apart]
    if len(line) < 2 or length(line) < CLICK_M:
        return None
    return rod.on_table(_of_length(_smoothed(line), rod.length_m))


def _smoothed(line: Float64Array) -> Float64Array:
    """The line (K, 2) [m] filtered along its arc by a Gaussian; both ends and their directions stay."""
    count = max(int(length(line) / _STEP_M), _MANY)
    fine = geometry.resample(line, count)
    step_m = length(line) / (count - 1)
    reach = min(int(3.0 * _SMOOTH_M / step_m), count - 1)
    # Reflected through each end, so that the filter neither shortens nor turns the ends.
    before, after = 2.0 * fine[0] - fine[reach:0:-1], 2.0 * fine[-1] - fine[-2 : -reach - 2 : -1]
    padded = np.concatenate([before, fine, after])
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) * step_m / _SMOOTH_M) ** 2)
    weights /= weights.sum()
    filtered: Float64Array = ndimage.correlate1d(padded, weights, axis=0)
    return filtered[reach:-reach]


def _of_length(line: Float64Array, length_m: float) -> Float64Array:
    s = geometry.arc_lengths(line)
    if s[-1] >= length_m:
        kept = line[s < length_m]
        last = np.array([np.interp(length_m, s, line[:, axis]) for axis in range(2)])
        return np.concatenate([kept, last[None]])
    missing_m = length_m - s[-1]
    along = line[-1] - line[-2]
    back = line[0] - line[1]
    half = 0.5 * missing_m
    return np.concatenate(
        [
            (line[0] + half * back / np.linalg.norm(back))[None],
            line,
            (line[-1] + half * along / np.linalg.norm(along))[None],
        ]
    )


_SHEET, _LINE = "/drawing/sheet", "/drawing/line"
_ABOVE_M = 0.001
"""Height of the sheet and the line above the table and the DLO [m], against flicker."""


class Pen:
    """Draws a goal: while it is active, a sheet on the table catches the mouse, and one line becomes the goal.

    It belongs to the visitor who took it up, and ends when that browser's page closes or reloads.
    """

    def __init__(
        self, server: viser.ViserServer, gate: LoopGate, rod: RodOutline, drawn: Callable[[Float64Array], None]
    ) -> None:
        """`drawn` is called on the loop with the nodes (M, 3) [m] of a line."""
        self._scene, self._gate, self._rod, self._drawn = server.scene, gate, rod, drawn
        self._points: list[Float64Array] = []
        self._visitor: int | None = None
        self.ready = False
        """Whether the next drag on the table draws."""

        async def left(client: viser.ClientHandle) -> None:
            gate.post(self._left, client.client_id)

        server.on_client_disconnect(left)

    def take_up(self, visitor: int | None) -> None:
        """Show the sheet on the table, or remove it if it is shown. `visitor` is the number of the browser's page."""
        if self.ready:
            self.put_away()
            return
        self.ready, self._visitor = True, visitor
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
        """Remove the sheet and the line."""
        if self.ready:
            self.ready = False
            self._points = []
            for name in (_SHEET, _LINE):
                self._scene.remove_by_name(name)

    def _left(self, visitor: int) -> None:
        if visitor == self._visitor:
            self.put_away()

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
        nodes = drawn_curve(np.array(self._points), self._rod)
        if nodes is None:
            return  # a click: the sheet stays for another attempt
        self.put_away()
        self._drawn(nodes)
