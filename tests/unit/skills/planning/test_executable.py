import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.scene import Box, Fixture, Post
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.skills.planning.executable import refusal
from dlokit.types.action import Drag, Grasp, PairPlace, Partner, PickPlace, VelocityProfile
from dlokit.types.pose import Pose

ARMS = {"first": ArmKinematics(PANDA)}
RADIUS_M = 0.004
DOWN_M = PANDA.gripper.grasp_height_m()
BETWEEN = Post(name="M", position_m=(0.55, 0.0, 0.0))
"""A post in the middle of the way, which a carry passes above and a drag does not."""


def pose(y_m: float, lift_m: float = 0.0) -> Pose:
    """A tool at x 0.55 m that opens along x."""
    return geometry.downward((0.55, y_m, DOWN_M + lift_m), np.pi / 2.0)


GRASP = Grasp(node=5, T_world_tcp=pose(-0.12), opening_m=0.05)
CARRY = PickPlace(
    stamp_ns=0, grasp=GRASP, path=(pose(-0.12, 0.07), pose(0.12, 0.07), pose(0.12)), velocity=VelocityProfile()
)
DRAG = Drag(
    stamp_ns=0, grasp=GRASP, path=(pose(-0.12, 0.004), pose(0.12, 0.004), pose(0.12)), velocity=VelocityProfile()
)


@pytest.mark.parametrize("action", [CARRY, DRAG])
def test_an_action_that_nothing_blocks_is_not_refused(action: PickPlace | Drag) -> None:
    assert refusal(ARMS, (Post(name="far", position_m=(0.75, 0.3, 0.0)),), RADIUS_M, action) == ""


def test_a_drag_into_a_post_is_refused_by_its_name_and_a_carry_over_it_is_not() -> None:
    assert "M" in refusal(ARMS, (BETWEEN,), RADIUS_M, DRAG)
    assert refusal(ARMS, (BETWEEN,), RADIUS_M, CARRY) == ""


@pytest.mark.parametrize(
    ("what", "fixture"),
    [
        ("open fingers descend", Post(name="X", position_m=(0.6, -0.12, 0.0))),
        ("fingers close", Post(name="X", position_m=(0.562, -0.12, 0.0), diameter_m=0.004)),
        ("fingers open", Post(name="X", position_m=(0.6, 0.12, 0.0))),
        ("a forearm passes", Box(name="X", position_m=(0.35, -0.05, 0.0), size_m=(0.05, 0.05, 0.55))),
    ],
)
def test_every_motion_of_an_action_counts(what: str, fixture: Fixture) -> None:
    assert "X" in refusal(ARMS, (fixture,), RADIUS_M, CARRY), what


def test_the_partner_of_a_pair_counts() -> None:
    facing = ArmKinematics(PANDA, geometry.pose((1.04, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    partner = Partner(robot="second", grasp=GRASP, path=DRAG.path, velocity=VelocityProfile())
    pair = PairPlace(stamp_ns=0, grasp=GRASP, path=CARRY.path, velocity=VelocityProfile(), partner=partner)
    assert "M" in refusal({**ARMS, "second": facing}, (BETWEEN,), RADIUS_M, pair)
