"""Mistakes that people make in a URDF and its arm.toml: each is refused by name, or changes nothing.

A row is the mistake, the text of the good files that it replaces, what it writes there, and what is right: words of the
error, or `SAME` where the arm is read as from the good files.
"""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from dlokit.description.arm.arm_file import read_arm
from dlokit.description.arm.model import ArmModel
from dlokit.errors import InputError

SAME = ""
URDF = """<?xml version="1.0" encoding="utf-8"?>
<robot name="two">
  <link name="base"><collision><geometry><cylinder radius="0.05" length="0.1"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.2" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3.1" upper="3.1" velocity="2.5" effort="90"/></joint>
  <link name="upper"><inertial><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>
    </inertial><collision><geometry><box size="0.1 0.1 0.15"/></geometry></collision></link>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0 0.1 0.3" rpy="0 0 1.5708"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.6" velocity="3.5" effort="40"/></joint>
  <link name="fore"><inertial><mass value="1.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>
    </inertial><collision><geometry><sphere radius="0.06"/></geometry></collision></link>
</robot>
"""
TOML = """title = "Two joints"
description = "two.urdf"
home_q_rad = [0.1, -0.2]
acceleration_rad_s2 = [5.0, 6.0]
jerk_rad_s3 = [500.0, 600.0]
[flange]
position_m = [0.0, 0.0, 0.06]
rpy_rad = [0.0, 0.0, 1.5708]
[gripper]
title = "two sticks"
finger_m = 0.05
tcp_m = 0.11
tip_below_tcp_m = 0.01
pad_half_length_m = 0.012
pad_half_thickness_m = 0.005
open_width_m = 0.07
force_n = 30.0
finger_speed_m_s = 0.08
mass_kg = 0.5
body = [[0.0, 0.0, 0.0, 0.0, 0.0, 0.04, 0.04]]
finger = [[0.0, 0.013, 0.0, 0.0, 0.013, 0.05, 0.009]]
"""
BALL = '<sphere radius="0.06"/>'
ELBOW = 'lower="-2.5" upper="2.6" velocity="3.5" effort="40"'
LIMITS = "acceleration_rad_s2 = [5.0, 6.0]"
MISTAKES = (
    ("limits of no range", 'lower="-2.5" upper="2.6"', 'lower="1.2" upper="1.2"', "elbow .* from 1.2 to 1.2"),
    ("limits in degrees", 'lower="-2.5" upper="2.6"', 'lower="-145" upper="150"', "elbow .*150.* radians"),
    ("one limit in degrees", 'lower="-2.5" upper="2.6"', 'lower="-2.5" upper="174.5"', "elbow .*174.5.* radians"),
    ("a revolute joint without limits", 'lower="-2.5" upper="2.6"', "", "elbow .* from 0 to 0 rad, which is no range"),
    ("a limit with a decimal comma", 'lower="-2.5"', 'lower="-2,5"', "lower of elbow is -2,5: give a number"),
    ("a limit with spaces around it", 'upper="2.6"', 'upper=" 2.6 "', SAME),
    ("a velocity in degrees a second", 'velocity="3.5"', 'velocity="200"', "velocity.* elbow .*200"),
    ("an infinite velocity", 'velocity="3.5"', 'velocity="inf"', "velocity.* elbow .*inf"),
    ("a negative effort", 'effort="40"', 'effort="-40"', "torque_nm of elbow is -40"),
    ("an effort with its unit", 'effort="40"', 'effort="40 Nm"', "effort of elbow is 40 Nm: give a number"),
    ("an axis of length 0", '<axis xyz="0 1 0"/>', '<axis xyz="0 0 0"/>', "axis"),
    ("an axis of length 2", '<axis xyz="0 1 0"/>', '<axis xyz="0 2 0"/>', SAME),
    ("an axis of two numbers", '<axis xyz="0 1 0"/>', '<axis xyz="0 1"/>', "axis xyz of elbow is 0 1: give numbers"),
    ("a joint placed in millimetres", 'xyz="0 0.1 0.3"', 'xyz="0 100 300"', "fore .* metres"),
    ("a place with a decimal comma", 'xyz="0 0.1 0.3"', 'xyz="0 0,1 0,3"', "xyz of elbow is 0 0,1 0,3: give numbers"),
    ("a joint turned in degrees", 'rpy="0 0 1.5708"', 'rpy="0 0 90"', "rpy of elbow is 0 0 90: give radians"),
    ("a negative mass", '<mass value="1.5"/>', '<mass value="-1.5"/>', "mass"),
    ("an inertia that no body has", 'ixx="0.01"', 'ixx="-0.01"', "inertia"),
    ("a shape in millimetres", BALL, '<cylinder radius="60" length="300"/>', "fore .* metres"),
    ("a mesh in millimetres", BALL, '<mesh filename="part.stl"/>', "fore .* metres"),
    ("a mesh that is scaled twice", BALL, '<mesh filename="part.stl" scale="1e-6 1e-6 1e-6"/>', "fore .* metres"),
    ("a mesh that is missing", BALL, '<mesh filename="meshes/gone.stl"/>', "gone.stl"),
    (
        "the last link is missing",
        '<link name="fore">',
        '<link name="fore_link">',
        "elbow .* the link fore, which is not",
    ),
    ("two joints of one name", 'name="elbow"', 'name="shoulder"', "joint shoulder twice"),
    ("home outside the limits", "home_q_rad = [0.1, -0.2]", "home_q_rad = [0.1, -2.7]", "home_q_rad .* elbow .*-2.7"),
    ("home without a number", "home_q_rad = [0.1, -0.2]", "home_q_rad = [0.1, nan]", "home_q_rad .* elbow .*nan"),
    ("an acceleration of 0", LIMITS, "acceleration_rad_s2 = [5.0, 0.0]", "acceleration_rad_s2 .* elbow .*0.0"),
    ("a negative jerk", "[500.0, 600.0]", "[-500.0, 600.0]", "jerk_rad_s3 .* shoulder .*-500"),
    ("a torque of 0", LIMITS, f"{LIMITS}\ntorque_nm = [90.0, 0.0]", "torque_nm .* elbow .*0.0"),
    ("an empty row of limits", LIMITS, f"{LIMITS}\nposition_lower_rad = []", "position_lower_rad .* 0 numbers"),
    ("a flange in millimetres", "[0.0, 0.0, 0.06]", "[0.0, 0.0, 60.0]", "position_m .*60.* metres"),
    ("a flange in degrees", "[0.0, 0.0, 1.5708]", "[0.0, 0.0, 90.0]", "rpy_rad .*90.* radians"),
    ("fingers longer than the gripper", "finger_m = 0.05", "finger_m = 0.12", "finger_m is 0.12"),
    ("a force of 0", "force_n = 30.0", "force_n = 0.0", "force_n is 0.0"),
    ("fingers that do not move", "finger_speed_m_s = 0.08", "finger_speed_m_s = 0.0", "finger_speed_m_s is 0.0"),
    ("a gripper of negative mass", "mass_kg = 0.5", "mass_kg = -0.5", "mass_kg is .*-0.5"),
    ("a capsule of negative radius", "0.05, 0.009]]", "0.05, -0.009]]", "finger .*-0.009"),
    ("a capsule in millimetres", "0.04, 0.04]]", "40.0, 40.0]]", "body .*40.* metres"),
    ("a comment in Latin-1", 'title = "Two joints"', 'title = "Two joints"  # für', "UTF-8"),
)


def arm_of(folder: Path, urdf: str, toml: str) -> ArmModel:
    (folder / "two.urdf").write_text(urdf, encoding="utf-8")
    (folder / "two.toml").write_text(toml, encoding="latin-1")
    return read_arm(folder / "two.toml", "two.toml")


@pytest.mark.parametrize(("name", "good", "bad", "right"), MISTAKES, ids=[row[0] for row in MISTAKES])
def test_a_mistake_in_an_arms_files_is_named_or_changes_nothing(
    tmp_path: Path, name: str, good: str, bad: str, right: str
):
    assert URDF.count(good) + TOML.count(good) == 1, name
    if "part.stl" in bad:
        trimesh.creation.box(extents=(60.0, 60.0, 300.0)).export(tmp_path / "part.stl")
    urdf, toml = URDF.replace(good, bad), TOML.replace(good, bad)
    if right == SAME:
        arm, same = arm_of(tmp_path, urdf, toml), arm_of(tmp_path, URDF, TOML)
        for one, other in zip(arm.joints, same.joints, strict=True):
            np.testing.assert_allclose(one.T_parent_link, other.T_parent_link, atol=1e-9)
        np.testing.assert_array_equal(arm.limits.position_upper_rad, same.limits.position_upper_rad)
        return
    with pytest.raises(InputError, match=right):
        arm_of(tmp_path, urdf, toml)


def test_the_good_files_are_read(tmp_path: Path):
    arm = arm_of(tmp_path, URDF, TOML)
    np.testing.assert_allclose(arm.limits.velocity_rad_s, [2.5, 3.5])
    assert [joint.torque_nm for joint in arm.joints] == [90.0, 40.0]


@pytest.mark.parametrize(
    ("kind", "limits", "wanted"),
    [
        ("continuous", "", (-1.0, 1.0)),  # Kinova Gen3
        ("continuous", 'lower="-3.1" upper="3.1"', (-1.0, 1.0)),  # of no meaning there
        ("revolute", 'lower="-1e16" upper="1e16"', (-1.0, 1.0)),
        ("revolute", 'lower="-314.159" upper="314.159"', (-1.0, 1.0)),  # 18000°: Stäubli
        ("revolute", 'lower="-1" upper="628.3185"', (-0.15915494, 1.0)),  # 100 turns: Meca500
        ("revolute", 'lower="-12.566" upper="12.566"', (-1.99994, 1.99994)),
        ("revolute", 'lower="-6.98132" upper="6.98132"', (-1.11111, 1.11111)),  # 400°: ABB
    ],
)
def test_joints_of_real_arms_turn_by_their_limits_or_by_one_turn(
    tmp_path: Path, kind: str, limits: str, wanted: tuple[float, float]
):
    joint = 'type="revolute"><parent link="upper"/>'
    urdf = URDF.replace(joint, joint.replace("revolute", kind)).replace('lower="-2.5" upper="2.6"', limits)
    arm = arm_of(tmp_path, urdf, TOML)
    ranges = arm.limits.position_lower_rad[1], arm.limits.position_upper_rad[1]
    np.testing.assert_allclose(ranges, 2.0 * np.pi * np.array(wanted), rtol=1e-5)
    assert arm.limits.position_upper_rad[0] == 3.1
