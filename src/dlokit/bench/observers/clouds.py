"""What observers get to see of a sequence: a cloud a frame, and what a camera and a robot know besides."""

from collections.abc import Sequence as Ordered
from dataclasses import dataclass
from typing import overload

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dlokit.bench.observers.conditions import (
    Ball,
    Conditions,
    ball_hiding,
    behind_itself,
    dark_frames,
    depth_image,
    hides,
)
from dlokit.bench.observers.sequence import FINE, Sequence, centre_line
from dlokit.bench.observers.stereo import as_believed, believed_pose, camera_of, moved, stereo_cloud
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import GripperPin, Observation

_MOVING_PERIOD_S = 2.0  # in which a moving ball goes along the DLO and back
_KEPT_LOOKS = 200  # of some 60 kB; later ones of a long sequence are made anew for every method
_SHOWN_WITHIN_M = 0.015  # a node of a recorded cloud counts as visible with a point so near


@dataclass(frozen=True, kw_only=True)
class ObserverFrame:
    """What every observer gets to see of one frame, and which nodes it could have seen."""

    seen: Observation
    pins: tuple[GripperPin, ...]
    """What the robot knows besides; for the pinned rows alone."""
    visible: NDArray[np.bool_]  # (K,) the truth
    dark: bool = False
    """Whether the case let nothing be seen."""


class Looks(Ordered[ObserverFrame]):
    """Every frame of a sequence as a cloud; made when it is asked for, and the same each time."""

    def __init__(self, sequence: Sequence, conditions: Conditions, seed: int) -> None:
        """The clouds that a seed stands for."""
        self._sequence = sequence
        self._conditions = conditions
        self._seed = seed
        self._dark = dark_frames(conditions, sequence.frames, sequence.rate_hz)
        self._camera = self._believed = camera_of(sequence)
        if self._camera is not None and (conditions.camera_error_m or conditions.camera_error_rad):
            rng = np.random.default_rng([seed, sequence.frames])
            self._believed = moved(self._camera, believed_pose(self._camera.T_world_camera, conditions, rng))
        self._kept: dict[int, ObserverFrame] = {}

    def __len__(self) -> int:
        """The frames of the sequence."""
        return self._sequence.frames

    @overload
    def __getitem__(self, index: int) -> ObserverFrame: ...
    @overload
    def __getitem__(self, index: slice) -> list[ObserverFrame]: ...
    def __getitem__(self, index: int | slice) -> ObserverFrame | list[ObserverFrame]:
        """The look of a frame, or of some."""
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
            points = as_believed(points, camera.T_world_camera, believed.T_world_camera)
        seen = Observation(
            stamp_ns=_stamp_ns(sequence, frame),
            points_world=points.astype(np.float32),
            calibration=believed,
            occlusion=None if ball is None else depth_image(ball, believed),
        )
        return ObserverFrame(seen=seen, pins=_pins(sequence, frame), visible=shown[line.nodes_at], dark=dark)


def looks(sequence: Sequence, conditions: Conditions, seed: int) -> Looks:
    """Every frame of a sequence as a cloud; the same for the same seed."""
    return Looks(sequence, conditions, seed)


def with_pins(look: ObserverFrame) -> Observation:
    """What the look shows, and what the robot knows."""
    return msgspec.structs.replace(look.seen, pins=look.pins)


def _given(sequence: Sequence, frame: int, camera: CameraCalibration | None) -> ObserverFrame:
    assert sequence.clouds_world is not None
    padded = np.asarray(sequence.clouds_world[frame], dtype=np.float64)
    points = padded[np.all(np.isfinite(padded), axis=1)]
    # Nobody says what was hidden in a recorded cloud: a node is seen where points are.
    near = np.zeros(sequence.count, dtype=np.bool_)
    if len(points) > 0:
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
