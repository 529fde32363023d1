"""Clouds as the paper's stereo rig would give them: the surface that it sees, wrong along the view ray, thinned."""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass
from typing import Literal, overload

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dlokit.bench.observers.centre_line import FINE, centre_line
from dlokit.bench.observers.rays import Ball, ball_hiding, depth_image, depths_m, hides
from dlokit.bench.observers.sequence import Sequence
from dlokit.description.scene import default_calibration
from dlokit.geometry import inverse, tangents, transform
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import GripperPin, Observation
from dlokit.types.pose import Pose

Place = Literal["middle", "tip", "moving"]
Flags = NDArray[np.bool_]

NOISE_DEPTH_M = 1.2
"""Depth at which the noise is what was asked for [m]: the table's middle. It grows with the depth's square."""
STRAY_MARGIN_M = 0.10
"""Outliers lie anywhere in the box around the DLO, so much wider on each side [m]."""
_BORDER_PX = 20.0  # room around the DLO in the picture
_MOVING_PERIOD_S = 2.0  # in which a moving ball goes along the DLO and back
_KEPT_LOOKS = 200  # of some 60 kB; later ones of a long sequence are made anew for every method
_SHOWN_WITHIN_M = 0.015  # a node of a recorded cloud counts as visible with a point so near


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """What makes a cloud hard; the default is the base case."""

    hidden: float = 0.3
    """Share of the DLO's length that a ball hides."""
    place: Place = "middle"
    """Where the ball stands: in front of the middle, of node 0, or going to and fro."""
    noise_m: float = 0.002
    """Standard deviation of the depth at `NOISE_DEPTH_M` [m]."""
    outliers: float = 0.05
    """Share of the cloud's points that belong to nothing."""
    points: int = 1000
    """Points of a cloud that shows all of the DLO; one that shows half has half."""
    blackout_s: tuple[float, float] | None = None
    """From when to when nothing at all is seen [s]."""


@dataclass(frozen=True, kw_only=True)
class Look:
    """What every observer gets to see of one frame, and which nodes it could have seen."""

    seen: Observation
    pins: tuple[GripperPin, ...]
    """What the robot knows besides; for the pinned rows alone."""
    visible: Flags  # (K,) the truth


class Looks(Ordered[Look]):
    """Every frame of a sequence as a cloud; made when it is asked for, and the same each time."""

    def __init__(self, sequence: Sequence, conditions: Conditions, seed: int) -> None:
        """The clouds that a seed stands for."""
        self._sequence = sequence
        self._conditions = conditions
        self._seed = seed
        self._camera = camera_of(sequence)
        self._kept: dict[int, Look] = {}

    def __len__(self) -> int:
        """The frames of the sequence."""
        return self._sequence.frames

    @overload
    def __getitem__(self, index: int) -> Look: ...
    @overload
    def __getitem__(self, index: slice) -> list[Look]: ...
    def __getitem__(self, index: int | slice) -> Look | list[Look]:
        """The look of a frame, or of some."""
        if isinstance(index, slice):
            return [self[frame] for frame in range(len(self))[index]]
        frame = range(len(self))[index]
        look = self._kept.get(frame) or self._made(frame)
        if frame < _KEPT_LOOKS:
            self._kept[frame] = look
        return look

    def _made(self, frame: int) -> Look:
        if self._sequence.clouds_world is not None:
            return _given(self._sequence, frame, self._camera)
        rng = np.random.default_rng([self._seed, frame])
        return _simulated(self._sequence, frame, self._conditions, self._camera, rng)


def looks(sequence: Sequence, conditions: Conditions, seed: int) -> Looks:
    """Every frame of a sequence as a cloud; the same for the same seed."""
    return Looks(sequence, conditions, seed)


def camera_of(sequence: Sequence) -> CameraCalibration | None:
    """The rig's left camera where the sequence has it, its picture as large as the sequence needs."""
    if sequence.T_world_camera is None:
        return None
    return _seeing_all(sequence.nodes_world.reshape(-1, 3), sequence.T_world_camera)


def _seeing_all(positions_world: Float64Array, T_world_camera: Pose) -> CameraCalibration:
    base = default_calibration()
    p = transform(inverse(T_world_camera), positions_world)
    reach = np.abs(p[:, :2] / p[:, 2:]).max(axis=0) * base.fx_px + _BORDER_PX
    width, height = max(base.width_px, 2 * int(reach[0]) + 1), max(base.height_px, 2 * int(reach[1]) + 1)
    return CameraCalibration(
        width_px=width,
        height_px=height,
        fx_px=base.fx_px,
        fy_px=base.fy_px,
        cx_px=(width - 1) / 2.0,
        cy_px=(height - 1) / 2.0,
        T_world_camera=T_world_camera,
        baseline_m=base.baseline_m,
        serial="bench",
    )


def _given(sequence: Sequence, frame: int, camera: CameraCalibration | None) -> Look:
    assert sequence.clouds_world is not None
    padded = np.asarray(sequence.clouds_world[frame], dtype=np.float64)
    points = padded[np.all(np.isfinite(padded), axis=1)]
    # Nobody says what was hidden in a recorded cloud: a node is seen where points are.
    near = np.zeros(sequence.count, dtype=np.bool_)
    if len(points) > 0:
        near = np.asarray(KDTree(points).query(sequence.nodes_world[frame])[0]) < _SHOWN_WITHIN_M
    seen = Observation(stamp_ns=_stamp_ns(sequence, frame), points_world=points.astype(np.float32), calibration=camera)
    return Look(seen=seen, pins=_pins(sequence, frame), visible=near)


def _simulated(
    sequence: Sequence, frame: int, conditions: Conditions, camera: CameraCalibration | None, rng: np.random.Generator
) -> Look:
    assert camera is not None
    line, eye = centre_line(sequence.nodes_world[frame]), camera.T_world_camera.position_m
    seconds = frame / sequence.rate_hz
    dark = conditions.blackout_s is not None and conditions.blackout_s[0] <= seconds < conditions.blackout_s[1]
    ball = _ball(conditions, line.points_world, eye, seconds)
    shown = np.ones(FINE, dtype=np.bool_) if ball is None else ~hides(ball, eye, line.points_world)
    if dark:
        shown[:] = False
    points = stereo_cloud(line.points_world, shown, sequence.radius_m, conditions, camera, rng)
    seen = Observation(
        stamp_ns=_stamp_ns(sequence, frame),
        points_world=points.astype(np.float32),
        calibration=camera,
        occlusion=None if ball is None else depth_image(ball, camera),
    )
    return Look(seen=seen, pins=_pins(sequence, frame), visible=shown[line.nodes_at])


def stereo_cloud(
    line_world: Float64Array,
    shown: Flags,
    radius_m: float,
    conditions: Conditions,
    camera: CameraCalibration,
    rng: np.random.Generator,
) -> Float64Array:
    """A cloud (N, 3) [m] of the `shown` (K,) parts of a centre line (K, 3) [m], in random order.

    Points lie on the side of the surface that faces the camera and are moved back by the radius, as perception
    does. The stereo rig errs in depth, so each is moved along its own view ray.
    """
    if not shown.any():
        return np.empty((0, 3))
    count = round(conditions.points * float(shown.mean()))
    strays = round(conditions.outliers * count)
    eye = camera.T_world_camera.position_m
    at = rng.choice(np.flatnonzero(shown), size=count - strays)
    centres = line_world[at]
    view = _unit(centres - eye)
    across = _unit(np.cross(tangents(line_world)[at], view))
    offset = rng.uniform(-radius_m, radius_m, size=(len(at), 1))
    surface = centres + across * offset + view * (radius_m - np.sqrt(radius_m**2 - offset**2))
    depth = depths_m(surface, camera)
    wrong = rng.normal(size=len(at)) * conditions.noise_m * (depth / NOISE_DEPTH_M) ** 2
    measured = eye + (surface - eye) * (1.0 + wrong / depth)[:, None]
    low, high = line_world.min(axis=0) - STRAY_MARGIN_M, line_world.max(axis=0) + STRAY_MARGIN_M
    return rng.permutation(np.concatenate([measured, rng.uniform(low, high, size=(strays, 3))]))


def _ball(conditions: Conditions, line: Float64Array, eye: Float64Array, seconds: float) -> Ball | None:
    if conditions.hidden <= 0.0:
        return None
    match conditions.place:
        case "middle":
            at = 0.5
        case "tip":
            at = 0.0
        case "moving":
            at = 0.5 - 0.5 * np.cos(2.0 * np.pi * seconds / _MOVING_PERIOD_S)
    return ball_hiding(conditions.hidden, line[round(at * (FINE - 1))], line, eye)


def _pins(sequence: Sequence, frame: int) -> tuple[GripperPin, ...]:
    if sequence.pins_world is None:
        return ()
    return tuple(
        GripperPin(robot=f"hand {number}", node=node, position_world=at.astype(np.float32))
        for number, (node, at) in enumerate(zip(sequence.pin_nodes, sequence.pins_world[frame], strict=True))
        if np.all(np.isfinite(at))
    )


def _stamp_ns(sequence: Sequence, frame: int) -> int:
    return round((frame + 1) * 1e9 / sequence.rate_hz)


def _unit(vectors: Float64Array) -> Float64Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
