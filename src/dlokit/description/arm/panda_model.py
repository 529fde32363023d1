"""The Franka Emika Panda with its hand, as a MuJoCo model builder.

The numbers are in `panda_data`, the shapes in `panda_shape`; both are usable without MuJoCo. The frictional grasp
needs elliptic friction cones and ``impratio`` of at least 20, and the stiff joint actuators the ``discrete`` (or an
implicit) integrator, in the options of the model that it is added to.
"""

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from dlokit.description.arm.panda import (
    PAD_CENTER_M,
    PAD_HALF_SIZE_M,
    PANDA_COLLISION,
    PANDA_DH,
    PANDA_FINGER_M,
    PANDA_FLANGE_M,
    PANDA_GRASP_HEIGHT_M,
    PANDA_HAND_YAW_RAD,
    PANDA_HOME_Q_RAD,
    PANDA_INERTIAS,
    PANDA_LIMITS,
    PANDA_LINKS,
    PANDA_OPEN_WIDTH_M,
    PANDA_TCP_M,
    PANDA_TORQUE_NM,
    Capsule,
    panda_mesh_file,
)
from dlokit.description.contacts import CONTACT_SOLIMP, CONTACT_SOLREF, ROBOT_BIT, WORLD_BIT
from dlokit.types.pose import Pose

__all__ = [
    "PANDA_COLLISION",
    "PANDA_GRASP_HEIGHT_M",
    "PANDA_HOME_Q_RAD",
    "PANDA_LIMITS",
    "PANDA_LINKS",
    "Capsule",
    "add_panda",
]

_JOINT_STIFFNESS = (4500.0, 4500.0, 3500.0, 3500.0, 2000.0, 2000.0, 2000.0)  # [N·m/rad]
_DAMPING_TIME_S = 0.1
"""Damping over stiffness of each joint actuator: send ``q + 0.1 s · q̇`` for a trajectory to be followed closely."""
_ARMATURE_KG_M2 = 0.1
_FINGER_STIFFNESS_N_M = 2000.0
_FINGER_ARMATURE_KG = 0.1
_FINGER_DAMPING_N_S_M = 28.0  # critical for stiffness and armature above
FINGER_FORCE_N = 70.0
"""Largest continuous force of the hand; set a lower ``actuator_forcerange`` to grip more gently."""
_VISUAL_GROUP = 2
_COLLISION_GROUP = 3
_WHITE, _DARK = (0.92, 0.93, 0.94, 1.0), (0.22, 0.23, 0.25, 1.0)


def add_panda(
    spec: mujoco.MjSpec, *, name: str = "panda", T_world_base: Pose | None = None, visual: bool = True
) -> None:
    """Add a Panda with hand to a model, all its elements under ``name/``.

    Bodies ``link0`` … ``link7``, ``hand``, ``left_finger``, ``right_finger``; joints ``joint1`` … ``joint7``,
    ``finger_joint1`` and ``finger_joint2`` [m, 0 to 0.04, each finger from the middle]; site ``tcp`` (z approach,
    y the direction in which the fingers open); position actuators ``joint1`` … ``joint7`` [rad], ``finger1`` and
    ``finger2`` [m]; geoms ``pad_left`` and ``pad_right``. Gravity is compensated. Visual meshes are in group 2,
    collision shapes in group 3. Raises `MachineError` when the visual meshes are not installed; without `visual` they
    are not needed.
    """
    body = spec.worldbody.add_body(name=f"{name}/link0")
    if T_world_base is not None:
        body.pos, body.quat = T_world_base.position_m, T_world_base.wxyz
    _dress(body, "link0")
    for index, joint in enumerate(PANDA_DH):
        half = joint.alpha_rad / 2
        # Craig's order: the turn about x comes first, so the offset d lies along the turned z axis.
        offset = (joint.a_m, -np.sin(joint.alpha_rad) * joint.d_m, np.cos(joint.alpha_rad) * joint.d_m)
        body = _child(body, name, f"link{index + 1}", offset, (np.cos(half), np.sin(half), 0.0, 0.0))
        _add_arm_joint(spec, body, name, index)
    half = PANDA_HAND_YAW_RAD / 2
    hand = _child(body, name, "hand", (0.0, 0.0, PANDA_FLANGE_M), (np.cos(half), 0.0, 0.0, np.sin(half)))
    hand.add_site(name=f"{name}/tcp", pos=[0.0, 0.0, PANDA_TCP_M], size=[0.003] * 3, group=4)
    _add_finger(spec, hand, name, side="left", number=1, quat=(1.0, 0.0, 0.0, 0.0))
    _add_finger(spec, hand, name, side="right", number=2, quat=(0.0, 0.0, 0.0, 1.0))
    # One belt drives both fingers of the real hand.
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        name=f"{name}/fingers",
        name1=f"{name}/finger_joint1",
        name2=f"{name}/finger_joint2",
        data=[0.0, 1.0, *[0.0] * 10],
        solref=CONTACT_SOLREF,
        solimp=CONTACT_SOLIMP,
    )
    if visual:
        for link in PANDA_LINKS:
            _add_mesh(spec, name, link)


def _add_mesh(spec: mujoco.MjSpec, name: str, link: str) -> None:
    mesh = spec.add_mesh(name=f"{name}/{link}", file=str(panda_mesh_file(link)))
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # the surfaces are not all closed
    spec.body(f"{name}/{link}").add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=f"{name}/{link}",
        group=_VISUAL_GROUP,
        contype=0,
        conaffinity=0,
        mass=0.0,
        rgba=_DARK if link.endswith("finger") else _WHITE,
    )


def _child(parent: mujoco.MjsBody, name: str, link: str, pos: ArrayLike, quat: ArrayLike) -> mujoco.MjsBody:
    body = parent.add_body(name=f"{name}/{link}", pos=pos, quat=quat)
    _dress(body, link)
    return body


def _dress(body: mujoco.MjsBody, link: str) -> None:
    """Give a body its inertia and its collision capsules."""
    inertia = PANDA_INERTIAS[link]
    body.mass, body.ipos, body.fullinertia = inertia.mass_kg, inertia.center_m, inertia.inertia_kg_m2
    body.explicitinertial = True
    body.gravcomp = 1.0
    for capsule in PANDA_COLLISION:
        if capsule.link == link:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[*capsule.start_m, *capsule.end_m],
                size=[capsule.radius_m, 0.0, 0.0],
                group=_COLLISION_GROUP,
                # The base stands on the table. Trajectories are checked for self collision before they run.
                contype=0 if link == "link0" else ROBOT_BIT,
                conaffinity=0 if link == "link0" else WORLD_BIT,
                mass=0.0,
                rgba=(0.2, 0.5, 0.9, 0.3),
            )


def _add_arm_joint(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, index: int) -> None:
    label = f"{name}/joint{index + 1}"
    bounds = np.array([PANDA_LIMITS.position_lower_rad[index], PANDA_LIMITS.position_upper_rad[index]])
    body.add_joint(
        name=label,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 0.0, 1.0],
        range=np.degrees(bounds) if spec.compiler.degree else bounds,
        limited=True,
        armature=_ARMATURE_KG_M2,
    )
    actuator = _add_actuator(spec, label, label, PANDA_TORQUE_NM[index])
    stiffness = _JOINT_STIFFNESS[index]
    actuator.set_to_position(kp=stiffness, kv=_DAMPING_TIME_S * stiffness)


def _add_finger(
    spec: mujoco.MjSpec, hand: mujoco.MjsBody, name: str, *, side: str, number: int, quat: ArrayLike
) -> None:
    finger = _child(hand, name, f"{side}_finger", (0.0, 0.0, PANDA_FINGER_M), quat)
    finger.add_joint(
        name=f"{name}/finger_joint{number}",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0.0, 1.0, 0.0],
        range=(0.0, PANDA_OPEN_WIDTH_M / 2.0),
        limited=True,
        armature=_FINGER_ARMATURE_KG,
    )
    finger.add_geom(
        name=f"{name}/pad_{side}",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=PAD_CENTER_M,
        size=PAD_HALF_SIZE_M,
        group=_COLLISION_GROUP,
        contype=ROBOT_BIT,
        conaffinity=WORLD_BIT,
        condim=4,
        friction=(1.2, 0.005, 0.0001),  # rubber; the second resists turning about the finger's direction [m]
        solref=CONTACT_SOLREF,
        solimp=CONTACT_SOLIMP,
        mass=0.0,
        rgba=(0.1, 0.1, 0.1, 1.0),
    )
    actuator = _add_actuator(spec, f"{name}/finger{number}", f"{name}/finger_joint{number}", FINGER_FORCE_N)
    actuator.set_to_position(kp=_FINGER_STIFFNESS_N_M, kv=_FINGER_DAMPING_N_S_M)


def _add_actuator(spec: mujoco.MjSpec, name: str, joint: str, force: float) -> mujoco.MjsActuator:
    return spec.add_actuator(
        name=name,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        forcelimited=True,
        forcerange=(-force, force),
    )
