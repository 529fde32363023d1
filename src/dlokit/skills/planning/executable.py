"""Whether the arms can execute an action among the fixtures: its motions, planned and checked as the robot does it.

The hand's room is checked for every candidate (`room`). This checks the whole arm, with the real trajectories, for the
action that is chosen, so that the robot does not refuse a motion in the middle of it.
"""

from collections.abc import Callable, Mapping
from functools import partial

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

_Plan = Callable[[Float64Array], JointTrajectory]
"""Plans a motion from joint angles (J,) [rad]."""


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

    def reached(start_q_rad: Float64Array, plan: _Plan, width_m: float, *, over: bool = False) -> Float64Array:
        """The joint angles (J,) [rad] after a motion."""
        return planned(kinematics, partial(plan, start_q_rad), fixtures, width_m, over=over).q_rad[-1]

    def along(*poses: Pose) -> _Plan:
        return partial(tool_move, kinematics, poses=poses, velocity=part.velocity)

    def check_fingers(q_rad: Float64Array, *widths_m: float) -> None:
        check_fixtures_clear(arm, q_rad, widths_m, fixtures, kinematics.T_world_base)

    to_grasp = partial(pose_move, kinematics, T_world_tcp=lifted(grasp.T_world_tcp, APPROACH_HEIGHT_M), yaw=Yaw.EITHER)
    above = reached(arm.home_q_rad, to_grasp, grasp.opening_m, over=True)
    down = reached(above, along(grasp.T_world_tcp), grasp.opening_m)
    check_fingers(down, grasp.opening_m, held_m)
    there = reached(down, along(*part.path), held_m)
    check_fingers(there, held_m, grasp.opening_m)
    up = reached(there, along(lifted(kinematics.forward(there), APPROACH_HEIGHT_M)), grasp.opening_m)
    reached(up, partial(joint_move, end_q_rad=arm.home_q_rad, limits=arm.limits), grasp.opening_m, over=True)
