"""Checks that arms and camera can work at the poses of an installation; it reports problems before anything moves.

`dlokit shape` raises the first problem before it starts; `dlokit doctor --installation FILE` lists all of them.
"""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from dlokit import geometry
from dlokit.description.arm.mounts import ArmMount
from dlokit.description.scene import Fixture
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.errors import ConfigError, SkillFailure
from dlokit.motion.arm_distance import Apart
from dlokit.motion.collisions import check_collisions
from dlokit.motion.fixture_checks import check_fixtures_clear
from dlokit.motion.fixture_clearance import FIXTURE_CLEARANCE_M, hand_clearance_m
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.skills.robot.api import RELEASE_WIDTH_M
from dlokit.system.config import RunConfig
from dlokit.types.pose import Pose

_ON_TABLE_M = 0.3
"""A base over the usable part of the table and lower than this obstructs DLOs [m]; a higher one hangs above them."""
_SAME_PLACE_M = 0.1
"""Bases nearer to each other than this count as the same place [m]."""
_AWAY_DEG = 50.0
"""Maximum angle between the camera's axis and the middle of the table [°]; no camera sees further to the side."""
_COLUMNS, _ROWS = 4, 5  # places on the usable part of the table at which reach is checked
MIDDLE_M = ((TABLE_X_M[0] + TABLE_X_M[1]) / 2.0, (TABLE_Y_M[0] + TABLE_Y_M[1]) / 2.0)
"""Middle of the usable part of the table (x, y) in the world [m]."""


def check_installation(config: RunConfig) -> None:
    """Raise `ConfigError` for a pose or a fixture that cannot be, or `MachineError` without an arm's package."""
    mounts = config.scene.arms
    for mount in mounts:
        check_arm(mount, config.installation.fixtures)
    check_arms_apart(mounts, config.robot.arm_clearance_m)
    if (T_world_camera := believed_camera_pose(config)) is not None:
        check_camera_looks_here(T_world_camera)


def check_arm(mount: ArmMount, fixtures: tuple[Fixture, ...] = ()) -> float:
    """Fraction of places on the usable part of the table at which the arm can grasp, within its workspace.

    The open fingers are clear of fixtures there. Raises `ConfigError` for a base on the part of the table for DLOs, for
    a home outside the workspace or too near to the table, a fixture or the arm itself, and for an arm that reaches no
    place.
    """
    _check_base(mount)
    _check_home(mount, fixtures)
    reached = _reached_fraction(mount, fixtures)
    if reached == 0.0:
        x_m, y_m = mount.place_m
        raise ConfigError(
            f"the {mount.robot} arm, whose base is at x {x_m:.2f}, y {y_m:.2f} m in the world, can grasp nowhere on "
            f"the part of the table where DLOs lie, {_usable()}: correct its base, its workspace, the fixtures, or the "
            "position_m of [table], which is the world's origin, in the installation file."
        )
    return reached


def _check_base(mount: ArmMount) -> None:
    height_m = 0.0 if mount.T_world_base is None else float(mount.T_world_base.position_m[2])
    x_m, y_m = mount.place_m
    if TABLE_X_M[0] <= x_m <= TABLE_X_M[1] and TABLE_Y_M[0] <= y_m <= TABLE_Y_M[1] and height_m < _ON_TABLE_M:
        raise ConfigError(
            f"the base of the {mount.robot} arm is at x {x_m:.2f}, y {y_m:.2f} m in the world, on the part of the "
            f"table where DLOs lie, {_usable()}: correct its position_m, or that of [table], in the installation file."
        )


def _check_home(mount: ArmMount, fixtures: tuple[Fixture, ...]) -> None:
    home_rad, box = mount.model.home_q_rad, mount.workspace
    place = ArmKinematics(mount.model, mount.T_world_base).forward(home_rad).position_m
    if not np.all((place >= box.lower_m) & (place <= box.upper_m)):
        raise ConfigError(
            f"the home of the {mount.robot} arm has its tool at {np.round(place, 3).tolist()} m in the world, "
            f"outside its workspace from {box.lower_m} to {box.upper_m}: give it a home_deg inside in the "
            "installation file, or widen the workspace there."
        )
    try:
        check_collisions(mount.model, home_rad[None, :], mount.T_world_base)
        widths_m = 0.0, mount.model.gripper.open_width_m
        check_fixtures_clear(mount.model, home_rad, widths_m, fixtures, mount.T_world_base, may_leave=False)
    except SkillFailure as failure:
        raise ConfigError(
            f"the {mount.robot} arm cannot stand at home: {failure}. Correct its base, its home_deg, the fixtures or "
            "the table in the installation file."
        ) from failure


def _reached_fraction(mount: ArmMount, fixtures: tuple[Fixture, ...]) -> float:
    height_m, gripper = mount.model.gripper.grasp_height_m(), mount.model.gripper
    width_m = min(RELEASE_WIDTH_M, gripper.open_width_m)
    (x0, y0, z0), (x1, y1, z1) = mount.workspace.lower_m, mount.workspace.upper_m
    reached = 0
    for x_m, y_m in itertools.product(np.linspace(*TABLE_X_M, _COLUMNS), np.linspace(*TABLE_Y_M, _ROWS)):
        if not (x0 <= x_m <= x1 and y0 <= y_m <= y1 and z0 <= height_m <= z1):
            continue
        place = (float(x_m), float(y_m), height_m)
        reached += any(
            hand_clearance_m(mount.model, (*place, yaw_rad), width_m, fixtures) >= FIXTURE_CLEARANCE_M
            for yaw_rad in _reachable_yaws(mount, place)
        )
    return reached / (_COLUMNS * _ROWS)


def _reachable_yaws(mount: ArmMount, place_m: tuple[float, float, float]) -> Iterator[float]:
    """Yaws [rad] at which the tool can be at a place in the world, pointing down, of the two that suit the wrist."""
    kinematics = ArmKinematics(mount.model, mount.T_world_base)
    bearing = math.atan2(place_m[1] - mount.place_m[1], place_m[0] - mount.place_m[0]) + mount.model.roomiest_yaw_rad
    for yaw_rad in (bearing, bearing + math.pi / 2.0):
        if kinematics.reachable(geometry.downward(place_m, yaw_rad), Yaw.EITHER):
            yield yaw_rad


def beyond_reach(mounts: tuple[ArmMount, ...], fixtures: tuple[Fixture, ...]) -> list[str]:
    """Names of the fixtures whose top no arm reaches with its fingertips: nothing can be laid around them."""

    def reached(fixture: Fixture, mount: ArmMount) -> bool:
        above_m = fixture.top_m + mount.model.gripper.grasp_height_m()
        return next(_reachable_yaws(mount, (*fixture.position_m[:2], above_m)), None) is not None

    return [fixture.name for fixture in fixtures if not any(reached(fixture, mount) for mount in mounts)]


def check_arms_apart(mounts: tuple[ArmMount, ...], clearance_m: float) -> None:
    """Raise `ConfigError` when two bases are at the same place, or two arms closer than `clearance_m` [m] at home."""
    for first, second in itertools.combinations(mounts, 2):
        between_m = math.dist(_base_m(first), _base_m(second))
        if between_m < _SAME_PLACE_M:
            raise ConfigError(
                f"the {first.robot} and the {second.robot} arm are at the same place, {1e3 * between_m:.0f} mm "
                "apart: correct the position_m of one in the installation file."
            )
        apart = Apart(*(ArmKinematics(each.model, each.T_world_base) for each in (first, second)))
        gap_m = apart.at_joints_m(first.model.home_q_rad[None, :], second.model.home_q_rad[None, :])
        if gap_m < clearance_m:
            raise ConfigError(
                f"at home the {first.robot} and the {second.robot} arm are {1e3 * max(gap_m, 0.0):.0f} mm apart, at "
                f"least {1e3 * clearance_m:.0f} mm are needed: move their bases apart, or give one another home_deg in "
                "the installation file."
            )


def believed_camera_pose(config: RunConfig) -> Pose | None:
    """The camera's pose in the world; None when only its driver provides it. Raises `ConfigError`."""
    if config.calibration:
        from pathlib import Path

        from dlokit.functional.cameras.calibration_file import read_calibration

        return config.installation.in_world(read_calibration(Path(config.calibration)).T_world_camera)
    if config.installation.camera is not None:
        return config.installation.in_world(config.installation.camera.pose)
    if config.camera.sees_cell:
        from dlokit.functional.cell.rendering import cell_camera

        return cell_camera(config.cell, config.installation).T_world_camera
    return None


def check_camera_looks_here(T_world_camera: Pose) -> None:
    """Raise `ConfigError` for a camera that is below the table or looks away from it."""
    middle = np.array([*MIDDLE_M, 0.0])
    to_middle = middle - T_world_camera.position_m
    forward = geometry.rotation(T_world_camera)[:, 2]
    cosine = float(forward @ to_middle) / max(float(np.linalg.norm(to_middle)), 1e-9)
    away_deg = math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
    where = f"at {np.round(T_world_camera.position_m, 2).tolist()} m in the world"
    correct = (
        "correct the place of the camera in [camera] (x right, y down, z forward in its picture), or calibrate it with "
        "dlokit calibrate handeye."
    )
    if T_world_camera.position_m[2] <= 0.0:
        raise ConfigError(f"the camera is {where}, below the top of the table: {correct}")
    if away_deg > _AWAY_DEG:
        raise ConfigError(
            f"the camera, {where}, looks away from the table: the middle of the part where DLOs lie is {away_deg:.0f}° "
            f"off the middle of its picture, {_AWAY_DEG:.0f}° at most make sense; {correct}"
        )


def _base_m(mount: ArmMount) -> list[float]:
    return [0.0, 0.0, 0.0] if mount.T_world_base is None else mount.T_world_base.position_m.tolist()


def _usable() -> str:
    return f"x {TABLE_X_M[0]:.2f} to {TABLE_X_M[1]:.2f}, y {TABLE_Y_M[0]:.2f} to {TABLE_Y_M[1]:.2f} m"
