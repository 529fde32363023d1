"""Poses in which an arm shows a board to a camera: all of it in view, near to facing, within reach, and clear.

The poses fill the space above the table where a DLO is handled, and turn the board about all axes, because this
makes the unknowns of a calibration observable. Every motion between two poses is a straight line in joint space, on
which the board is kept clear of table, fixtures and arm: the arm's own checks do not include the board.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import FINGER_LINKS, HAND, ArmModel
from dlokit.description.board import CharucoBoard
from dlokit.description.scene import Fixture
from dlokit.description.table import TABLE_TOP_M
from dlokit.errors import SkillFailure
from dlokit.geometry.camera import SIDES, camera_alone, project
from dlokit.motion.collisions import COLLISION_STEP_RAD, Capsules, capsule_distances, check_collisions, thinned
from dlokit.motion.fixture_checks import check_fixtures_clear
from dlokit.motion.fixture_clearance import fixture_solids, gaps_m, rounded_boxes
from dlokit.motion.forward_kinematics import capsule_ends, tcp_matrices
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.trajectories import joint_move
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose

LOWER_WORLD, UPPER_WORLD = (0.35, -0.25, 0.14), (0.68, 0.25, 0.50)
"""Corners of the box in which the arm shows the centre of the board [m]."""
_TILT_RAD = 0.65
"""Largest angle between the board's normal and the line to the camera: corners are then found to 0.1 px."""
_ROLL_RAD = 0.7
"""Largest turn of the board about its normal, from upright."""
_MARGIN_PX = 12.0
"""Distance of the board from the edges of both pictures [px], because the pose of the camera is approximate."""
_NEAREST_M = 0.2
"""Smallest distance of the board in front of the camera [m]."""
_CLEAR_M = 0.03
"""Distance of the board from table and arm [m]."""
_THICK_M = 0.01
"""Half the thickness of the board [m], generously."""
_NEAR_JOINTS = 2
"""Links of the last joints, hand and fingers, which move little or not at all relative to the board."""
_DRAWS = 60
"""Most draws per requested pose."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldBoard:
    """A board, with its approximate pose in the tool."""

    board: CharucoBoard
    T_tcp_board: Pose
    arm: ArmModel = PANDA
    T_world_base: Pose | None = None
    """Pose of the arm's base; None: at the world's origin."""
    fixtures: tuple[Fixture, ...] = ()
    """What stands on the table."""


def board_poses(
    held: HeldBoard, camera: CameraCalibration, count: int, rng: np.random.Generator
) -> tuple[Float64Array, ...]:
    """`count` joint angles (J,) [rad] that show the board, in the order to move to them from home.

    `camera` has the approximate pose of the camera. Raises `SkillFailure` few_poses if fewer poses are found.
    """
    kinematics = ArmKinematics(held.arm, held.T_world_base)
    T_board_tcp = geometry.inverse(held.T_tcp_board)
    home = held.arm.home_q_rad
    route = [home]
    for _ in range(_DRAWS * count):
        if len(route) > count:
            return tuple(route[1:])
        T_world_board = _drawn(held.board, camera, rng)
        if not _in_view(held.board, T_world_board, camera):
            continue
        try:
            q = kinematics.inverse(geometry.compose(T_world_board, T_board_tcp), route[-1])
        except SkillFailure:
            continue
        if _path_is_clear(route[-1], q, held) and _path_is_clear(q, home, held):
            route.append(q)
    raise SkillFailure(
        "few_poses",
        f"only {len(route) - 1} of {count} poses were found in which the arm can show the board to the camera; is the "
        f"pose of the camera about right, and does it see the space from {LOWER_WORLD} to {UPPER_WORLD} m?",
    )


def _drawn(board: CharucoBoard, camera: CameraCalibration, rng: np.random.Generator) -> Pose:
    """A pose of the board in the box, facing the camera except for tilt and roll."""
    centre = rng.uniform(LOWER_WORLD, UPPER_WORLD)
    into = centre - camera.T_world_camera.position_m
    z = into / np.linalg.norm(into)
    y = np.array([0.0, 0.0, -1.0])
    y -= (y @ z) * z
    y /= np.linalg.norm(y)
    facing = Rotation.from_matrix(np.column_stack([np.cross(y, z), y, z]))
    direction = rng.uniform(0.0, 2.0 * np.pi)
    tilt = _TILT_RAD * np.sqrt(rng.uniform()) * np.array([np.cos(direction), np.sin(direction), 0.0])
    roll = rng.uniform(-_ROLL_RAD, _ROLL_RAD) * np.array([0.0, 0.0, 1.0])
    turn = facing * Rotation.from_rotvec(tilt) * Rotation.from_rotvec(roll)
    middle = board.outline_board.mean(axis=0)
    return geometry.pose(centre - turn.apply(middle), turn.as_quat(scalar_first=True))


def _in_view(board: CharucoBoard, T_world_board: Pose, camera: CameraCalibration) -> bool:
    """Whether all of the board is in the left picture, and in the right one if there is one."""
    outline = geometry.transform(T_world_board, board.outline_board)
    size = np.array([camera.width_px, camera.height_px])
    for side in SIDES if camera.baseline_m else SIDES[:1]:
        seen = project(outline, camera_alone(camera, side))
        if not np.all(seen.depth_m > _NEAREST_M):
            return False
        if not np.all((seen.pixels > _MARGIN_PX) & (seen.pixels < size - _MARGIN_PX)):
            return False
    return True


def _path_is_clear(start_q_rad: Float64Array, end_q_rad: Float64Array, held: HeldBoard) -> bool:
    q = thinned(joint_move(start_q_rad, end_q_rad, held.arm.limits).q_rad, COLLISION_STEP_RAD)
    try:
        check_collisions(held.arm, q, held.T_world_base)
        check_fixtures_clear(held.arm, q, held.arm.gripper.open_width_m, held.fixtures, held.T_world_base)
    except SkillFailure:
        return False
    return bool(np.all(_board_is_clear(q, held)))


def _board_is_clear(q_rad: Float64Array, held: HeldBoard) -> BoolArray:
    """Whether the board is clear of table, fixtures and arm (K,) at angles (K, J) [rad]."""
    tools = tcp_matrices(held.arm, q_rad)
    if held.T_world_base is not None:
        tools = geometry.matrix(held.T_world_base) @ tools
    T = tools @ geometry.matrix(held.T_tcp_board)
    outline = np.einsum("kij,cj->kci", T[:, :3, :3], held.board.outline_board) + T[:, None, :3, 3]
    above = np.all(outline[..., 2] > TABLE_TOP_M + _CLEAR_M, axis=1)
    if held.fixtures:
        middle, half = held.board.outline_board.mean(axis=0), np.ptp(held.board.outline_board, axis=0) / 2.0
        board = rounded_boxes(T @ geometry.homogeneous(np.eye(3), middle), half, _THICK_M)
        above &= np.all(gaps_m(board[:, None], fixture_solids(held.fixtures)) > _CLEAR_M, axis=(1, 2))
    start, end = capsule_ends(held.arm, q_rad, T_world_base=held.T_world_base)
    near = (*(joint.link for joint in held.arm.joints[-_NEAR_JOINTS:]), HAND, *FINGER_LINKS)
    links = np.array([capsule.link not in near for capsule in held.arm.capsules])
    # The edges and the diagonals represent the board: the links are thicker than the gaps between them.
    first, second = ([0, 1, 2, 3, 0, 1], [1, 2, 3, 0, 2, 3])
    edges = Capsules(outline[:, first, None], outline[:, second, None], np.array(_THICK_M))
    arm = Capsules(start[:, None, links], end[:, None, links], held.arm.radii_m[links])
    return above & np.all(capsule_distances(edges, arm) > _CLEAR_M, axis=(1, 2))
