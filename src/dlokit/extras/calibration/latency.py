"""Latency of a camera's stamps, from pictures of a board in the hand of a moving arm.

A picture shows the board's position, and the arm's states give the hand's position at every time. With stamps that are
late by tau, a picture of stamp t was exposed at t - tau; for a wrong tau the moving hand is off its place in the
picture, to one side in forward motion and to the other in backward motion. One robust least squares over all corners
finds tau, the board's pose in the hand, the scale of the print, and small errors of the camera's pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import scipy
from scipy.spatial.transform import Rotation, Slerp

from dlokit import geometry
from dlokit.description.board import CharucoBoard
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.charuco import BoardView
from dlokit.extras.calibration.hand_eye import motion
from dlokit.extras.calibration.stereo_rig import board_in_camera, ideal_pixels, rms_px
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

FEWEST_MOVING = 30
"""Least number of pictures of the board in motion for a fit."""
LONGEST_S = 0.5
"""Largest offset of the stamps in the search, to either side [s]; no camera needs longer for a picture."""
LARGEST_UNCERTAINTY_S = 0.005
"""Largest accepted uncertainty of the result [s]: in 5 ms a hand at 0.3 m/s moves by 1.5 mm."""
_STEP_S = 0.005
"""Step of the first search [s]; the fit refines its result."""
_BLOCKS = 8
"""Number of parts of the motion; each is omitted in turn to estimate the uncertainty of the result."""
_T_BLOCKS = 2.365
"""Student's t of 95 % for one degree of freedom less than the number of parts."""
_NOISE_PX = 0.3
"""Standard deviation of a corner in a picture, including errors of the arm [px]."""
_LARGEST_RMS_PX = 5.0
"""Ten times the error of corners in good pictures [px]; above it, states and pictures are of different motions."""
_OUTLIER = 3.0
"""Number of standard deviations above which errors count less."""
_CAMERA_SIGMA = np.repeat([np.radians(0.5), 0.005], 3)
"""Standard deviation of the turn [rad] and shift [m] of the camera against its calibration."""
_SCALE_SIGMA = 0.005
"""Standard deviation of the print's scale."""
_LATE, _BOARD, _CAMERA, _SCALE, _UNKNOWNS = 0, slice(1, 7), slice(7, 13), 13, 14


@dataclass(frozen=True, kw_only=True, eq=False)
class StampedView:
    """A board in a picture, and the picture's stamp."""

    view: BoardView
    stamp_ns: int


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolTrack:
    """Poses of the tool, from the states of the arm."""

    stamps_ns: Int64Array  # (S,) increasing
    position_m: Float64Array  # (S, 3) in the world
    wxyz: Float64Array  # (S, 4)

    @classmethod
    def of(cls, stamps_ns: Sequence[int] | Int64Array, poses: Sequence[Pose]) -> Self:
        """The track of a tool with these poses."""
        return cls(
            stamps_ns=np.array(stamps_ns, dtype=np.int64),
            position_m=np.array([T.position_m for T in poses]),
            wxyz=np.array([T.wxyz for T in poses]),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class LatencyFit:
    """Latency of a camera's stamps."""

    late_s: float
    """Stamp minus exposure [s]; negative if the stamps are early."""
    uncertainty_s: float
    """Half the 95 % interval of the latency [s], by omitting parts of the motion in turn."""
    rms_px: float
    """Error of the corners in the pictures, root mean square [px]."""
    uncorrected_rms_px: float
    """The same without a correction of the stamps [px]."""
    pictures: int


def fit_latency(
    views: Sequence[StampedView], track: ToolTrack, board: CharucoBoard, camera: CameraCalibration
) -> LatencyFit:
    """Find the latency of the stamps; `camera` is calibrated, with its pose.

    Raises `SkillFailure` few_pictures, out_of_range, disagree or not_determined.
    """
    problem = _LatencyProblem(views, track, board, camera)
    found = problem.fitted(problem.late_s)
    if (rms_px := problem.rms_px(found)) > _LARGEST_RMS_PX:
        raise SkillFailure(
            "disagree",
            f"with the best offset the corners are {rms_px:.0f} px from where the states have them, at most "
            f"{_LARGEST_RMS_PX:g} are accepted; give states in metres and w, x, y, z, and this camera's calibration",
        )
    kept = np.array_split(np.arange(problem.pictures), _BLOCKS)
    without = [problem.fitted(found[_LATE], ~np.isin(np.arange(problem.pictures), block))[_LATE] for block in kept]
    # Jackknife: the omitted parts are contiguous, because the arm's errors in successive pictures are similar.
    uncertainty_s = _T_BLOCKS * float(np.sqrt((_BLOCKS - 1) * np.var(without)))
    if uncertainty_s > LARGEST_UNCERTAINTY_S:
        raise SkillFailure(
            "not_determined",
            f"the pictures determine the offset of the stamps only to {uncertainty_s * 1e3:.1f} ms, "
            f"{LARGEST_UNCERTAINTY_S * 1e3:g} ms are needed; move the board faster, to and fro on one path, in "
            "more pictures",
        )
    return LatencyFit(
        late_s=float(found[_LATE]),
        uncertainty_s=uncertainty_s,
        rms_px=rms_px,
        uncorrected_rms_px=problem.rms_px(problem.fitted(0.0, fit_late=False)),
        pictures=problem.pictures,
    )


class _LatencyProblem:
    """The corners of all pictures as arrays, and their errors for given unknowns."""

    def __init__(
        self, views: Sequence[StampedView], track: ToolTrack, board: CharucoBoard, camera: CameraCalibration
    ) -> None:
        self._begin_ns = int(track.stamps_ns[0]) if len(track.stamps_ns) else 0
        at_s = (track.stamps_ns - self._begin_ns) * 1e-9
        last_s = float(at_s[-1]) if len(at_s) else 0.0
        seen = [
            (stamp_s, one.view, geometry.matrix(T))
            for one in views
            if LONGEST_S <= (stamp_s := (one.stamp_ns - self._begin_ns) * 1e-9) <= last_s - LONGEST_S
            and (T := board_in_camera(one.view, board.corners_board, camera)) is not None
        ]
        if len(seen) < FEWEST_MOVING:
            raise SkillFailure(
                "few_pictures",
                f"{len(seen)} pictures show the board at a time for which states of the arm are known from "
                f"{LONGEST_S:g} s before to {LONGEST_S:g} s after, at least {FEWEST_MOVING} are needed; are pictures "
                "and states stamped by the same clock?",
            )
        self.pictures = len(seen)
        self._stamps_s = np.array([stamp_s for stamp_s, _, _ in seen])
        self._T_camera_board = np.array([T for _, _, T in seen])
        self._turns = Slerp(at_s, Rotation.from_quat(track.wxyz, scalar_first=True))
        self._at_s, self._position_m = at_s, track.position_m
        self._T_world_camera = geometry.matrix(camera.T_world_camera)
        counts = [len(view.numbers) for _, view, _ in seen]
        self._shot: Int64Array = np.repeat(np.arange(len(seen)), counts)
        self._corners_board = board.corners_board[np.concatenate([view.numbers for _, view, _ in seen])]
        self._pixels = np.concatenate([ideal_pixels(view, camera, 0) for _, view, _ in seen])
        self._focal = np.array([camera.fx_px, camera.fy_px])
        self._centre = np.array([camera.cx_px, camera.cy_px])
        self.late_s = self._searched()
        """Start values of the fits [s]."""
        self._T_tcp_board = _mean_pose(self._in_hand(self.late_s))

    def fitted(self, late_s: float, keep: BoolArray | None = None, *, fit_late: bool = True) -> Float64Array:
        """The unknowns with the smallest errors in the pictures of a mask (N,), fitted from a start offset."""
        x = np.zeros(_UNKNOWNS)
        x[_LATE] = late_s
        rows = np.ones(len(self._shot), dtype=np.bool_) if keep is None else keep[self._shot]
        free = np.arange(_UNKNOWNS) if fit_late else np.arange(_UNKNOWNS)[1:]

        def residuals(part: Float64Array) -> Float64Array:
            now = x.copy()
            now[free] = part
            prior = np.append(now[_CAMERA] / _CAMERA_SIGMA, now[_SCALE] / _SCALE_SIGMA)
            return np.concatenate([self.errors_px(now)[rows].ravel() / _NOISE_PX, prior])

        fit: Any = scipy.optimize.least_squares(residuals, x[free], loss="soft_l1", f_scale=_OUTLIER, x_scale="jac")
        x[free] = fit.x
        return x

    def errors_px(self, x: Float64Array) -> Float64Array:
        """Errors (K, 2) [px] of all corners."""
        T_world_camera = self._T_world_camera @ motion(x[_CAMERA])
        T_tcp_board = self._T_tcp_board @ motion(x[_BOARD])
        T = (np.linalg.inv(T_world_camera) @ self._tools(x[_LATE]) @ T_tcp_board)[self._shot]
        p = np.einsum("nij,nj->ni", T[:, :3, :3], np.exp(x[_SCALE]) * self._corners_board) + T[:, :3, 3]
        return self._focal * p[:, :2] / p[:, 2:] + self._centre - self._pixels

    def rms_px(self, x: Float64Array) -> float:
        """Root mean square of the errors [px]."""
        return rms_px(self.errors_px(x))

    def _searched(self) -> float:
        """The grid offset [s] with the least motion of the board in the hand. Raises `SkillFailure` out_of_range."""
        grid_s = np.arange(-LONGEST_S, LONGEST_S + _STEP_S / 2, _STEP_S)
        spreads = [self._spread_m(float(late_s)) for late_s in grid_s]
        best = int(np.argmin(spreads))
        if best in (0, len(grid_s) - 1):
            raise SkillFailure(
                "out_of_range",
                f"within {LONGEST_S:g} s to either side no offset of the stamps makes pictures and states agree; are "
                "they stamped by the same clock, the states in metres and w, x, y, z, and is the camera's pose that of "
                "its calibration?",
            )
        return float(grid_s[best])

    def _tools(self, late_s: float) -> Float64Array:
        """``T_world_tcp`` (N, 4, 4) at the exposures."""
        when_s = np.clip(self._stamps_s - late_s, self._at_s[0], self._at_s[-1])
        T = np.tile(np.eye(4), (len(when_s), 1, 1))
        T[:, :3, :3] = self._turns(when_s).as_matrix()
        T[:, :3, 3] = np.column_stack([np.interp(when_s, self._at_s, axis) for axis in self._position_m.T])
        return T

    def _in_hand(self, late_s: float) -> Float64Array:
        """``T_tcp_board`` (N, 4, 4) from each picture."""
        return np.linalg.inv(self._tools(late_s)) @ self._T_world_camera @ self._T_camera_board

    def _spread_m(self, late_s: float) -> float:
        """Distances of the board's centre in the hand from its place in the median picture [m]."""
        middle = np.append(self._corners_board.mean(axis=0), 1.0)
        places = (self._in_hand(late_s) @ middle)[:, :3]
        return float(np.mean(np.linalg.norm(places - np.median(places, axis=0), axis=1)))


def _mean_pose(T: Float64Array) -> Float64Array:
    """The median place and the mean turn of poses (N, 4, 4)."""
    turn = Rotation.from_matrix(T[:, :3, :3]).mean()
    return geometry.homogeneous(turn.as_matrix(), np.median(T[:, :3, 3], axis=0))
