"""The Panda in the scene: its visual meshes, posed by joint angles through the scene's own tree of frames."""

from pathlib import Path

import numpy as np
import trimesh
import viser
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.panda import (
    PANDA_DH,
    PANDA_FINGER_M,
    PANDA_FLANGE_M,
    PANDA_HAND_YAW_RAD,
    PANDA_HOME_Q_RAD,
    PANDA_OPEN_WIDTH_M,
    PANDA_TCP_M,
    DenavitHartenberg,
    panda_mesh_file,
)
from dlokit.skills.viewer import palette
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose


def joint_pose(joint: DenavitHartenberg, q_rad: float) -> Pose:
    """Pose of a link in the frame of the link before it, at joint angle `q_rad` (Craig's convention)."""
    turn = Rotation.from_euler("x", joint.alpha_rad)
    return geometry.pose(
        turn.apply((0.0, 0.0, joint.d_m)) + np.array([joint.a_m, 0.0, 0.0]),
        (turn * Rotation.from_euler("z", q_rad)).as_quat(scalar_first=True),
    )


def finger_pose(side: str, width_m: float) -> Pose:
    """Pose of the ``"left"`` or ``"right"`` finger in the hand's frame, the fingertips `width_m` apart."""
    outwards = 1.0 if side == "left" else -1.0
    wxyz = (1.0, 0.0, 0.0, 0.0) if side == "left" else (0.0, 0.0, 0.0, 1.0)
    return geometry.pose((0.0, outwards * width_m / 2.0, PANDA_FINGER_M), wxyz)


class MeshStore:
    """Meshes of the links, read once."""

    def __init__(self) -> None:
        self._meshes: dict[Path, trimesh.Trimesh] = {}

    def link(self, name: str) -> trimesh.Trimesh:
        """The visual mesh of a link, in its frame. Raises `MachineError` when the meshes are not installed."""
        path = panda_mesh_file(name)
        if path not in self._meshes:
            mesh = trimesh.load_mesh(path, process=True)
            assert isinstance(mesh, trimesh.Trimesh), f"{path} holds {type(mesh).__name__}, not one mesh"
            self._meshes[path] = mesh
        return self._meshes[path]


class Gripper:
    """Hand and fingers below one frame of the scene."""

    def __init__(
        self, scene: viser.SceneApi, hand_frame: str, meshes: MeshStore, color: palette.Rgb, opacity: float | None
    ) -> None:
        _add_mesh(scene, f"{hand_frame}/shape", meshes.link("hand"), color, opacity)
        self._fingers: dict[str, viser.FrameHandle] = {}
        for side in ("left", "right"):
            frame = scene.add_frame(f"{hand_frame}/{side}_finger", show_axes=False)
            tint = color if opacity is not None else palette.GRIPPER_RGB
            _add_mesh(scene, f"{hand_frame}/{side}_finger/shape", meshes.link(f"{side}_finger"), tint, opacity)
            self._fingers[side] = frame
        self.open(PANDA_OPEN_WIDTH_M)

    def open(self, width_m: float) -> None:
        """Set the fingertips `width_m` apart."""
        for side, frame in self._fingers.items():
            place(frame, finger_pose(side, width_m))


class RobotFigure:
    """One Panda; its base is where `root` is."""

    def __init__(self, scene: viser.SceneApi, name: str, meshes: MeshStore) -> None:
        color = palette.ROBOT.color
        self.root = scene.add_frame(name, show_axes=False)
        path = f"{name}/link0"
        scene.add_frame(path, show_axes=False)
        _add_mesh(scene, f"{path}/shape", meshes.link("link0"), color, None)
        self._joints: list[viser.FrameHandle] = []
        for number in range(1, len(PANDA_DH) + 1):
            path = f"{path}/link{number}"
            self._joints.append(scene.add_frame(path, show_axes=False))
            _add_mesh(scene, f"{path}/shape", meshes.link(f"link{number}"), color, None)
        hand = scene.add_frame(f"{path}/hand", show_axes=False)
        wxyz = Rotation.from_euler("z", PANDA_HAND_YAW_RAD).as_quat(scalar_first=True)
        place(hand, geometry.pose((0.0, 0.0, PANDA_FLANGE_M), wxyz))
        self._gripper = Gripper(scene, f"{path}/hand", meshes, color, None)
        self.show(PANDA_HOME_Q_RAD, PANDA_OPEN_WIDTH_M)

    def show(self, q_rad: Float64Array, finger_width_m: float) -> None:
        """Pose the arm by its joint angles (7,) [rad] and the distance between its fingertips [m]."""
        for frame, joint, angle in zip(self._joints, PANDA_DH, q_rad, strict=True):
            place(frame, joint_pose(joint, float(angle)))
        self._gripper.open(finger_width_m)


class GripperGhost:
    """A translucent gripper at a tool pose."""

    def __init__(self, scene: viser.SceneApi, name: str, meshes: MeshStore, color: palette.Rgb) -> None:
        self._tcp = scene.add_frame(name, show_axes=False, visible=False)
        hand = scene.add_frame(f"{name}/hand", show_axes=False)
        hand.position = np.array([0.0, 0.0, -PANDA_TCP_M])
        self._gripper = Gripper(scene, f"{name}/hand", meshes, color, 0.16)

    def show(self, T_world_tcp: Pose, opening_m: float) -> None:
        """Move to a tool pose with the fingertips `opening_m` apart."""
        place(self._tcp, T_world_tcp)
        self._gripper.open(opening_m)
        self._tcp.visible = True


def place(frame: viser.SceneNodeHandle, pose: Pose) -> None:
    """Move a node of the scene to a pose in its parent's frame."""
    frame.position = pose.position_m
    frame.wxyz = pose.wxyz


def _add_mesh(
    scene: viser.SceneApi, name: str, mesh: trimesh.Trimesh, color: palette.Rgb, opacity: float | None
) -> None:
    scene.add_mesh_simple(
        name,
        np.asarray(mesh.vertices),
        np.asarray(mesh.faces),
        color=color,
        opacity=opacity,
        cast_shadow=opacity is None,
        side="double",
    )
