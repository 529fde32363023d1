"""`check_arm`: whether an arm model is consistent, suits planning, and agrees with the simulated cell."""

import contextlib
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import mujoco
import numpy as np

from dlokit import geometry
from dlokit.description.arm.fitting import link_mesh
from dlokit.description.arm.model import HAND, ArmModel
from dlokit.description.arm.mujoco_model import add_arm
from dlokit.description.default_cameras import default_calibration
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.errors import SkillFailure
from dlokit.extras.checks.checks import Check, findings, require_none
from dlokit.extras.checks.device_report import CheckedDevice, spread
from dlokit.geometry.camera import project
from dlokit.motion.collisions import check_collisions
from dlokit.motion.forward_kinematics import PosedArm, link_transforms, tcp_pose
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.motion.limits import check_limits
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.skills.perception.self_filter import robot_capsules, robot_outline
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotMode, RobotState

LARGEST_TILT_RAD = 0.01
"""Largest angle of the tool from straight down at home [rad]."""
LEAST_REACH = 0.9
"""Least fraction of the grasps in the shapes' area that the arm must reach."""
SURFACE_M = 0.02
"""Largest distance of a link's surface outside of its capsules [m]."""
LARGEST_ERROR_M = 1e-4
"""Largest distance of the tool from where inverse kinematics brings it [m]."""
_PLACES = 5  # along each side of the area
_TURNS = 4  # of the gripper at each place
_PROFILE = VelocityProfile(speed_m_s=0.3)


@dataclass(frozen=True, kw_only=True)
class ArmReport:
    """Result for an arm that passed every check; attach it to a bug report."""

    title: str
    joints: int
    gripper: str
    open_width_m: float
    capsules: int
    reached: float
    """Fraction of the grasps in the shapes' area that it reaches."""
    passed: tuple[str, ...] = field(default=())
    """Names of the checks."""


def check_arm(arm: ArmModel) -> ArmReport:
    """Check an arm model. Raises `CheckFailed` with all findings, `MachineError` where its meshes are missing."""
    require_none(f"the arm {arm.name}", findings(CHECKS, arm))
    reached, poses = _reached(arm)
    return ArmReport(
        title=arm.title,
        joints=len(arm.joints),
        gripper=arm.gripper.title,
        open_width_m=arm.gripper.open_width_m,
        capsules=len(arm.capsules),
        reached=len(reached) / len(poses),
        passed=tuple(check.name for check in CHECKS),
    )


def examined_arm(arm: ArmModel) -> CheckedDevice:
    """As `check_arm`, with all data for a report, whether the arm passes or not."""
    begin_s = time.perf_counter()
    found = findings(CHECKS, arm)
    took_s = time.perf_counter() - begin_s
    kinematics, seconds = ArmKinematics(arm), list[float]()
    height_m = arm.gripper.grasp_height_m()
    for x in np.linspace(*TABLE_X_M, _PLACES):
        begin_s = time.perf_counter()
        with contextlib.suppress(SkillFailure):
            kinematics.inverse(geometry.downward([x, 0.0, height_m], 0.0), yaw=Yaw.EITHER)
        seconds.append(time.perf_counter() - begin_s)
    limits, gripper = arm.limits, arm.gripper
    return CheckedDevice(
        what=f"arm {arm.name}: {arm.title}, {len(arm.joints)} joints, {gripper.title}",
        wanted={check.name: check.wanted for check in CHECKS},
        found=found,
        facts={
            "joints from [°]": _degrees(limits.position_lower_rad),
            "joints to [°]": _degrees(limits.position_upper_rad),
            "fastest [°/s]": _degrees(limits.velocity_rad_s),
            "home [°]": _degrees(arm.home_q_rad),
            "gripper": f"opens to {gripper.open_width_m * 1e3:.0f} mm, tool centre {gripper.tcp_m * 1e3:.1f} mm from "
            f"the flange, tips {gripper.tip_below_tcp_m * 1e3:.1f} mm below it",
            "capsules": str(len(arm.capsules)),
        },
        timing={"all checks": f"{took_s:.1f} s", "inverse kinematics of a grasp": spread(seconds)},
    )


def _degrees(rad: Float64Array) -> str:
    return ", ".join(f"{value:.1f}" for value in np.degrees(rad))


def _limits(arm: ArmModel) -> Iterator[str]:
    joints, limits = len(arm.joints), arm.limits
    for name in ("position_lower_rad", "position_upper_rad", "velocity_rad_s", "acceleration_rad_s2", "jerk_rad_s3"):
        values = getattr(limits, name)
        if values.shape != (joints,):
            yield f"{name} has the shape {values.shape}"
            return
    yield from arm.limit_errors()


def _home(arm: ArmModel) -> Iterator[str]:
    home = arm.home_q_rad
    tilt = float(np.arccos(np.clip(-geometry.rotation(tcp_pose(arm, home))[2, 2], -1.0, 1.0)))
    if tilt > LARGEST_TILT_RAD:
        yield f"the gripper is {tilt:.3f} rad from straight down"
    yield from _refused(partial(check_collisions, arm, home[None, :]))


def _view(arm: ArmModel) -> Iterator[str]:
    camera = default_calibration()
    state = RobotState(
        stamp_ns=0,
        robot="arm",
        q_rad=arm.home_q_rad,
        dq_rad_s=np.zeros(len(arm.joints)),
        tau_nm=np.zeros(len(arm.joints)),
        T_world_tcp=tcp_pose(arm, arm.home_q_rad),
        finger_width_m=arm.gripper.open_width_m,
        mode=RobotMode.IDLE,
    )
    hidden = robot_outline(robot_capsules([PosedArm(arm, state)]), camera, 0.0)
    x, y = np.meshgrid(np.linspace(*TABLE_X_M, 20), np.linspace(*TABLE_Y_M, 20))
    seen = project(np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]), camera)
    columns, rows = np.round(seen.pixels).astype(np.int64).T
    covered = float(np.mean(hidden[rows.clip(0, camera.height_px - 1), columns.clip(0, camera.width_px - 1)]))
    if covered > 0.0:
        yield f"at home the arm hides {covered:.0%} of the shapes' area from the default camera"


def _agrees(arm: ArmModel) -> Iterator[str]:
    spec = mujoco.MjSpec()
    add_arm(spec, arm, visual=False)
    model: Any = spec.compile()
    data: Any = mujoco.MjData(model)
    joints = len(arm.joints)
    # Simulated fingertips do not move along an arc: they are at the lowest position of real ones.
    width_m = arm.gripper.lowest_width_m if arm.gripper.tip_drop else 0.02
    for q in _drawn(arm, 5):
        data.qpos[:joints], data.qpos[joints:] = q, width_m / 2.0
        mujoco.mj_kinematics(model, data)
        for link, T in zip(arm.links, link_transforms(arm, q, width_m)[0], strict=True):
            off_m = float(np.linalg.norm(T[:3, 3] - data.body(f"arm/{link}").xpos))
            if off_m > 1e-6:
                yield f"{link} is {off_m:.2g} m from where the simulated arm has it"
                return


def _enclosed(arm: ArmModel) -> Iterator[str]:
    for link in (*(joint.link for joint in arm.joints), HAND):
        capsules = [capsule for capsule in arm.capsules if capsule.link == link]
        points = np.asarray(link_mesh(arm, link, merged=False).vertices, dtype=np.float64)
        nearest = np.full(len(points), np.inf)
        for capsule in capsules:
            start, axis = np.array(capsule.start_m), np.subtract(capsule.end_m, capsule.start_m)
            along = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
            away = np.linalg.norm(points - start - along[:, None] * axis, axis=1) - capsule.radius_m
            nearest = np.minimum(nearest, away)
        if not capsules or nearest.max() > SURFACE_M:
            yield f"{link} extends {nearest.max():.3f} m out of its {len(capsules)} capsules"


def _inverse(arm: ArmModel) -> Iterator[str]:
    reached, poses = _reached(arm)
    if len(reached) < LEAST_REACH * len(poses):
        yield f"of {len(poses)} grasps in the shapes' area it reaches {len(reached)}"
    for pose, q in reached:
        off_m = float(np.linalg.norm(tcp_pose(arm, q).position_m - pose.position_m))
        if off_m > LARGEST_ERROR_M:
            yield f"inverse kinematics ends {off_m:.2g} m from a pose"
            return


def _motions(arm: ArmModel) -> Iterator[str]:
    kinematics = ArmKinematics(arm)
    (first, q), *_ = _reached(arm)[0] or [(tcp_pose(arm, arm.home_q_rad), arm.home_q_rad)]
    there = geometry.downward(first.position_m + np.array([0.05, 0.05, 0.05]), np.pi / 2.0)
    for move in (
        lambda: joint_move(arm.home_q_rad, q, arm.limits),
        lambda: tool_move(kinematics, q, (there,), _PROFILE),
    ):
        yield from _refused(lambda move=move: check_limits(move(), arm.limits))


def _gripper(arm: ArmModel) -> Iterator[str]:
    gripper = arm.gripper
    yield from gripper.errors()
    down = ArmKinematics(arm).inverse
    x, y = np.mean(TABLE_X_M), np.mean(TABLE_Y_M)
    try:
        q = down(geometry.downward(np.array([x, y, gripper.grasp_height_m()]), np.pi / 2.0), yaw=Yaw.EITHER)
    except SkillFailure as failure:
        yield str(failure)
        return
    yield from _refused(partial(check_collisions, arm, q[None, :]))


def _refused(run: Any) -> Iterator[str]:
    try:
        run()
    except SkillFailure as failure:
        yield str(failure)


def _drawn(arm: ArmModel, count: int) -> Float64Array:
    rng = np.random.default_rng(0)
    return rng.uniform(arm.limits.position_lower_rad, arm.limits.position_upper_rad, (count, len(arm.joints)))


def _reached(arm: ArmModel) -> tuple[list[tuple[Pose, Float64Array]], Sequence[Pose]]:
    """The grasps in the shapes' area that the arm reaches, with its joint angles; and all grasps."""
    kinematics, height_m = ArmKinematics(arm), arm.gripper.grasp_height_m()
    poses = [
        geometry.downward([x, y, height_m], turn)
        for x in np.linspace(*TABLE_X_M, _PLACES)
        for y in np.linspace(*TABLE_Y_M, _PLACES)
        for turn in np.linspace(0.0, np.pi, _TURNS, endpoint=False)
    ]
    reached: list[tuple[Pose, Float64Array]] = []
    for pose in poses:
        try:
            reached.append((pose, kinematics.inverse(pose, yaw=Yaw.EXACT)))
        except SkillFailure:
            try:
                turned = geometry.downward(pose.position_m, np.pi + np.arctan2(*geometry.rotation(pose)[[1, 0], 0]))
                reached.append((turned, kinematics.inverse(turned, yaw=Yaw.EXACT)))
            except SkillFailure:
                continue
    return reached, poses


CHECKS: tuple[Check[ArmModel], ...] = (
    Check(name="limits", wanted="for each joint: lower below home below upper, all other limits above 0", run=_limits),
    Check(name="home", wanted="a posture clear of itself and the table, gripper down", run=_home),
    Check(name="view", wanted="a home that hides nothing of the shapes' area; fold the arm back", run=_view),
    Check(name="kinematics", wanted="every link where the simulated arm has it", run=_agrees),
    Check(name="inverse", wanted=f"at least {LEAST_REACH:.0%} of the grasps, to {LARGEST_ERROR_M} m", run=_inverse),
    Check(name="capsules", wanted=f"capsules that contain every link to within {SURFACE_M} m", run=_enclosed),
    Check(name="motions", wanted="planned motions that keep the limits", run=_motions),
    Check(name="gripper", wanted="a gripper that grasps on the table without touching it", run=_gripper),
)
