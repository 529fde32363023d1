"""A page on which a person chooses a box in a camera's live cloud: two corners to drag, and the table's plane."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import viser

from dlokit import geometry
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.serving.address import new_key, page_url
from dlokit.skills.viewer.serving.page import LoopGate, close_page, open_page
from dlokit.skills.viewer.viewpoint import VISITOR_FOV_RAD
from dlokit.types.arrays import Float32Array, Float64Array, UInt8Array
from dlokit.types.pose import Pose

LEAST_SIDE_M = 0.02
"""The box has sides of this length at least [m]."""
GIZMO_M = 0.12
"""Length of the arrows by which a corner is dragged [m]."""
FROM_M, LOOK_AT_M = (1.8, -1.3, 1.4), (0.6, 0.15, 0.1)
"""Initial viewpoint of the page [m]."""
_BOX_RGB = (30, 110, 220)
_PLATE_M = 0.002
_PLATE_SIDE_M = 0.8
_EDGES = ((0, 1), (1, 3), (3, 2), (2, 0), (4, 5), (5, 7), (7, 6), (6, 4), (0, 4), (1, 5), (2, 6), (3, 7))
FIT, WRITE = "Fit the table to the points in the box", "Write the lines"


@dataclass(frozen=True, kw_only=True)
class ChosenBox:
    """A box along the axes of a frame: the cloud's frame until the table has been found."""

    frame: Pose
    lower_m: tuple[float, float, float]
    upper_m: tuple[float, float, float]

    def holds(self, points: Float32Array) -> Float32Array:
        """The points (K, 3) [m] of a cloud (N, 3) that are in the box."""
        p = geometry.transform(geometry.inverse(self.frame), points)
        return points[np.all((p >= self.lower_m) & (p <= self.upper_m), axis=1)]

    def dragged(self, corner: int, place: Float64Array) -> "ChosenBox":
        """The box with one corner, 0 lower or 1 upper, at a place (3,) [m] of the cloud's frame, or near it."""
        p = geometry.transform(geometry.inverse(self.frame), place[None])[0]
        if corner == 0:
            lower = np.minimum(p, np.array(self.upper_m) - LEAST_SIDE_M)
            return replace(self, lower_m=_three(lower))
        return replace(self, upper_m=_three(np.maximum(p, np.array(self.lower_m) + LEAST_SIDE_M)))

    def on(self, frame: Pose) -> "ChosenBox":
        """The box with the same numbers in another frame, with its bottom on that frame's plane z = 0."""
        height_m = max(self.upper_m[2], LEAST_SIDE_M)
        return ChosenBox(frame=frame, lower_m=(*self.lower_m[:2], 0.0), upper_m=(*self.upper_m[:2], height_m))

    def place(self, corner: int) -> Float64Array:
        """A corner (3,) [m] in the cloud's frame."""
        return geometry.transform(self.frame, np.array([(self.lower_m, self.upper_m)[corner]]))[0]

    @property
    def edges(self) -> Float32Array:
        """Both ends (12, 2, 3) [m] of each edge, in the cloud's frame."""
        bounds = np.array([self.lower_m, self.upper_m])
        corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
        return geometry.transform(self.frame, corners)[np.array(_EDGES)].astype(np.float32)


def _three(values: Float64Array) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


class BoxPage:
    """The page while it is open; all methods are called on the event loop."""

    def __init__(
        self,
        host: str,
        port: int,
        box: ChosenBox,
        gate: LoopGate,
        *,
        on_fit: Callable[[], None],
        on_write: Callable[[], None],
    ) -> None:
        """Open the page; its buttons call `on_fit` and `on_write` on the event loop. Raises as `open_page`."""
        key = new_key()
        self.box = box
        self._gate = gate
        self._server = open_page(host, port, key)
        self.url = page_url(host, self._server.get_port(), key)
        self._cloud: viser.PointCloudHandle | None = None
        scene, gui = self._server.scene, self._server.gui
        scene.set_background_image(np.full((8, 8, 3), 235, dtype=np.uint8))
        scene.add_frame("/origin", axes_length=0.15, axes_radius=0.004)
        self._server.initial_camera.position = FROM_M
        self._server.initial_camera.look_at = LOOK_AT_M
        self._server.initial_camera.fov = VISITOR_FOV_RAD
        gui.add_markdown(
            "**1.** Drag the two corners so that the box holds bare table, then press the first button. More than half "
            "of the points in it must lie on the table.\n\n"
            "**2.** Drag the corners to the space that the tool may use, then press the second button."
        )
        fit, write = gui.add_button(FIT), gui.add_button(WRITE)
        self._text = gui.add_markdown("")

        # Coroutines without awaiting: viser calls them in order.
        async def fit_clicked(_: object) -> None:
            gate.post(on_fit)

        async def write_clicked(_: object) -> None:
            gate.post(on_write)

        fit.on_click(fit_clicked)
        write.on_click(write_clicked)
        self._gizmos = [self._add_gizmo(corner) for corner in (0, 1)]
        self._draw()

    def show_cloud(self, points: Float32Array, colours: UInt8Array) -> None:
        """Show the newest cloud."""
        if self._cloud is not None and len(self._cloud.points) == len(points):
            self._cloud.points, self._cloud.colors = points, colours
            return
        # The number of points changes with every picture: the colours must change with them.
        self._cloud = self._server.scene.add_point_cloud(
            "/cloud", points=points, colors=colours, point_size=0.003, precision="float32"
        )

    def show_table(self, frame: Pose) -> None:
        """Show the fitted plane, and set the box on it."""
        self.box = self.box.on(frame)
        middle = (np.array(self.box.lower_m) + np.array(self.box.upper_m)) / 2.0
        place = geometry.transform(frame, np.array([[middle[0], middle[1], -_PLATE_M]]))[0]
        self._server.scene.add_box(
            "/plane",
            color=palette.TABLE_AREA_RGB,
            dimensions=(_PLATE_SIDE_M, _PLATE_SIDE_M, _PLATE_M),
            position=place,
            wxyz=frame.wxyz,
            opacity=0.6,
        )
        for corner in (0, 1):
            self._place(corner)
        self._draw()

    def say(self, text: str) -> None:
        """Show a result or an error."""
        self._text.content = text

    def close(self) -> None:
        """Stop serving."""
        close_page(self._server)

    def _add_gizmo(self, corner: int) -> viser.TransformControlsHandle:
        gizmo = self._server.scene.add_transform_controls(
            f"/corners/{corner}", scale=GIZMO_M, line_width=3.0, disable_rotations=True, depth_test=False
        )
        gizmo.position, gizmo.wxyz = self.box.place(corner), self.box.frame.wxyz

        async def moved(event: viser.TransformControlsEvent) -> None:
            self._gate.post(self._drag, corner, np.array(event.target.position), event.phase == "end")

        gizmo.on_update(moved)
        return gizmo

    def _drag(self, corner: int, place: Float64Array, ended: bool) -> None:
        self.box = self.box.dragged(corner, place)
        if ended:
            # Moved only at the end of the drag: before, it would move away from the mouse.
            self._place(corner)
        self._draw()

    def _place(self, corner: int) -> None:
        self._gizmos[corner].position, self._gizmos[corner].wxyz = self.box.place(corner), self.box.frame.wxyz

    def _draw(self) -> None:
        self._server.scene.add_line_segments("/box", self.box.edges, _BOX_RGB, thickness=0.004)
        lower, upper = (", ".join(f"{value:.3f}" for value in one) for one in (self.box.lower_m, self.box.upper_m))
        self._server.scene.add_label("/box_label", f"({lower}) to ({upper}) m", position=self.box.place(1))
