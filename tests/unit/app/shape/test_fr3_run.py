"""A run with an FR3, whose velocity limits fall towards the ends of its joints."""

from pathlib import Path

import numpy as np
import pytest

from dlokit.app.commands import execute
from dlokit.description.arm.franka import FR3
from dlokit.errors import EXIT_OTHERWISE
from dlokit.functional.cell.arm import CellArm
from dlokit.types.robot import JointTrajectory

_FINE = 20
"""Steps between two samples of a trajectory at which the executed curve is compared."""


def speeds_over_limits(trajectory: JointTrajectory) -> float:
    """Largest ratio of a joint's speed, by differences of the executed curve, to its limit at the angle there."""
    t, q, dq = trajectory.times_s, trajectory.q_rad, trajectory.dq_rad_s
    # What an arm executes between samples: the cubic through angles and velocities.
    u = np.linspace(0.0, 1.0, _FINE + 1)[None, :, None]
    h = np.diff(t)[:, None, None]
    a, b, va, vb = q[:-1, None], q[1:, None], dq[:-1, None] * h, dq[1:, None] * h
    curve = (2 * u**3 - 3 * u**2 + 1) * a + (u**3 - 2 * u**2 + u) * va + (3 * u**2 - 2 * u**3) * b + (u**3 - u**2) * vb
    speed = np.diff(curve, axis=1) / (h / _FINE)
    limit = FR3.limits.velocity_at((curve[:, 1:] + curve[:, :-1]) / 2.0, speed)
    return float(np.max(np.abs(speed) / np.maximum(limit, 1e-6)))


@pytest.mark.heavy
def test_no_motion_of_a_run_exceeds_the_velocity_limits_at_its_angles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    executed = list[JointTrajectory]()
    follow = CellArm.start_follow

    def noted(arm: CellArm, trajectory: JointTrajectory, now_s: float) -> None:
        executed.append(trajectory)
        follow(arm, trajectory, now_s)

    monkeypatch.setattr(CellArm, "start_follow", noted)
    run = [
        "--headless",
        "--no-record",
        "--goal",
        "S",
        "--seed",
        "3",
        "--max-actions",
        "1",
        "--planner",
        "farthest",
        "--out",
        str(tmp_path / "run"),
    ]
    assert execute(["shape", "--arm", "fr3", *run]) == EXIT_OTHERWISE
    assert len(executed) > 5  # camera check, approach, descent, path, retreat, home
    ratios = [speeds_over_limits(trajectory) for trajectory in executed]
    assert max(ratios) < 1.001  # differences over a twentieth of a sample are that good
    assert max(ratios) > 0.5  # the limits are worth a test: some motion comes near them
