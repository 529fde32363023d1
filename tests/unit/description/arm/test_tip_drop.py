"""Fingertips that move along an arc, as those of a Robotiq 2F-85: they are lower when they close."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.arm_file import read_arm
from dlokit.description.arm.franka import FRANKA_HAND, PANDA
from dlokit.description.arm.model import FINGER_LINKS, TIP_CLEARANCE_M
from dlokit.description.arm.mounts import UR5E_FILE
from dlokit.errors import CheckFailed, ConfigError, SkillFailure
from dlokit.motion.collisions import TABLE_CLEARANCE_M, check_collisions
from dlokit.motion.forward_kinematics import capsule_ends
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.testing import check_arm
from dlokit.types.arrays import Float64Array

ARC = ((0.0, 0.013), (0.02, 0.012), (0.06, 0.004), (0.08, 0.0))
"""Width and drop [m]."""
ARM = replace(PANDA, gripper=replace(FRANKA_HAND, tip_drop=ARC))


def grasping(height_m: float) -> Float64Array:
    """Joint angles (7,) [rad] of a grasp in the middle of the table."""
    return ArmKinematics(ARM).inverse(geometry.downward((0.5, 0.0, height_m), np.pi / 4.0))


def lowest_tip_m(q_rad: Float64Array, width_m: float) -> float:
    start, end = capsule_ends(ARM, q_rad, width_m)
    fingers = np.array([capsule.link in FINGER_LINKS for capsule in ARM.capsules])
    return float((np.minimum(start[0, :, 2], end[0, :, 2]) - ARM.radii_m)[fingers].min())


def test_the_drop_is_interpolated_and_none_where_the_tips_move_straight() -> None:
    assert ARM.gripper.tip_drop_m(0.04) == pytest.approx(0.008)
    assert FRANKA_HAND.tip_drop_m(0.0) == 0.0
    assert FRANKA_HAND.grasp_height_m() == pytest.approx(FRANKA_HAND.tip_below_tcp_m + TIP_CLEARANCE_M)


def test_while_the_fingers_close_on_the_table_they_clear_it_at_every_width() -> None:
    q = grasping(ARM.gripper.grasp_height_m())
    heights_m = [lowest_tip_m(q, width_m) for width_m in np.linspace(0.0, 0.08, 17)]
    assert min(heights_m) >= TABLE_CLEARANCE_M
    assert heights_m[0] == pytest.approx(heights_m[-1] - 0.013)
    check_collisions(ARM, q[None, :])


def test_a_grasp_that_only_open_fingers_survive_is_refused() -> None:
    q = grasping(FRANKA_HAND.grasp_height_m())
    check_collisions(PANDA, q[None, :])
    with pytest.raises(SkillFailure, match="finger would come"):
        check_collisions(ARM, q[None, :])


def test_the_check_of_an_arm_accepts_an_arc_and_refuses_one_that_is_measured_otherwise() -> None:
    check_arm(ARM)
    with pytest.raises(CheckFailed, match="tip_drop is not 0 at open_width_m"):
        check_arm(replace(PANDA, gripper=replace(FRANKA_HAND, tip_drop=((0.0, 0.0), (0.08, 0.013)))))


def with_arc(folder: Path, arc: str) -> Path:
    path = folder / "arm.toml"
    path.write_text(UR5E_FILE.read_text() + f"\ntip_drop = {arc}\n")
    return path


def test_an_arm_file_says_the_arc(tmp_path: Path) -> None:
    pytest.importorskip("airo_models", reason="the extra dlokit[arms] is not installed")
    path = with_arc(tmp_path, "[[0.0, 0.006], [0.05, 0.0]]")
    gripper = read_arm(path, str(path)).gripper
    assert gripper.tip_drop_m(0.025) == pytest.approx(0.003)
    assert gripper.grasp_height_m() == pytest.approx(gripper.tip_below_tcp_m + 0.006 + TIP_CLEARANCE_M)


@pytest.mark.parametrize("arc", ["[[0.02, 0.0], [0.01, 0.0]]", "[[0.0, -0.001]]", "[[0.06, 0.0]]"])
def test_an_arc_that_cannot_be_is_refused(arc: str, tmp_path: Path) -> None:
    pytest.importorskip("airo_models", reason="the extra dlokit[arms] is not installed")
    path = with_arc(tmp_path, arc)
    with pytest.raises(ConfigError, match="tip_drop"):
        read_arm(path, str(path))
