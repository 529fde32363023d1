"""The inputs of observers for a sequence: one cloud of the paper's stereo rig per frame, with additional data."""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass
from typing import overload

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from dlokit.description.default_cameras import default_calibration
from dlokit.extras.bench.observers.conditions import (
    Ball,
    Conditions,
    ball_hiding,
    behind_itself,
    dark_frames,
    depth_image,
    depths_m,
    hides,
)
from dlokit.extras.bench.observers.sequence import FINE, Sequence, centre_line
from dlokit.geometry import inverse, matrix, pose_from_matrix, tangents, transform
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import GripperPin, Observation
from dlokit.types.pose import Pose

NOISE_DEPTH_M = 1.2
"""Depth at which the noise has the configured value [m]: the centre of the table. It grows with the squared depth."""
STRAY_MARGIN_M = 0.10
"""Margin around the DLO's bounding box in which outliers are drawn [m]."""
_BORDER_PX = 20.0  # margin around the DLO in the picture


def camera_of(sequence: Sequence) -> CameraCalibration | None:
    """The rig's left camera at the sequence's pose, with a picture large enough for the sequence."""
    if sequence.calibration is not None:
        return sequence.calibration
    if sequence.T_world_camera is None:
        return None
    return _seeing_all(sequence.nodes_world.reshape(-1, 3), sequence.T_world_camera)


def believed_pose(T_world_camera: Pose, conditions: Conditions, rng: np.random.Generator) -> Pose:
    """The believed pose of a camera, with a hand-eye calibration error in random directions."""
    shift, axis = _unit(rng.normal(size=(2, 3)))
    T = matrix(T_world_camera)
    T[:3, :3] = Rotation.from_rotvec(conditions.camera_error_rad * axis).as_matrix() @ T[:3, :3]
    T[:3, 3] += conditions.camera_error_m * shift
    return pose_from_matrix(T)


def in_assumed_frame(points_world: Float64Array, T_true: Pose, T_believed: Pose) -> Float64Array:
    """Points (N, 3) [m] measured by a camera at `T_true`, as computed with the pose `T_believed`."""
    return transform(T_believed, transform(inverse(T_true), points_world))


def stereo_cloud(
    line_world: Float64Array,
    shown: BoolArray,
    radius_m: float,
    conditions: Conditions,
    camera: CameraCalibration,
    rng: np.random.Generator,
) -> Float64Array:
    """A cloud (N, 3) [m] of the `shown` (K,) parts of a centre line (K, 3) [m], in random order.

    Points are on the side of the surface that faces the camera and are moved back by the radius, as perception
    does. The stereo rig has errors in depth, so each point is moved along its own view ray.
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


def _seeing_all(positions_world: Float64Array, T_world_camera: Pose) -> CameraCalibration:
    base = default_calibration()
    p = transform(inverse(T_world_camera), positions_world)
    reach = np.abs(p[:, :2] / p[:, 2:]).max(axis=0) * base.fx_px + _BORDER_PX
    width, height = max(base.width_px, 2 * int(reach[0]) + 1), max(base.height_px, 2 * int(reach[1]) + 1)
    return msgspec.structs.replace(
        base,
        width_px=width,
        height_px=height,
        cx_px=(width - 1) / 2.0,
        cy_px=(height - 1) / 2.0,
        T_world_camera=T_world_camera,
        serial="bench",
    )


def _unit(vectors: Float64Array) -> Float64Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


_MOVING_PERIOD_S = 2.0  # period of a ball that moves along the DLO and back
_KEPT_LOOKS = 200  # of some 60 kB; later ones of a long sequence are generated again for every method
_SHOWN_WITHIN_M = 0.015  # a node of a recorded cloud counts as visible with a point within this distance


@dataclass(frozen=True, kw_only=True)
class ObserverFrame:
    """The observer's input for one frame, and which nodes were visible."""

    seen: Observation
    pins: tuple[GripperPin, ...]
    """Additional knowledge of the robot, used only in rows with pins."""
    visible: NDArray[np.bool_]  # (K,) the truth
    dark: bool = False
    """Whether nothing is visible in this frame."""


class Looks(Ordered[ObserverFrame]):
    """Every frame of a sequence as a cloud, generated on demand and reproducibly."""

    def __init__(self, sequence: Sequence, conditions: Conditions, seed: int) -> None:
        """Generate the clouds for a seed."""
        self._sequence = sequence
        self._conditions = conditions
        self._seed = seed
        self._dark = dark_frames(conditions, sequence.frames, sequence.rate_hz)
        self._camera = self._believed = camera_of(sequence)
        if self._camera is not None and (conditions.camera_error_m or conditions.camera_error_rad):
            rng = np.random.default_rng([seed, sequence.frames])
            T_believed = believed_pose(self._camera.T_world_camera, conditions, rng)
            self._believed = msgspec.structs.replace(self._camera, T_world_camera=T_believed)
        self._kept: dict[int, ObserverFrame] = {}

    def __len__(self) -> int:
        """The frames of the sequence."""
        return self._sequence.frames

    @overload
    def __getitem__(self, index: int) -> ObserverFrame: ...
    @overload
    def __getitem__(self, index: slice) -> list[ObserverFrame]: ...
    def __getitem__(self, index: int | slice) -> ObserverFrame | list[ObserverFrame]:
        """The input of one frame, or of several."""
        if isinstance(index, slice):
            return [self[frame] for frame in range(len(self))[index]]
        frame = range(len(self))[index]
        look = self._kept.get(frame) or self._made(frame)
        if frame < _KEPT_LOOKS:
            self._kept[frame] = look
        return look

    def _made(self, frame: int) -> ObserverFrame:
        if self._camera is None or self._believed is None or self._sequence.clouds_world is not None:
            return _given(self._sequence, frame, self._camera)
        return self._simulated(frame, self._camera, self._believed)

    def _simulated(self, frame: int, camera: CameraCalibration, believed: CameraCalibration) -> ObserverFrame:
        sequence, conditions = self._sequence, self._conditions
        rng = np.random.default_rng([self._seed, frame])
        line, eye = centre_line(sequence.nodes_world[frame]), camera.T_world_camera.position_m
        dark = frame in self._dark
        ball = _ball(conditions, line.points_world, eye, frame / sequence.rate_hz)
        shown = np.full(FINE, not dark)
        shown &= ~behind_itself(line.points_world, sequence.radius_m, camera)
        if ball is not None:
            shown &= ~hides(ball, eye, line.points_world)
        points = stereo_cloud(line.points_world, shown, sequence.radius_m, conditions, camera, rng)
        if believed is not camera:
            points = in_assumed_frame(points, camera.T_world_camera, believed.T_world_camera)
        seen = Observation(
            stamp_ns=_stamp_ns(sequence, frame),
            points_world=points.astype(np.float32),
            calibration=believed,
            occlusion=None if ball is None else depth_image(ball, believed),
        )
        return ObserverFrame(seen=seen, pins=_pins(sequence, frame), visible=shown[line.nodes_at], dark=dark)


def _given(sequence: Sequence, frame: int, camera: CameraCalibration | None) -> ObserverFrame:
    assert sequence.clouds_world is not None
    padded = np.asarray(sequence.clouds_world[frame], dtype=np.float64)
    points = padded[np.all(np.isfinite(padded), axis=1)]
    # A recorded cloud has no labels: a node counts as visible where points are near.
    near = np.zeros(sequence.count, dtype=np.bool_)
    if len(points) > 0 and np.isfinite(sequence.nodes_world[frame]).all():
        near = np.asarray(KDTree(points).query(sequence.nodes_world[frame])[0]) < _SHOWN_WITHIN_M
    seen = Observation(stamp_ns=_stamp_ns(sequence, frame), points_world=points.astype(np.float32), calibration=camera)
    return ObserverFrame(seen=seen, pins=_pins(sequence, frame), visible=near)


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
