"""Whether the arm that answers is the arm of the model."""

import numpy as np
import pytest

from dlokit.description.arm.franka import FR3
from dlokit.extras.franka.channel import StreamState
from dlokit.extras.franka.tool_check import mismatch
from dlokit.geometry import matrix
from dlokit.motion.forward_kinematics import tcp_pose
from dlokit.types.arrays import Float64Array


def turned_about_z(angle_rad: float, z_m: float) -> Float64Array:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cosine, -sine, 0.0, 0.0], [sine, cosine, 0.0, 0.0], [0.0, 0.0, 1.0, z_m], [0.0, 0.0, 0.0, 1.0]])


def state(
    T_flange_tool: Float64Array | None = None,
    tool_kg: float = 0.73,
    load_kg: float = 0.0,
    off_m: float = 0.0,
) -> StreamState:
    """What an FR3 with its hand reports; the hand's frame is Franka's published one."""
    flange = turned_about_z(-np.pi / 4, 0.1034) if T_flange_tool is None else T_flange_tool
    tool = matrix(tcp_pose(FR3, FR3.home_q_rad))
    tool[0, 3] += off_m
    return StreamState(
        read_ns=1,
        robot_ms=1,
        phase=1,
        motion_id=0,
        ending=0,
        mode=1,
        errors=0,
        turns=0,
        largest_error_rad=0.0,
        mean_error_rad=0.0,
        took_s=0.0,
        q=tuple(FR3.home_q_rad),
        dq=(0.0,) * 7,
        tau=(0.0,) * 7,
        wrench=(0.0,) * 6,
        T_base_tool=tuple(tool.ravel()),
        T_flange_tool=tuple(flange.ravel()),
        tool_kg=tool_kg,
        load_kg=load_kg,
    )


def test_the_arm_of_the_model_passes() -> None:
    assert mismatch(FR3, state(), 0.0) == ""
    assert mismatch(FR3, state(tool_kg=0.76, load_kg=0.2, off_m=0.0009), 0.2) == ""


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (state(T_flange_tool=np.eye(4)), "choose the hand as end effector in Desk"),
        (state(T_flange_tool=turned_about_z(-np.pi / 4, 0.1045)), "tool's frame"),
        (state(T_flange_tool=turned_about_z(0.0, 0.1034)), "tool's frame"),
        (state(tool_kg=0.5), "weighs 0.500 kg"),
        (state(load_kg=0.4), "load of 0.400 kg"),
        (state(off_m=0.0015), "1.5 mm apart"),
    ],
)
def test_another_tool_mass_load_or_kinematics_is_named(wrong: StreamState, said: str) -> None:
    assert said in mismatch(FR3, wrong, 0.0)
