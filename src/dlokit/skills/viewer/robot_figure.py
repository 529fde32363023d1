"""An arm in the scene: its meshes, posed by joint angles through the scene's own tree of frames."""

import numpy as np
import trimesh
import viser
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.fitting import link_mesh
from dlokit.description.arm.model import FINGER_LINKS, HAND, ArmModel, Gripper, Joint
from dlokit.skills.viewer import palette
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose


def joint_pose(joint: Joint, q_rad: float) -> Pose:
    """Pose of a link in the frame of its parent link, at joint angle `q_rad`."""
    turn = Rotation.from_matrix(joint.T_parent_link[:3, :3]) * Rotation.from_euler("z", q_rad)
    return geometry.pose(joint.T_parent_link[:3, 3], turn.as_quat(scalar_first=True))


def finger_pose(gripper: Gripper, link: str, width_m: float) -> Pose:
    """Pose of a finger, one of `FINGER_LINKS`, in the hand's frame, the fingertips `width_m` apart."""
    is_left = link == FINGER_LINKS[0]
    y_m = width_m / 2.0 if is_left else -width_m / 2.0
    return geometry.pose(
        (0.0, y_m, gripper.finger_m + gripper.tip_drop_m(width_m)),
        (1.0, 0.0, 0.0, 0.0) if is_left else (0.0, 0.0, 0.0, 1.0),
    )


class GripperFigure:
    """Hand and fingers below one frame of the scene."""

    def __init__(
        self, scene: viser.SceneApi, hand_frame: str, arm: ArmModel, color: palette.Rgb, opacity: float | None
    ) -> None:
        self._gripper = arm.gripper
        _add_link(scene, f"{hand_frame}/shape", arm, HAND, color, opacity)
        self._fingers: dict[str, viser.FrameHandle] = {}
        for link in FINGER_LINKS:
            frame = scene.add_frame(f"{hand_frame}/{link}", show_axes=False)
            tint = color if opacity is not None else palette.GRIPPER_RGB
            _add_link(scene, f"{hand_frame}/{link}/shape", arm, link, tint, opacity)
            self._fingers[link] = frame
        self.open(arm.gripper.open_width_m)

    def open(self, width_m: float) -> None:
        """Set the fingertips `width_m` apart."""
        for link, frame in self._fingers.items():
            place(frame, finger_pose(self._gripper, link, width_m))


class RobotFigure:
    """One arm, with its base at `root`."""

    def __init__(self, scene: viser.SceneApi, name: str, arm: ArmModel) -> None:
        color = palette.ROBOT.color
        self._arm = arm
        self.root = scene.add_frame(name, show_axes=False)
        path = f"{name}/{arm.base}"
        scene.add_frame(path, show_axes=False)
        _add_link(scene, f"{path}/shape", arm, arm.base, color, None)
        self._joints: list[viser.FrameHandle] = []
        for joint in arm.joints:
            path = f"{path}/{joint.link}"
            self._joints.append(scene.add_frame(path, show_axes=False))
            _add_link(scene, f"{path}/shape", arm, joint.link, color, None)
        place(scene.add_frame(f"{path}/{HAND}", show_axes=False), geometry.pose_from_matrix(arm.T_last_hand))
        self._gripper = GripperFigure(scene, f"{path}/{HAND}", arm, color, None)
        self.show(arm.home_q_rad, arm.gripper.open_width_m)

    def show(self, q_rad: Float64Array, finger_width_m: float) -> None:
        """Pose the arm by its joint angles (J,) [rad] and the distance between its fingertips [m]."""
        for frame, joint, angle in zip(self._joints, self._arm.joints, q_rad, strict=True):
            place(frame, joint_pose(joint, float(angle)))
        self._gripper.open(finger_width_m)


class GripperGhost:
    """A translucent gripper at a tool pose."""

    def __init__(self, scene: viser.SceneApi, name: str, arm: ArmModel, color: palette.Rgb) -> None:
        self._tcp = scene.add_frame(name, show_axes=False, visible=False)
        hand = scene.add_frame(f"{name}/{HAND}", show_axes=False)
        hand.position = np.array([0.0, 0.0, -arm.gripper.tcp_m])
        self._gripper = GripperFigure(scene, f"{name}/{HAND}", arm, color, 0.16)

    def show(self, T_world_tcp: Pose, opening_m: float) -> None:
        """Move to a tool pose with the fingertips `opening_m` apart."""
        place(self._tcp, T_world_tcp)
        self._gripper.open(opening_m)
        self._tcp.visible = True

    def hide(self) -> None:
        """Hide until it is shown again."""
        self._tcp.visible = False


def place(frame: viser.SceneNodeHandle, pose: Pose) -> None:
    """Move a node of the scene to a pose in its parent's frame."""
    frame.position = pose.position_m
    frame.wxyz = pose.wxyz


def _add_link(
    scene: viser.SceneApi, name: str, arm: ArmModel, link: str, color: palette.Rgb, opacity: float | None
) -> None:
    mesh: trimesh.Trimesh = link_mesh(arm, link, merged=True)
    scene.add_mesh_simple(
        name,
        np.asarray(mesh.vertices),
        np.asarray(mesh.faces),
        color=color,
        opacity=opacity,
        cast_shadow=opacity is None,
        side="double",
    )
