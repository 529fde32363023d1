"""Timing of the cell: the lease of a motion, the rate of the ticks, interpolation of set-points."""

from pathlib import Path

import numpy as np
import pytest

from dlokit.description.arm.franka import PANDA
from dlokit.functional.cell.component import Pace, Watchdog
from dlokit.functional.cell.config import TICK_S, CellConfig
from dlokit.functional.cell.setpoints import Fade, Follow
from dlokit.functional.cell.truth import TruthRecorder
from dlokit.functional.cell.world import Cell
from dlokit.motion.trajectories import joint_move
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointTrajectory


def test_a_lease_expires_only_without_renewals():
    watchdog = Watchdog(longest_tick_s=0.02)
    watchdog.arm(0.1)
    assert not any(watchdog.expired(k * 0.01) for k in range(10))
    watchdog.renew()
    assert not any(watchdog.expired(0.1 + k * 0.01) for k in range(10))
    assert any(watchdog.expired(0.2 + k * 0.01) for k in range(3))


def test_time_in_which_the_cell_could_not_receive_does_not_count():
    watchdog = Watchdog(longest_tick_s=0.02)
    watchdog.arm(0.1)
    assert not watchdog.expired(0.0)
    assert not watchdog.expired(5.0)  # the cell rendered, or the machine was suspended; renewals wait in the queue


def test_nothing_expires_without_a_motion():
    watchdog = Watchdog(longest_tick_s=0.02)
    watchdog.arm(0.01)
    watchdog.arm(None)
    assert not any(watchdog.expired(float(k)) for k in range(100))


def test_ticks_that_are_late_are_caught_up_but_not_a_long_pause():
    pace = Pace(1.0, 0)
    assert pace.next_ns(0) == 10_000_000
    assert pace.next_ns(35_000_000) == 20_000_000  # three ticks late: no delay until the lag is recovered
    assert pace.next_ns(9_000_000_000) == 8_900_000_000  # after a pause, at most 0.1 s is recovered


def test_half_pace_takes_twice_the_time_and_is_reported():
    pace = Pace(0.5, 0)
    now_ns = 0
    for _ in range(300):
        now_ns = pace.next_ns(now_ns)
    assert now_ns == 300 * 20_000_000
    assert pace.real_time_factor == pytest.approx(0.5, rel=0.01)  # a running mean of 50 ticks


def test_the_interpolation_is_smooth_between_samples():
    times = np.linspace(0.0, 1.0, 6)
    q, dq, ddq = np.sin(times)[:, None], np.cos(times)[:, None], -np.sin(times)[:, None]
    follow = Follow(JointTrajectory(times_s=times, q_rad=q, dq_rad_s=dq, ddq_rad_s2=ddq), start_s=2.0)
    # Cubic Hermite over 0.2 s errs by h⁴/384 max|q⁗| = 4e-6 rad; linear velocity by h²/8 = 5e-3 rad/s.
    for s in np.linspace(0.0, 1.0, 31):
        now = follow.at(2.0 + s)
        assert now.q_rad[0] == pytest.approx(np.sin(s), abs=5e-6)
        assert now.dq_rad_s[0] == pytest.approx(np.cos(s), abs=6e-3)
    assert follow.at(9.0).q_rad[0] == pytest.approx(np.sin(1.0))


@pytest.mark.parametrize("offset_rad", [1e-5, -3e-4, 0.02])
def test_a_motion_that_begins_near_the_last_set_point_continues_without_a_jump(offset_rad: float) -> None:
    offset = offset_rad * np.array([1.0, -1.0, 0.5, 0.2, -0.3, 1.0, 0.0])
    planned = joint_move(PANDA.home_q_rad, PANDA.home_q_rad + 0.3, PANDA.limits)
    follow = Follow(planned, 0.0, Fade(offset, PANDA.limits))
    assert_joined(np.array([follow.at(t).q_rad for t in np.arange(-0.1, follow.end_s + 0.1, STEP_S)]))
    np.testing.assert_allclose(follow.at(0.0).q_rad, planned.q_rad[0] + offset, atol=1e-12)
    np.testing.assert_allclose(follow.at(follow.end_s).q_rad, planned.q_rad[-1], atol=1e-12)


def assert_joined(q_rad: Float64Array) -> None:
    """Hold set-points (K, 7), a physics step apart, to velocity, acceleration and jerk by their differences."""
    velocity, acceleration, jerk = (np.diff(q_rad, n, axis=0) / STEP_S**n for n in (1, 2, 3))
    assert np.all(np.abs(velocity) <= PANDA.limits.velocity_rad_s)
    # Between samples a cubic piece needs up to 5/3 of the motion's acceleration.
    assert np.all(np.abs(acceleration) <= 5.0 / 3.0 * PANDA.limits.acceleration_rad_s2)
    assert np.all(np.abs(jerk) <= PANDA.limits.jerk_rad_s3)


STEP_S = 0.0025


def test_the_truth_is_kept_while_the_cell_runs_on(tmp_path: Path):
    cell = Cell(CellConfig(), seed=0)
    recorder = TruthRecorder(tmp_path / "run")
    cell.begin_at(5_000_000_000)
    for _ in range(25):
        recorder.note(cell)
        cell.step(TICK_S)
    recorder.write()
    with np.load(tmp_path / "run" / "truth.npz") as truth:
        assert truth["stamps_ns"].tolist() == [5_000_000_000, 5_100_000_000, 5_200_000_000]
        assert truth["nodes_world"].shape == (3, 41, 3)
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["truth.npz"]
