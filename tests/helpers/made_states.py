"""States of an arm for tests: each changes what matters to it, by `msgspec.structs.replace`."""

import numpy as np

from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT, RobotMode, RobotState

ARM_AT_REST = RobotState(
    stamp_ns=0,
    robot=FIRST_ROBOT,
    q_rad=np.zeros(7),
    dq_rad_s=np.zeros(7),
    tau_nm=np.zeros(7),
    T_world_tcp=Pose(position_m=np.zeros(3), wxyz=np.array([1.0, 0.0, 0.0, 0.0])),
    finger_width_m=0.04,
    mode=RobotMode.IDLE,
)
"""The first arm, which holds nothing; its tool is at the origin of the world."""
