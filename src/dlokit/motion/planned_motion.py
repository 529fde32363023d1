"""Motions that are planned and checked, and joint moves that go over the fixtures in their way. Pure."""

import itertools
from collections.abc import Callable

from dlokit.description.scene import Fixture
from dlokit.errors import SkillFailure
from dlokit.geometry import lifted
from dlokit.motion.collisions import COLLISION_STEP_RAD, check_collisions, thinned
from dlokit.motion.fixture_checks import check_fixtures_clear
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.limits import check_limits
from dlokit.motion.trajectories import backwards, joined, joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointTrajectory, RobotReason

_BLOCKED: str = RobotReason.FIXTURE_COLLISION
_OVER_M = (0.015, 0.05, 0.1)
"""Heights of the fingertips above fixtures [m], tried one after the other: a joint move is not level."""


def planned(
    kinematics: ArmKinematics,
    plan: Callable[[], JointTrajectory],
    fixtures: tuple[Fixture, ...] = (),
    finger_width_m: float = 0.0,
    *,
    over: bool = False,
) -> JointTrajectory:
    """Plan a motion and check it against limits and collisions, in one trip to the worker pool.

    With `over` a motion that fixtures block is replaced by one over them: over the lowest, else over the next higher.
    Raises `SkillFailure` if a check or `plan` fails.
    """

    def checked(motion: JointTrajectory) -> JointTrajectory:
        arm, T_world_base = kinematics.arm, kinematics.T_world_base
        check_limits(motion, arm.limits)
        check_collisions(arm, thinned(motion.q_rad, COLLISION_STEP_RAD), T_world_base)
        check_fixtures_clear(arm, motion.q_rad, finger_width_m, fixtures, T_world_base)
        return motion

    direct = plan()
    try:
        return checked(direct)
    except SkillFailure as failure:
        if not over or failure.reason != _BLOCKED:
            raise
        blocked = higher = failure
    for top_m, over_m in itertools.product(sorted({fixture.top_m for fixture in fixtures}), _OVER_M):
        try:
            return checked(_via(kinematics, direct.q_rad[0], direct.q_rad[-1], top_m + over_m))
        except SkillFailure as failure:
            higher = failure
    raise SkillFailure(
        RobotReason.FIXTURE_COLLISION, f"{blocked.detail}; the arm cannot go over it either: {higher.detail}"
    ) from higher


def _via(
    kinematics: ArmKinematics, start_q_rad: Float64Array, end_q_rad: Float64Array, tips_m: float
) -> JointTrajectory:
    """Straight up until the fingertips are at a height [m], unless they are higher, a joint move, straight down."""
    gripper = kinematics.arm.gripper
    z_m = tips_m + gripper.tip_below_tcp_m + gripper.largest_tip_drop_m
    up, down = (_raised(kinematics, q_rad, z_m) for q_rad in (start_q_rad, end_q_rad))
    across = joint_move(up.q_rad[-1], down.q_rad[-1], kinematics.arm.limits)
    return joined([up, across, backwards(down, kinematics.arm.limits)])


def _raised(kinematics: ArmKinematics, q_rad: Float64Array, z_m: float) -> JointTrajectory:
    tool = kinematics.forward(q_rad)
    higher = lifted(tool, max(z_m - float(tool.position_m[2]), 0.0))
    return tool_move(kinematics, q_rad, (higher,), VelocityProfile())
