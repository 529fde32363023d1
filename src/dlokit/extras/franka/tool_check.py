"""Checks that the connected arm fits the model: its tool's frame and mass, and its kinematics. Pure."""

import numpy as np

from dlokit.description.arm.model import FINGER_LINKS, HAND, ArmModel
from dlokit.extras.franka.channel import StreamState
from dlokit.geometry import homogeneous, matrix
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.types.arrays import Float64Array

LARGEST_M = 0.001
"""Largest distance of the tool's frame, and of the tool by forward kinematics, from the model's [m]."""
LARGEST_RAD = 0.005
"""The same for its orientation [rad]; Desk shows three digits."""
LARGEST_KG = 0.05
"""Largest difference of the tool's mass [kg]; tables of the same hand differ by the fingers' 0.03."""
_FLANGE_M = 0.107
"""From Franka's link 7 to its flange, along z [m]."""


def mismatch(arm: ArmModel, state: StreamState, load_kg: float) -> str:
    """A text with the difference and the remedy; empty if everything agrees."""
    T_flange_tool = flange_tool(arm)
    found = np.reshape(state.T_flange_tool, (4, 4))
    if _apart(found, T_flange_tool):
        return (
            f"the tool's frame of the arm is {_told(found)} from the flange, that of the model {arm.title} is "
            f"{_told(T_flange_tool)}: choose the hand as end effector in Desk (Settings, End Effector)"
        )
    hand_kg = arm.inertias[HAND].mass_kg
    with_fingers_kg = hand_kg + sum(arm.inertias[finger].mass_kg for finger in FINGER_LINKS)
    if min(abs(state.tool_kg - hand_kg), abs(state.tool_kg - with_fingers_kg)) > LARGEST_KG:
        return (
            f"the tool of the arm weighs {state.tool_kg:.3f} kg, that of the model {hand_kg:.3f} kg: choose the hand "
            "as end effector in Desk; a camera or a bracket on it belongs into --driver.load-kg"
        )
    if abs(state.load_kg - load_kg) > 1e-3:
        return f"the arm has a load of {state.load_kg:.3f} kg, {load_kg:.3f} kg were set: restart its controller"
    T = np.reshape(state.T_base_tool, (4, 4))
    model = matrix(tcp_pose(arm, np.array(state.q)))
    if _apart(T, model):
        off_mm = 1e3 * float(np.linalg.norm(T[:3, 3] - model[:3, 3]))
        return (
            f"at the same angles the tool of the arm is at {_told(T)}, by the model at {_told(model)}, {off_mm:.1f} mm "
            "apart: is --arm the arm that answers, and has it the frame of its hand?"
        )
    return ""


def flange_tool(arm: ArmModel) -> Float64Array:
    """Pose of the tool centre point in the frame of the arm's flange, (4, 4)."""
    return np.linalg.inv(homogeneous(np.eye(3), (0.0, 0.0, _FLANGE_M))) @ arm.T_last_tcp


def _apart(a: Float64Array, b: Float64Array) -> bool:
    turned_rad = np.arccos(np.clip((np.trace(a[:3, :3].T @ b[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))
    return bool(np.linalg.norm(a[:3, 3] - b[:3, 3]) > LARGEST_M or turned_rad > LARGEST_RAD)


def _told(T: Float64Array) -> str:
    x, y, z = 1e3 * T[:3, 3]
    return f"({x:.1f}, {y:.1f}, {z:.1f}) mm"
