"""Checks that arms and camera can work at the poses of an installation; it reports problems before anything moves.

`dlokit shape` raises the first problem before it starts; `dlokit doctor --installation FILE` lists all of them.
"""

import itertools
import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.description.arm.mounts import ArmMount
from dlokit.description.installation import Installation, InstalledArm, Place
from dlokit.description.scene import Fixture
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.errors import ConfigError, SkillFailure
from dlokit.functional.cameras.calibration_file import read_calibration
from dlokit.geometry.camera import project
from dlokit.motion.arm_distance import Apart
from dlokit.motion.collisions import check_collisions
from dlokit.motion.fixture_checks import check_fixtures_clear
from dlokit.motion.fixture_clearance import FIXTURE_CLEARANCE_M, hand_clearance_m
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.skills.planning.verdict.feasibility import VIEW_MARGIN_PX
from dlokit.skills.robot.api import RELEASE_WIDTH_M
from dlokit.system.config import RunConfig
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

log = logging.getLogger(__name__)

_ON_TABLE_M = 0.3
"""A base over the usable part of the table and lower than this obstructs DLOs [m]; a higher one hangs above them."""
_SAME_PLACE_M = 0.1
"""Bases nearer to each other than this count as the same place [m]."""
_AWAY_DEG = 50.0
"""Maximum angle between the camera's axis and the middle of the table [°]; no camera sees further to the side."""
_TOO_FAR_M = 10.0
"""A base or a camera farther from the table [m] is one whose position is probably in millimetres."""
_LITTLE = 0.75
"""An arm that reaches, or a camera that sees, less than this part of the usable table will refuse many shapes."""
_TOO_LITTLE_SEEN = 0.25
"""A camera that sees less than this part of the usable table is turned or placed wrongly."""
_COLUMNS, _ROWS = 4, 5  # places on the usable part of the table at which reach and view are checked
MIDDLE_M = ((TABLE_X_M[0] + TABLE_X_M[1]) / 2.0, (TABLE_Y_M[0] + TABLE_Y_M[1]) / 2.0)
"""Middle of the usable part of the table (x, y) in the world [m]."""


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """The part of the usable table that an arm reaches or a camera sees."""

    text: str
    """For example "reaches 90% of the usable table"."""
    advice: str = ""
    """What to correct in the installation file; empty: nothing."""


def check_installation(config: RunConfig) -> None:
    """Raise `ConfigError` for a pose or a fixture that cannot be, or `MachineError` without an arm's package.

    Logs a warning for an arm that reaches, or a camera that sees, only a part of the usable table.
    """
    mounts = config.scene.arms
    for mount in mounts:
        _warn(f"the {mount.robot} arm", check_arm(mount, config.installation))
    check_arms_apart(mounts, config.robot.arm_clearance_m)
    if (seen := check_camera(config)) is not None:
        _warn("the camera", seen)


def _warn(what: str, coverage: Coverage) -> None:
    if coverage.advice:
        log.warning("%s %s: %s", what, coverage.text, coverage.advice)


def check_arm(mount: ArmMount, installation: Installation) -> Coverage:
    """The fraction of places on the usable part of the table at which the arm can grasp, within its workspace.

    The open fingers are clear of fixtures there. Raises `ConfigError` for a base on the part of the table for DLOs or
    too far from it, for a home outside the workspace or too near to the table, a fixture or the arm itself, and for an
    arm that reaches no place.
    """
    arm, fixtures = installation.arms[installation.robots.index(mount.robot)], installation.fixtures
    kinematics = ArmKinematics(mount.model, mount.T_world_base)
    _check_base(mount)
    _check_base_near(kinematics, mount, arm, installation)
    _check_home(kinematics, mount, arm, fixtures)
    grasps = [_grasp_rad(kinematics, mount, place, fixtures) for place in _places(mount.model.gripper.grasp_height_m())]
    reached = [q_rad for q_rad in grasps if q_rad is not None]
    if not reached:
        x_m, y_m = mount.place_m
        raise ConfigError(
            f"the {mount.robot} arm, whose base is at x {x_m:.2f}, y {y_m:.2f} m in the world, can grasp nowhere on "
            f"the part of the table where DLOs lie, {_usable()}: correct its base, its workspace, the fixtures, or the "
            "position_m of [table], which is the world's origin, in the installation file."
        )
    fraction = len(reached) / len(grasps)
    text = f"reaches {fraction:.0%} of the usable table"
    if (turn_deg := _turn_towards_table_deg(mount, np.array(reached))) is not None:
        return Coverage(
            text=f"{text}, over which its first joint comes to the end of its range",
            advice=f"turn its base by about {turn_deg:.0f}° about z (rpy_deg of [[arms]]), towards the table: it can "
            "grasp no DLO at that end, nor carry one past it",
        )
    little = fraction < _LITTLE
    return Coverage(
        text=text, advice="put the world's origin, position_m of [table], in better reach of the arm" if little else ""
    )


def _turn_towards_table_deg(mount: ArmMount, q_rad: Float64Array) -> float | None:
    """By how much to turn a base whose first joint reaches the table (N, J) [rad] at both ends of its range [°].

    None: the table is within the range. From a base beside the usable part of the table all of it lies within half a
    turn.
    """
    first_rad = q_rad[:, 0]
    if _over_usable(mount) or np.ptp(first_rad) <= math.pi:
        return None
    middle_rad = np.angle(np.exp(1j * first_rad).sum())
    limits = mount.model.limits
    front_rad = (limits.position_lower_rad[0] + limits.position_upper_rad[0]) / 2.0
    return 30.0 * abs(round(math.degrees(np.angle(np.exp(1j * (middle_rad - front_rad)))) / 30.0))


def _check_base(mount: ArmMount) -> None:
    height_m = 0.0 if mount.T_world_base is None else float(mount.T_world_base.position_m[2])
    x_m, y_m = mount.place_m
    if _over_usable(mount) and height_m < _ON_TABLE_M:
        raise ConfigError(
            f"the base of the {mount.robot} arm is at x {x_m:.2f}, y {y_m:.2f} m in the world, on the part of the "
            f"table where DLOs lie, {_usable()}: correct its position_m, or that of [table], in the installation file."
        )


def _over_usable(mount: ArmMount) -> bool:
    x_m, y_m = mount.place_m
    return TABLE_X_M[0] <= x_m <= TABLE_X_M[1] and TABLE_Y_M[0] <= y_m <= TABLE_Y_M[1]


def _check_base_near(kinematics: ArmKinematics, mount: ArmMount, arm: InstalledArm, installation: Installation) -> None:
    """Raise `ConfigError` for a base from which even the stretched arm reaches no place on the usable table."""
    base_m = np.array(_base_m(mount))
    nearest_m = np.array([*np.clip(base_m[:2], *np.transpose([TABLE_X_M, TABLE_Y_M])), 0.0])
    try:
        kinematics.check_length(geometry.downward(nearest_m, 0.0))
    except SkillFailure:
        away_m = float(np.linalg.norm(base_m - nearest_m))
        raise ConfigError(
            f"the base of the {mount.robot} arm is {away_m:.2f} m from the part of the table where DLOs lie, "
            f"{_usable()} in the world, and the arm reaches {kinematics.length_m:.2f} m from its shoulder: correct its "
            f"position_m, {_listed(arm.position_m)}, or that of [table], {_listed(installation.table.position_m)}, in "
            f"the installation file{_metres(away_m)}."
        ) from None


def _metres(away_m: float) -> str:
    return "; both are in metres, not millimetres" if away_m > _TOO_FAR_M else ""


def _listed(values: Sequence[float]) -> str:
    return str(list(values))


def _check_home(kinematics: ArmKinematics, mount: ArmMount, arm: InstalledArm, fixtures: tuple[Fixture, ...]) -> None:
    home_rad, box = mount.model.home_q_rad, mount.workspace
    place = kinematics.forward(home_rad).position_m
    if not np.all((place >= box.lower_m) & (place <= box.upper_m)):
        height_m = _base_m(mount)[2]
        raise ConfigError(
            f"the home of the {mount.robot} arm has its tool at {np.round(place, 3).tolist()} m in the world, "
            f"outside its workspace from {box.lower_m} to {box.upper_m}; its base, position_m "
            f"{_listed(arm.position_m)} and rpy_deg {_listed(arm.rpy_deg)} in the installation file, is "
            f"{abs(height_m):.2f} m "
            f"{'above' if height_m >= 0.0 else 'below'} the top of the table. Correct its base; if that is right, give "
            "it a home_deg inside the workspace, or widen the workspace there."
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


def _places(height_m: float) -> list[tuple[float, float, float]]:
    """Places on the usable part of the table, at a height over it [m]."""
    columns, rows = np.linspace(*TABLE_X_M, _COLUMNS).tolist(), np.linspace(*TABLE_Y_M, _ROWS).tolist()
    return [(x_m, y_m, height_m) for x_m, y_m in itertools.product(columns, rows)]


def _grasp_rad(
    kinematics: ArmKinematics, mount: ArmMount, place_m: tuple[float, float, float], fixtures: tuple[Fixture, ...]
) -> Float64Array | None:
    """Joint angles (J,) [rad] of a grasp in the workspace, with the open fingers clear; None: there is none."""
    model, box = mount.model, mount.workspace
    if not all(low <= at <= high for low, at, high in zip(box.lower_m, place_m, box.upper_m, strict=True)):
        return None
    width_m = min(RELEASE_WIDTH_M, model.gripper.open_width_m)
    for yaw_rad, q_rad in _reachable_yaws(kinematics, mount, place_m):
        if hand_clearance_m(model, (*place_m, yaw_rad), width_m, fixtures) >= FIXTURE_CLEARANCE_M:
            return q_rad
    return None


def _reachable_yaws(
    kinematics: ArmKinematics, mount: ArmMount, place_m: tuple[float, float, float]
) -> Iterator[tuple[float, Float64Array]]:
    """Yaws [rad] at which the tool can be at a place in the world, pointing down, and the joint angles (J,) [rad].

    Only the two yaws that suit the wrist are tried.
    """
    bearing = math.atan2(place_m[1] - mount.place_m[1], place_m[0] - mount.place_m[0]) + mount.model.roomiest_yaw_rad
    for yaw_rad in (bearing, bearing + math.pi / 2.0):
        try:
            yield yaw_rad, kinematics.inverse(geometry.downward(place_m, yaw_rad), yaw=Yaw.EITHER)
        except SkillFailure:
            continue


def beyond_reach(mounts: tuple[ArmMount, ...], fixtures: tuple[Fixture, ...]) -> list[str]:
    """Names of the fixtures whose top no arm reaches with its fingertips: nothing can be laid around them."""

    def reached(fixture: Fixture, mount: ArmMount) -> bool:
        kinematics = ArmKinematics(mount.model, mount.T_world_base)
        above_m = fixture.top_m + mount.model.gripper.grasp_height_m()
        return next(_reachable_yaws(kinematics, mount, (*fixture.position_m[:2], above_m)), None) is not None

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


def check_camera(config: RunConfig) -> Coverage | None:
    """The fraction of the usable table that is inside the camera's picture; None: only its driver knows that.

    Raises `ConfigError` for a camera that is below the table, looks away from it, or sees too little of it.
    """
    place = _measured_camera(config)
    if place is not None and math.dist(place.position_m, config.installation.table.position_m) > _TOO_FAR_M:
        raise ConfigError(
            f"the camera is more than {_TOO_FAR_M:.0f} m from the table: correct position_m, "
            f"{_listed(place.position_m)}, of [camera] in the installation file; it is in metres, not millimetres."
        )
    believed = _believed_camera(config)
    if isinstance(believed, CameraCalibration):
        _check_looks_here(believed.T_world_camera, config)
        return _seen(believed, config)
    if believed is not None:
        _check_looks_here(believed, config)
    return None


def believed_camera_pose(config: RunConfig) -> Pose | None:
    """The camera's pose in the world; None when only its driver provides it. Raises `ConfigError`."""
    believed = _believed_camera(config)
    return believed.T_world_camera if isinstance(believed, CameraCalibration) else believed


def _believed_camera(config: RunConfig) -> CameraCalibration | Pose | None:
    """The camera in the world; its pose alone if only its driver has its intrinsics, None if its pose as well."""
    installation = config.installation
    if config.calibration:
        calibration = read_calibration(Path(config.calibration))
        return msgspec.structs.replace(calibration, T_world_camera=installation.in_world(calibration.T_world_camera))
    if config.camera.sees_cell:
        from dlokit.system.configuration.preflight import camera_of_cell

        return camera_of_cell(config)
    return None if installation.camera is None else installation.in_world(installation.camera.pose)


def _check_looks_here(T_world_camera: Pose, config: RunConfig) -> None:
    where = _where(T_world_camera, config)
    if T_world_camera.position_m[2] <= 0.0:
        raise ConfigError(f"the camera is {where}, below the top of the table: {_correct_camera(config)}")
    away_deg = _away_deg(T_world_camera)
    if away_deg > _AWAY_DEG:
        raise ConfigError(
            f"the camera, {where}, looks away from the table: the middle of the part where DLOs lie is {away_deg:.0f}° "
            f"off the middle of its picture, {_AWAY_DEG:.0f}° at most make sense; {_correct_camera(config)}"
        )


def _seen(camera: CameraCalibration, config: RunConfig) -> Coverage:
    """The coverage of a camera that looks at the table. Raises `ConfigError` if it sees too little of it."""
    projection = project(_places(0.0), camera)
    u, v = projection.pixels.T
    margin, right, lower = VIEW_MARGIN_PX, camera.width_px - 1, camera.height_px - 1
    inside = (u >= margin) & (u <= right - margin) & (v >= margin) & (v <= lower - margin)
    fraction = float(np.mean(inside & (projection.depth_m > 0.0)))
    text = f"sees {fraction:.0%} of the usable table"
    if fraction >= _LITTLE:
        return Coverage(text=text)
    pose = camera.T_world_camera
    forward = geometry.rotation(pose)[:, 2]
    aim = "does not meet the table"
    if forward[2] < 0.0:
        x_m, y_m, _ = pose.position_m - pose.position_m[2] / forward[2] * forward
        aim = f"shows the table at x {x_m:.2f}, y {y_m:.2f} m"
    advice = (
        f"the middle of its picture {aim} in the world, and the middle of the usable table is at x {MIDDLE_M[0]:.2f}, "
        f"y {MIDDLE_M[1]:.2f} m; {_correct_camera(config)}"
    )
    if fraction < _TOO_LITTLE_SEEN:
        raise ConfigError(f"the camera, {_where(pose, config)}, {text}: {advice}")
    return Coverage(text=text, advice=advice)


def _away_deg(T_world_camera: Pose) -> float:
    """Angle at the camera between its axis and the middle of the usable table [°]."""
    to_middle = np.array([*MIDDLE_M, 0.0]) - T_world_camera.position_m
    forward = geometry.rotation(T_world_camera)[:, 2]
    cosine = float(forward @ to_middle) / max(float(np.linalg.norm(to_middle)), 1e-9)
    return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))


def _measured_camera(config: RunConfig) -> Place | None:
    """The pose of the camera as the installation file says it; None where it comes from elsewhere."""
    return None if config.calibration else config.installation.camera


def _where(T_world_camera: Pose, config: RunConfig) -> str:
    """The place of the camera in the world, and in the installation file."""
    said = f"at {np.round(T_world_camera.position_m, 2).tolist()} m in the world"
    if (place := _measured_camera(config)) is None:
        return said
    return f"{said} (in the file: position_m {_listed(place.position_m)}, rpy_deg {_listed(place.rpy_deg)})"


def _correct_camera(config: RunConfig) -> str:
    place = _measured_camera(config)
    if place is not None and max(map(abs, place.rpy_deg)) <= 2.0 * math.pi:
        roll, pitch, yaw = (round(math.degrees(angle), 1) for angle in place.rpy_deg)
        turned = Place(position_m=place.position_m, rpy_deg=(roll, pitch, yaw))
        if _away_deg(config.installation.in_world(turned.pose)) <= _AWAY_DEG:
            return f"rpy_deg is in degrees, and the file has radians: write {_listed(turned.rpy_deg)}."
    return (
        "correct the place of the camera in [camera] (x right, y down, z forward in its picture), or calibrate it with "
        "dlokit calibrate handeye."
    )


def _base_m(mount: ArmMount) -> list[float]:
    return [0.0, 0.0, 0.0] if mount.T_world_base is None else mount.T_world_base.position_m.tolist()


def _usable() -> str:
    return f"x {TABLE_X_M[0]:.2f} to {TABLE_X_M[1]:.2f}, y {TABLE_Y_M[0]:.2f} to {TABLE_Y_M[1]:.2f} m"
