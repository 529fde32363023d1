"""Whether the arms can execute an action among the fixtures: its motions, planned and checked as the robot does it.

The hand's room is checked for every candidate (`room`). This checks the whole arm, with the real trajectories, for the
action that is chosen, so that the robot does not refuse a motion in the middle of it.
"""

from collections.abc import Callable, Mapping

import numpy as np

from dlokit.description.scene import Fixture
from dlokit.errors import SkillFailure
from dlokit.geometry import lifted
from dlokit.motion.fixture_checks import check_fixtures_clear
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.motion.planned_motion import planned
from dlokit.motion.trajectories import joint_move, pose_move, tool_move
from dlokit.skills.planning.room import held_width_m
from dlokit.types.action import APPROACH_HEIGHT_M, Action, Partner
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import JointTrajectory


def refusal(
    arms: Mapping[str, ArmKinematics], fixtures: tuple[Fixture, ...], dlo_radius_m: float, action: Action
) -> str:
    """Why the robot would refuse a motion of an action that begins and ends at home; empty if it would not.

    `arms` are by their names; those of a pair are checked one after the other.
    """
    try:
        for part in (action,) if action.partner is None else (action, action.partner):
            kinematics = arms[part.robot]
            gripper = kinematics.arm.gripper
            _try(kinematics, fixtures, part, held_width_m(gripper, dlo_radius_m) if action.facts.grasps else 0.0)
    except SkillFailure as failure:
        return str(failure)
    return ""


def _try(kinematics: ArmKinematics, fixtures: tuple[Fixture, ...], part: Action | Partner, held_m: float) -> None:
    """Plan and check all motions of one arm's part. Raises `SkillFailure`."""
    arm, grasp = kinematics.arm, part.grasp
    q = arm.home_q_rad

    def move(plan: Callable[[Float64Array], JointTrajectory], width_m: float, *, over: bool = False) -> None:
        nonlocal q
        q = planned(kinematics, lambda: plan(q), fixtures, width_m, over).q_rad[-1]

    def grip() -> None:
        widths_m = np.array([held_m, grasp.opening_m])
        check_fixtures_clear(arm, np.stack((q, q)), widths_m, fixtures, kinematics.T_world_base)

    above = lifted(grasp.T_world_tcp, APPROACH_HEIGHT_M)
    move(lambda q: pose_move(kinematics, q, above, Yaw.EITHER), grasp.opening_m, over=True)
    move(lambda q: tool_move(kinematics, q, (grasp.T_world_tcp,), part.velocity), grasp.opening_m)
    grip()
    move(lambda q: tool_move(kinematics, q, part.path, part.velocity), held_m)
    grip()
    move(lambda q: tool_move(kinematics, q, (_up(kinematics, q),), part.velocity), grasp.opening_m)
    move(lambda q: joint_move(q, arm.home_q_rad, arm.limits), grasp.opening_m, over=True)


def _up(kinematics: ArmKinematics, q_rad: Float64Array) -> Pose:
    """The tool's pose above its present one, at angles (J,) [rad]."""
    return lifted(kinematics.forward(q_rad), APPROACH_HEIGHT_M)
