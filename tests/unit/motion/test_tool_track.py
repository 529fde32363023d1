import numpy as np
from scipy.spatial import KDTree

from dlokit.description.arm.franka import PANDA
from dlokit.geometry import downward
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.tool_path import split_at_turns
from dlokit.motion.tool_track import tool_track
from dlokit.motion.trajectories import tool_move
from dlokit.types.action import VelocityProfile

WAYPOINTS = np.array(
    [
        [0.5, -0.1, 0.011, 0.0],
        [0.5, -0.1, 0.051, 0.0],
        [0.5, 0.15, 0.051, 0.6],
        [0.42, 0.15, 0.051, 0.6],
        [0.42, 0.15, 0.011, 0.6],
    ]
)
"""x, y, z [m] and yaw [rad]: up, across, round another corner, down."""
PACE = VelocityProfile(speed_m_s=0.25, acceleration_m_s2=1.0, jerk_m_s3=10.0)
STEP_S = 0.01


def test_a_rollout_moves_the_tool_on_the_path_and_in_the_time_of_the_robot() -> None:
    poses = tuple(downward(place[:3], float(place[3])) for place in WAYPOINTS)
    track = tool_track(WAYPOINTS, PACE.speed_m_s, PACE.acceleration_m_s2, PACE.jerk_m_s3, STEP_S)
    (path,) = split_at_turns(poses[0], poses[1:])
    robot = np.array([path.pose(s).position_m for s in np.linspace(0.0, path.length_m, 5000)])
    assert KDTree(robot).query(track[:, :3])[0].max() < 0.001  # resolution of the rollout's grid
    kinematics = ArmKinematics(PANDA)
    planned = tool_move(kinematics, kinematics.inverse(poses[0]), poses[1:], PACE)
    assert abs(STEP_S * len(track) / planned.times_s[-1] - 1.0) < 0.1
