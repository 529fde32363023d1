"""Arms from files: the UR5e against its data sheet, an arm whose joints turn about any axis, and bad files."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dlokit.description.arm.arm_file import read_arm
from dlokit.description.arm.fitting import capsules_around
from dlokit.description.arm.model import Capsule
from dlokit.description.arm.mounts import UR5E_FILE, arm_model, check_arm_name
from dlokit.errors import ConfigError, MachineError
from dlokit.motion.forward_kinematics import joint_link_transforms, tcp_pose
from dlokit.types.arrays import Float64Array

pytest.importorskip("airo_models", reason="the extra dlokit[arms] is not installed")

ODD_ARM = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="foot"><geom type="cylinder" size=".06 .05"/>
      <body name="turntable" pos="0 0 .3"><joint name="a" axis="0 0 1" range="-3 3"/>
        <geom type="capsule" fromto="0 0 -.1 0 0 0" size=".05"/>
        <body name="upper" pos="0 .05 0" quat=".9 .1 0 .3"><joint name="b" axis="0 1 0" range="-2 2"/>
          <geom type="box" size=".04 .04 .15" pos="0 0 .15"/>
          <body name="fore" pos="0 0 .3"><joint name="c" axis="1 0 0" range="-2 2"/>
            <geom type="capsule" fromto="0 0 0 0 0 .25" size=".04"/>
            <body name="wrist" pos="0 0 .25"><joint name="d" axis=".6 0 .8" range="-3 3"/>
              <geom type="sphere" size=".05"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
ODD_TOML = """
title = "An odd arm"
description = "odd.xml"
home_q_rad = [0.1, 0.2, 0.3, 0.4]
velocity_rad_s = [1.0, 1.0, 1.0, 2.0]
acceleration_rad_s2 = [5.0, 5.0, 5.0, 5.0]
jerk_rad_s3 = [50.0, 50.0, 50.0, 50.0]
torque_nm = [40.0, 40.0, 20.0, 10.0]

[flange]
position_m = [0.0, 0.02, 0.05]
rpy_rad = [0.0, 0.5, 0.0]

[gripper]
title = "two sticks"
finger_m = 0.05
tcp_m = 0.1
tip_below_tcp_m = 0.01
pad_half_length_m = 0.01
pad_half_thickness_m = 0.005
open_width_m = 0.06
force_n = 30.0
finger_speed_m_s = 0.05
mass_kg = 0.5
body = [[0.0, 0.0, 0.0, 0.0, 0.0, 0.04, 0.04]]
finger = [[0.0, 0.01, 0.0, 0.0, 0.01, 0.05, 0.01]]
"""


def odd_arm_file(folder: Path, text: str = ODD_TOML, description: str = ODD_ARM) -> Path:
    (folder / "odd.xml").write_text(description)
    path = folder / "odd.toml"
    path.write_text(text)
    return path


def inside(points: Float64Array, capsules: tuple[Capsule, ...]) -> bool:
    nearest = np.full(len(points), np.inf)
    for each in capsules:
        start, axis = np.array(each.start_m), np.subtract(each.end_m, each.start_m)
        along = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        away = np.linalg.norm(points - start - along[:, None] * axis, axis=1) - each.radius_m
        nearest = np.minimum(nearest, away)
    return bool(nearest.max() < 1e-9)


def test_the_flange_of_the_ur5e_is_where_its_data_sheet_says():
    # All joints at zero, stretched along x of its base: 0.425 + 0.3922 m ahead, 0.1333 + 0.0996 m aside.
    arm = arm_model("ur5e")
    flange = joint_link_transforms(arm, np.zeros(6))[0, 6]
    np.testing.assert_allclose(flange[:3, 3], [0.8172, 0.2329, 0.0628], atol=1e-6)
    assert np.all(arm.limits.velocity_rad_s == np.pi)  # the URDF's own


def test_joints_have_the_names_of_their_descriptions_in_ros():
    parts = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    assert [joint.name for joint in arm_model("ur5e").joints] == [f"{part}_joint" for part in parts]
    assert [arm_model(name).joints[6].name for name in ("panda", "fr3")] == ["panda_joint7", "fr3_joint7"]


def test_the_width_of_closed_fingers_is_that_of_their_pads_unless_the_file_says_it(tmp_path: Path):
    assert read_arm(odd_arm_file(tmp_path), "odd.toml").gripper.pushing_half_width_m == 0.01
    wide = ODD_TOML.replace("mass_kg", "closed_half_width_m = 0.02\nmass_kg")
    assert read_arm(odd_arm_file(tmp_path, wide), "odd.toml").gripper.pushing_half_width_m == 0.02


def test_joints_that_turn_about_any_axis_are_where_mujoco_has_them(tmp_path: Path):
    arm = read_arm(odd_arm_file(tmp_path), "odd.toml")
    source = mujoco.MjModel.from_xml_string(ODD_ARM)
    data = mujoco.MjData(source)
    rng = np.random.default_rng(1)
    for q in rng.uniform(-1.5, 1.5, (5, 4)):
        data.qpos[:] = q
        mujoco.mj_kinematics(source, data)
        places = joint_link_transforms(arm, q)[0, 1:, :3, 3]
        np.testing.assert_allclose(places, data.xpos[2:], atol=1e-9)
        # The tool: 0.1 m from the flange, which is on the wrist, turned about its y axis by 0.5 rad.
        wrist = data.body("wrist").xmat.reshape(3, 3)
        tool = data.body("wrist").xpos + wrist @ [0.1 * np.sin(0.5), 0.02, 0.05 + 0.1 * np.cos(0.5)]
        np.testing.assert_allclose(tcp_pose(arm, q).position_m, tool, atol=1e-9)


def test_a_name_gives_one_arm_however_often_it_is_asked_for(tmp_path: Path):
    path = odd_arm_file(tmp_path)
    assert arm_model(str(path)) is arm_model(str(path))


@pytest.mark.parametrize("seed", range(5))
def test_fitted_capsules_hold_every_point(seed: int):
    rng = np.random.default_rng(seed)
    bent = np.concatenate([rng.uniform([0, 0, 0], [0.4, 0.05, 0.05], (300, 3)), rng.uniform(0, 0.1, (200, 3))])
    capsules = capsules_around("link", bent)
    assert 1 <= len(capsules) <= 3
    assert inside(bent, capsules)
    ball = np.array([0.2, 0.1, 0.0]) + 0.1 * (x := rng.normal(size=(500, 3))) / np.linalg.norm(x, axis=1)[:, None]
    (around,) = capsules_around("link", ball)
    assert around.radius_m == pytest.approx(0.1, rel=0.03)
    assert inside(ball, (around,))


def test_no_points_have_no_capsules():
    assert capsules_around("link", np.zeros((0, 3))) == ()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("home_q_rad = [0.1, 0.2, 0.3, 0.4]", "home_q_rad = [0.1, 0.2]"), "home_q_rad .* has 2 numbers; .* 4 joints"),
        (('title = "An odd arm"\n', ""), "title"),
        (("force_n = 30.0", 'force_n = "much"'), "force_n"),
        (("tcp_m = 0.1", "tcp_m = 0.1\ncolour = 3"), "colour"),
        (("velocity_rad_s = [1.0, 1.0, 1.0, 2.0]\n", ""), "velocity limit of a, b, c, d; set velocity_rad_s"),
        (("torque_nm = [40.0, 40.0, 20.0, 10.0]\n", ""), "torque limits; set torque_nm"),
        (('description = "odd.xml"', 'description = "no.xml"'), "no such file"),
    ],
)
def test_what_is_wrong_in_a_file_is_named(tmp_path: Path, change: tuple[str, str], says: str):
    assert change[0] in ODD_TOML
    with pytest.raises(ConfigError, match=says):
        read_arm(odd_arm_file(tmp_path, ODD_TOML.replace(*change)), "odd.toml")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("<mujoco>", "<mujoc>"), "cannot be read as URDF or MJCF"),
        (('axis="1 0 0" range="-2 2"', 'axis="1 0 0" type="slide"'), "joint 'c' is not"),
        (('axis="1 0 0" range="-2 2"', 'axis="1 0 0" pos="0 0 .1" range="-2 2"'), "joint 'c' is not"),
        (('axis="1 0 0" range="-2 2"', 'axis="1 0 0"'), "c turns from 0 to 0 rad, which is no range"),
    ],
)
def test_what_no_arm_can_be_is_named(tmp_path: Path, change: tuple[str, str], says: str):
    assert change[0] in ODD_ARM
    with pytest.raises(ConfigError, match=says):
        read_arm(odd_arm_file(tmp_path, description=ODD_ARM.replace(*change)), "odd.toml")


def test_a_missing_package_is_named_with_what_to_install(tmp_path: Path):
    text = UR5E_FILE.read_text().replace('package = "airo_models"', 'package = "no_such_models"')
    with pytest.raises(MachineError, match="pip install airo-models"):
        read_arm(odd_arm_file(tmp_path, text), "odd.toml")


@pytest.mark.parametrize("name", ["pand", "no.toml", "robot.urdf"])
def test_a_name_that_is_no_arm_says_which_there_are(name: str):
    with pytest.raises(ConfigError, match="Choose panda, fr3, ur5e, or the file"):
        check_arm_name(name)
