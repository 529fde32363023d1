"""A rope on a textured table, rendered in stereo: images with known truth, for the tests of perception."""

import itertools
from dataclasses import dataclass

import mujoco
import numpy as np
from made_states import ARM_AT_REST
from msgspec import structs
from numpy.typing import NDArray

from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mujoco_model import add_arm
from dlokit.geometry import compose, pose, pose_from_matrix
from dlokit.types.arrays import Float64Array
from dlokit.types.image import CameraCalibration, StereoImages
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState

WIDTH_PX, HEIGHT_PX, FOCAL_PX, BASELINE_M = 640, 560, 722.0, 0.0998
ROPE_RADIUS_M = 0.004


def camera_pose() -> Pose:
    """T_world_camera of the paper's rig."""
    T = np.eye(4)
    T[:3] = [
        [-0.9983, -0.0537, -0.0224, 0.570],
        [-0.0343, 0.8540, -0.5191, 0.016],
        [0.0470, -0.5174, -0.8544, 1.159],
    ]
    u, _, vt = np.linalg.svd(T[:3, :3])
    T[:3, :3] = u @ vt
    return pose_from_matrix(np.linalg.inv(T))


def calibration(T_world_camera: Pose | None = None) -> CameraCalibration:
    return CameraCalibration(
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        fx_px=FOCAL_PX,
        fy_px=FOCAL_PX,
        cx_px=319.5,
        cy_px=279.5,
        baseline_m=BASELINE_M,
        T_world_camera=T_world_camera or camera_pose(),
    )


def s_curve(height_m: float = ROPE_RADIUS_M) -> Float64Array:
    """Centre line of a rope in the shape of an S, (81, 3) [m]."""
    t = np.linspace(-1.0, 1.0, 81)
    return np.column_stack([0.52 + 0.2 * t, 0.09 * np.sin(np.pi * t), np.full_like(t, height_m)])


def robot_state(q_rad: Float64Array, finger_width_m: float = 0.08) -> RobotState:
    return structs.replace(
        ARM_AT_REST,
        q_rad=q_rad,
        finger_width_m=finger_width_m,
    )


@dataclass(frozen=True)
class Scene:
    """Images with their ground truth."""

    images: StereoImages
    nodes_world: Float64Array  # (K, 3) [m] centre line of the rope
    robot: RobotState


def render(
    nodes_world: Float64Array,
    *,
    q_rad: Float64Array | None = None,
    T_believed_from_true: Pose | None = None,
    noise: float = 2.0,
    stamp_ns: int = 1_000_000,
) -> Scene:
    """Pictures of a rope along `nodes_world` (K, 3) [m], with the Panda in `q_rad`."""
    q = PANDA.home_q_rad if q_rad is None else q_rad
    model = _model(nodes_world)
    data = mujoco.MjData(model)
    data.qpos[:7] = q
    data.qpos[7:9] = 0.04
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    pictures: list[NDArray[np.uint8]] = []
    with mujoco.Renderer(model, HEIGHT_PX, WIDTH_PX) as renderer:
        for side in ("left", "right"):
            renderer.update_scene(data, camera=side)
            picture = renderer.render().astype(np.float64) + rng.normal(0.0, noise, (HEIGHT_PX, WIDTH_PX, 1))
            pictures.append(np.clip(picture, 0, 255).astype(np.uint8))
    believed = camera_pose() if T_believed_from_true is None else compose(T_believed_from_true, camera_pose())
    images = StereoImages(stamp_ns=stamp_ns, left=pictures[0], right=pictures[1], calibration=calibration(believed))
    return Scene(images, nodes_world, robot_state(q))


def _model(nodes_world: Float64Array) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = WIDTH_PX, HEIGHT_PX
    spec.visual.quality.shadowsize = 0
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 20.0
    rng = np.random.default_rng(1)
    texels = rng.integers(10, 90, (300, 300, 1)).repeat(3, axis=2)
    spec.add_texture(
        name="table",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        width=300,
        height=300,
        nchannel=3,
        data=texels.ravel().tolist(),
    )
    material = spec.add_material(name="table", texrepeat=[1.5, 1.5])
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "table"
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.8, 0.8, 0.1], pos=[0.5, 0.0, 0.0], material="table"
    )
    spec.worldbody.add_light(pos=[0.5, 0.3, 2.0], dir=[0.0, -0.1, -1.0], castshadow=False)
    add_arm(spec, PANDA, name="panda")
    for a, b in itertools.pairwise(nodes_world):
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*a, *b],
            size=[ROPE_RADIUS_M, 0.0, 0.0],
            rgba=(0.95, 0.85, 0.2, 1.0),
            contype=0,
            conaffinity=0,
        )
    left = camera_pose()
    for side, shift in (("left", 0.0), ("right", BASELINE_M)):
        T = compose(left, pose((shift, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)))  # MuJoCo's camera looks along -z, y up
        spec.worldbody.add_camera(
            name=side,
            pos=T.position_m,
            quat=T.wxyz,
            resolution=[WIDTH_PX, HEIGHT_PX],
            sensor_size=[WIDTH_PX / FOCAL_PX, HEIGHT_PX / FOCAL_PX],
            focal_length=[1.0, 1.0],
        )
    return spec.compile()
