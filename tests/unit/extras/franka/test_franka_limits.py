"""Motions keep the joints' limits with a margin, and the model's limits are those of the arm that answers."""

import re

import numpy as np
import pytest

from dlokit.description.arm.franka import FR3
from dlokit.extras.franka.limits import MOST_SPEED, below_speed_limits, beyond_limits
from dlokit.motion.limits import scaled, speed_ratio
from dlokit.motion.trajectories import joint_move

# What an FR3 says of itself, by the description that franky-sim and franka-sim send.
RANGES = ((2.9007, 0.652), (1.8361, 0.25), (2.9007, 0.2005), None, (2.8763, 0.35), None, (3.0508, 0.4592))
DECELERATION = (6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0)
VELOCITY = (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26)


def joint(number: int) -> str:
    half = RANGES[number]
    lower, upper, offset = (-half[0], half[0], half[1]) if half else (-3.077, -0.1169, 0.3542)
    if number == 5:
        lower, upper, offset = 0.4398, 4.6216, 0.4885
    return (
        f'<joint name="fr3_joint{number + 1}" type="revolute">'
        f'<limit effort="12" lower="{lower}" upper="{upper}" velocity="{VELOCITY[number]}"/>'
        f'<position_based_velocity_limits deceleration_limit="{DECELERATION[number]}" velocity_offset="{offset}"/>'
        "</joint>"
    )


URDF = f"<robot>{''.join(map(joint, range(7)))}<joint name='finger' type='prismatic'/></robot>"


def test_a_motion_at_a_joints_speed_limit_runs_slower_along_the_same_path() -> None:
    fast = joint_move(FR3.home_q_rad, FR3.home_q_rad + np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), FR3.limits)
    assert speed_ratio(fast, FR3.limits) > 0.95
    run = below_speed_limits(fast, FR3)
    assert speed_ratio(run, FR3.limits) == pytest.approx(MOST_SPEED)
    np.testing.assert_array_equal(run.q_rad, fast.q_rad)
    slow = scaled(fast, 0.8)
    assert below_speed_limits(slow, FR3) is slow


def test_the_model_keeps_within_what_an_fr3_says_of_itself() -> None:
    assert beyond_limits(FR3, URDF) == ""
    assert beyond_limits(FR3, "") == ""


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        (('lower="-1.8361"', 'lower="-1.7"'), "joint 2 turns from -1.7837 to 1.7837 rad .* the arm allows -1.7000"),
        (('velocity="4.18"', 'velocity="2.0"'), "joint 6 moves at up to 3.762 rad/s"),
        (
            ('velocity_offset="0.652"', 'velocity_offset="2.0"'),
            "joint 1 moves at up to .* more than the arm allows",
        ),
        (('lower="-1.8361"', ""), "no limits for seven joints"),
        (('velocity="4.18"', 'velocity="nan"'), "no limits for seven joints"),
        (('velocity_offset="0.652"', ""), "no limits for seven joints"),
        (("</robot>", ""), "no limits for seven joints"),
        (('name="fr3_joint7" type="revolute"', 'name="fr3_joint7" type="fixed"'), "no limits for seven joints"),
    ],
)
def test_limits_that_the_arm_does_not_allow_are_named(change: tuple[str, str], wrong: str) -> None:
    urdf = URDF.replace(*change)
    assert urdf != URDF
    assert re.search(wrong, beyond_limits(FR3, urdf))
