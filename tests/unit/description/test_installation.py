"""Where things stand: poses of an installation in the world, on its table."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.installation import Installation, InstalledArm, InstalledTable, Place
from dlokit.errors import ConfigError
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw

RAISED = Installation(
    table=InstalledTable(position_m=(0.0, 0.0, 0.08), rpy_deg=(1.0, 0.0, 0.0)),
    arms=(InstalledArm(rpy_deg=(0.0, 0.0, 90.0), home_deg=(-90.0, -51.6, 0.0, -143.2, 0.0, 91.7, 45.0)),),
)


def test_the_default_cell_has_one_frame() -> None:
    first, second = Installation().mounts(2)
    assert Installation().T_world_installation is None
    assert first.T_world_base is None
    assert second.T_world_base is not None
    assert second.T_world_base.wxyz.tolist() == [0.0, 0.0, 0.0, 1.0]  # half a turn, to the bit


def test_roll_pitch_and_yaw_turn_about_the_fixed_axes_in_that_order() -> None:
    R = geometry.rotation(Place(rpy_deg=(90.0, 0.0, 90.0)).pose)
    np.testing.assert_allclose(R @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-12)  # y rolls up, and stays there
    np.testing.assert_allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


def test_a_base_below_an_inclined_table_is_inclined_in_the_world() -> None:
    (mount,) = RAISED.mounts(1)
    assert mount.T_world_base is not None
    up_world = geometry.rotation(mount.T_world_base)[:, 2]
    np.testing.assert_allclose(mount.T_world_base.position_m, -0.08 * up_world, atol=1e-12)
    np.testing.assert_allclose(RAISED.gravity_world, -9.81 * up_world, atol=1e-12)
    assert up_world[2] == pytest.approx(np.cos(np.radians(1.0)))


def test_a_point_of_the_tables_top_is_at_height_zero() -> None:
    on_table = geometry.transform(RAISED.table.pose, np.array([[0.5, 0.3, 0.0]]))[0]
    there = RAISED.in_world(geometry.pose(on_table))
    np.testing.assert_allclose(there.position_m, [0.5, 0.3, 0.0], atol=1e-12)


def test_a_home_of_the_installation_survives_the_way_to_another_process() -> None:
    model = RAISED.mounts(1)[0].model
    assert np.degrees(pickle.loads(pickle.dumps(model)).home_q_rad[0]) == pytest.approx(-90.0)
    assert pickle.loads(pickle.dumps(PANDA)).home_q_rad is PANDA.home_q_rad


@pytest.mark.heavy
def test_the_inclined_arm_reaches_what_the_level_one_reaches() -> None:
    (mount,) = RAISED.mounts(1)
    kinematics = ArmKinematics(mount.model, mount.T_world_base)
    for x, y in ((0.35, -0.3), (0.52, 0.0), (0.7, 0.2)):
        T = geometry.downward((x, y, 0.012), np.arctan2(y, x) + np.pi / 4.0)
        q = kinematics.inverse(T, mount.model.home_q_rad, Yaw.EITHER)
        reached = kinematics.forward(q)
        np.testing.assert_allclose(reached.position_m, T.position_m, atol=2e-5)
        np.testing.assert_allclose(np.abs(reached.wxyz @ T.wxyz), 1.0, atol=1e-8)


def test_along_a_path_the_joints_of_an_inclined_arm_move_steadily() -> None:
    (mount,) = RAISED.mounts(1)
    kinematics = ArmKinematics(mount.model, mount.T_world_base)
    q = [mount.model.home_q_rad]
    for y in np.linspace(-0.2, 0.2, 81):
        q.append(kinematics.inverse(geometry.downward((0.5, y, 0.1), np.pi / 4.0), q[-1]))
    steps = np.abs(np.diff(np.array(q[1:]), axis=0)).max(axis=1)
    assert steps.max() < 2.0 * np.median(steps)


def test_arms_of_an_installation_have_names_and_models_of_their_own() -> None:
    mixed = Installation(arms=(InstalledArm(name="left"), replace(Installation().arms[1], model="ur5e")))
    left, second = mixed.mounts(2)
    assert [mount.robot for mount in (left, second)] == ["left", "second"]
    assert [mount.instance for mount in (left, second)] == ["", "second"]  # addresses do not depend on names
    assert [len(mount.model.joints) for mount in (left, second)] == [7, 6]


def test_another_model_has_its_own_home() -> None:
    (mount,) = RAISED.mounts(1, "fr3")
    assert mount.model.name == "fr3"
    assert mount.model.home_q_rad[0] == 0.0


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (lambda: RAISED.mounts(2), "--arms is 2"),
        (lambda: replace(RAISED, arms=()), "0 \\[\\[arms\\]\\]"),
        (lambda: replace(RAISED, arms=(InstalledArm(name="left"), InstalledArm(name="left"))), "two arms .* 'left'"),
        (lambda: replace(RAISED, arms=(InstalledArm(name="second"),)), "two arms .* 'second'"),
        (lambda: replace(RAISED, arms=(InstalledArm(name="left/arm"),)), "letters"),
        (lambda: Installation(arms=(InstalledArm(home_deg=(0.0,) * 6),)).mounts(1), "7 joints"),
        (lambda: Installation(arms=(InstalledArm(home_deg=(200.0,) + (0.0,) * 6),)).mounts(1), "joint 1"),
        (lambda: Place(position_m=(0.0, np.nan, 0.0)), "position"),
        (lambda: InstalledTable(size_m=(0.0, 1.0)), "size"),
    ],
)
def test_what_cannot_stand_so_is_refused(wrong, named: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ConfigError, match=named):
        wrong()
