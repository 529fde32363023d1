import numpy as np
import pytest
from board_pictures import BOARD, T_TCP_BOARD, angles, lens_camera, view

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.errors import SkillFailure
from dlokit.extras.calibration.latency import LatencyFit, StampedView, ToolTrack, fit_latency
from dlokit.motion.forward_kinematics import tcp_matrices, tcp_pose
from dlokit.motion.trajectories import joint_move
from dlokit.types.arrays import Float64Array

CAMERA = lens_camera()
STATE_S = 0.02


def motion() -> tuple[Float64Array, Float64Array]:
    """Times (K,) [s] and joint angles (K, 7) of an arm that moves back and forth, with a rest before and after."""
    poses = angles(3)
    pieces = [np.tile(poses[0], (100, 1))]
    for start, end in zip((*poses, *poses[1::-1]), (*poses[1:], *poses[1::-1], poses[1]), strict=False):
        move = joint_move(start, end, PANDA.limits)
        at_s = np.arange(0.0, move.times_s[-1], 0.01)
        pieces.append(np.column_stack([np.interp(at_s, move.times_s, q) for q in move.q_rad.T]))
    pieces.append(np.tile(pieces[-1][-1], (100, 1)))
    q = np.concatenate(pieces)
    return np.linspace(0.0, 0.01 * (len(q) - 1), len(q)), q


def fitted(
    late_s: float, *, moves: bool = True, pictures_s: float = 0.1, unit: float = 1.0, first: int = 0
) -> LatencyFit:
    """The fit; states are in other units, and with another number of their quaternion first, than they should be."""
    at_s, q = motion()
    if not moves:
        q = np.tile(q[0], (len(q), 1))
    rng = np.random.default_rng(1)
    states = slice(None, None, round(STATE_S / 0.01))
    T = tcp_matrices(PANDA, q[states])
    poses = [geometry.pose_from_matrix(one) for one in T]
    track = ToolTrack(
        stamps_ns=np.round(at_s[states] * 1e9).astype(np.int64),
        position_m=unit * np.array([one.position_m for one in poses]),
        wxyz=np.roll([one.wxyz for one in poses], first, axis=1),
    )
    views: list[StampedView] = []
    for exposed_s in np.arange(0.9, at_s[-1] - 0.9, pictures_s):
        here = np.array([np.interp(exposed_s, at_s, joint) for joint in q.T])
        # The arm is off by 0.1° at each joint, and the board is printed too large.
        tool = tcp_pose(PANDA, here - np.radians(0.1))
        board = geometry.compose(tool, T_TCP_BOARD)
        corners = geometry.transform(board, 1.002 * BOARD.corners_board)
        stamp_ns = round((exposed_s + late_s) * 1e9)
        views.append(StampedView(view=view(corners, CAMERA, 0, rng), stamp_ns=stamp_ns))
    return fit_latency(views, track, BOARD, CAMERA)


@pytest.mark.parametrize("late_s", [0.08, 0.0, -0.03, 0.25])
def test_the_offset_of_the_stamps_is_found(late_s: float):
    fit = fitted(late_s)
    assert fit.late_s == pytest.approx(late_s, abs=0.001)  # a fifth of what is asked for
    assert abs(fit.late_s - late_s) < fit.uncertainty_s + 0.0005
    assert fit.rms_px < 0.6
    assert late_s == 0.0 or fit.uncorrected_rms_px > 2 * fit.rms_px


def test_a_board_that_stands_still_tells_nothing():
    with pytest.raises(SkillFailure, match=r"not_determined|out_of_range"):
        fitted(0.08, moves=False)


def test_an_offset_beyond_the_search_is_refused():
    with pytest.raises(SkillFailure, match=r"few_pictures|out_of_range|not_determined"):
        fitted(5.0)


def test_few_pictures_are_refused():
    with pytest.raises(SkillFailure, match="few_pictures"):
        fitted(0.08, pictures_s=1.0)


@pytest.mark.parametrize(("unit", "first"), [(1000.0, 0), (1.0, -1)])
def test_states_in_other_units_or_orders_are_refused(unit: float, first: int):
    with pytest.raises(SkillFailure, match=r"(disagree|out_of_range).*in metres and w, x, y, z"):
        fitted(0.08, unit=unit, first=first)
