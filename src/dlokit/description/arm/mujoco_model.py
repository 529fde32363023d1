"""An arm with its hand, added to a MuJoCo model.

The frictional grasp needs elliptic friction cones and ``impratio`` of at least 20, and the stiff joint actuators the
``discrete`` (or an implicit) integrator, in the options of the model that it is added to.
"""

from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.description.arm.model import FINGER_LINKS, HAND, ArmModel, Joint, Surface
from dlokit.description.table import CONTACT_SOLIMP, CONTACT_SOLREF, ROBOT_BIT, WORLD_BIT
from dlokit.types.pose import Pose

_DAMPING_TIME_S = 0.1
"""Damping over stiffness of each joint actuator: send ``q + 0.1 s · q̇`` for a trajectory to be followed closely."""
_ARMATURE_KG_M2 = 0.1
_FINGER_STIFFNESS_N_M = 2000.0
_FINGER_ARMATURE_KG = 0.1
_FINGER_DAMPING_N_S_M = 28.0  # critical for stiffness and armature above
_VISUAL_ONLY: dict[str, Any] = {"group": 2, "contype": 0, "conaffinity": 0, "mass": 0.0}
"""Attributes of geoms that are only drawn: they do not collide and have no mass."""
_COLLISION_GROUP = 3
_LIGHT, _DARK = (0.92, 0.93, 0.94, 1.0), (0.22, 0.23, 0.25, 1.0)
_OUTWARDS = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))  # quaternions of the fingers' frames in the hand's


def add_arm(
    spec: mujoco.MjSpec,
    arm: ArmModel,
    *,
    name: str = "arm",
    T_world_base: Pose | None = None,
    visual: bool = True,
) -> None:
    """Add an arm with its hand to a model, all its elements under ``name/``.

    Bodies by the arm's `links`; joints ``joint1`` … ``jointJ``, ``finger_joint1`` and ``finger_joint2`` [m, each finger
    from the middle]; site ``tcp`` (z approach, y the direction in which the fingers open); position actuators
    ``joint1`` … ``jointJ`` [rad], ``finger1`` and ``finger2`` [m]; geoms ``pad_left`` and ``pad_right``. Gravity is
    compensated. Visual meshes are in group 2, collision shapes in group 3. Raises `MachineError` when the visual meshes
    are not installed; without `visual` they are not needed.
    """
    body = spec.worldbody.add_body(name=f"{name}/{arm.base}")
    if T_world_base is not None:
        body.pos, body.quat = T_world_base.position_m, T_world_base.wxyz
    _dress(arm, body, arm.base)
    for index, joint in enumerate(arm.joints):
        body = _child(arm, body, name, joint.link, geometry.pose_from_matrix(joint.T_parent_link))
        _add_arm_joint(spec, arm, body, name, index)
    hand = _child(arm, body, name, HAND, geometry.pose_from_matrix(arm.T_last_hand))
    hand.add_site(name=f"{name}/tcp", pos=[0.0, 0.0, arm.gripper.tcp_m], size=[0.003] * 3, group=4)
    for number, outwards in enumerate(_OUTWARDS, start=1):
        _add_finger(spec, arm, hand, name, number=number, quat=outwards)
    # One drive moves both fingers of a parallel gripper.
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
        for link in arm.links:
            _add_looks(spec, arm, name, link)


def _add_looks(spec: mujoco.MjSpec, arm: ArmModel, name: str, link: str) -> None:
    """The meshes of a link, or its capsules if it has no mesh."""
    body = spec.body(f"{name}/{link}")
    for number, surface in enumerate(arm.surfaces.get(link, ())):
        _add_mesh(spec, body, f"{name}/{link}" + (f"/{number}" if number else ""), surface)
    if link not in arm.surfaces:
        _add_capsules(body, arm, link, rgba=_DARK, **_VISUAL_ONLY)


def _add_capsules(body: mujoco.MjsBody, arm: ArmModel, link: str, **options: Any) -> None:
    for capsule in arm.capsules:
        if capsule.link == link:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[*capsule.start_m, *capsule.end_m],
                size=[capsule.radius_m, 0.0, 0.0],
                **options,
            )


def _add_mesh(spec: mujoco.MjSpec, body: mujoco.MjsBody, label: str, surface: Surface) -> None:
    mesh = spec.add_mesh(name=label, file=str(surface.path))
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # the surfaces are not all closed
    T = geometry.pose_from_matrix(surface.T_link_mesh)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=label,
        pos=T.position_m,
        quat=T.wxyz,
        rgba=_DARK if surface.dark else _LIGHT,
        **_VISUAL_ONLY,
    )


def _child(arm: ArmModel, parent: mujoco.MjsBody, name: str, link: str, T_parent_link: Pose) -> mujoco.MjsBody:
    body = parent.add_body(name=f"{name}/{link}", pos=T_parent_link.position_m, quat=T_parent_link.wxyz)
    _dress(arm, body, link)
    return body


def _dress(arm: ArmModel, body: mujoco.MjsBody, link: str) -> None:
    """Give a body its inertia and its collision capsules."""
    inertia = arm.inertias[link]
    body.mass, body.ipos, body.fullinertia = inertia.mass_kg, inertia.center_m, inertia.inertia_kg_m2
    body.explicitinertial = True
    body.gravcomp = 1.0
    _add_capsules(
        body,
        arm,
        link,
        group=_COLLISION_GROUP,
        # The base touches the table. Trajectories are checked for self collision before they run.
        contype=0 if link == arm.base else ROBOT_BIT,
        conaffinity=0 if link == arm.base else WORLD_BIT,
        mass=0.0,
        rgba=(0.2, 0.5, 0.9, 0.3),
    )


def _add_arm_joint(spec: mujoco.MjSpec, arm: ArmModel, body: mujoco.MjsBody, name: str, index: int) -> None:
    label = f"{name}/joint{index + 1}"
    joint: Joint = arm.joints[index]
    bounds = np.array([arm.limits.position_lower_rad[index], arm.limits.position_upper_rad[index]])
    body.add_joint(
        name=label,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 0.0, 1.0],
        range=np.degrees(bounds) if spec.compiler.degree else bounds,
        limited=True,
        armature=_ARMATURE_KG_M2,
    )
    actuator = _add_actuator(spec, label, label, joint.torque_nm)
    actuator.set_to_position(kp=joint.stiffness_nm_rad, kv=_DAMPING_TIME_S * joint.stiffness_nm_rad)


def _add_finger(
    spec: mujoco.MjSpec, arm: ArmModel, hand: mujoco.MjsBody, name: str, *, number: int, quat: ArrayLike
) -> None:
    gripper, link = arm.gripper, FINGER_LINKS[number - 1]
    # The simulated fingers move straight: as low as real ones that move along an arc are when they hold something.
    z_m = gripper.finger_m + gripper.largest_tip_drop_m
    finger = _child(arm, hand, name, link, geometry.pose((0.0, 0.0, z_m), quat))
    finger.add_joint(
        name=f"{name}/finger_joint{number}",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0.0, 1.0, 0.0],
        range=(0.0, gripper.open_width_m / 2.0),
        limited=True,
        armature=_FINGER_ARMATURE_KG,
    )
    # The fingertip as a box about the tool centre point; both meet when the hand is shut.
    finger.add_geom(
        name=f"{name}/pad_{link.removesuffix('_finger')}",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=(0.0, gripper.pad_half_thickness_m, round(gripper.tcp_m - gripper.finger_m, 9)),
        size=(gripper.pad_half_length_m, gripper.pad_half_thickness_m, gripper.tip_below_tcp_m),
        group=_COLLISION_GROUP,
        contype=ROBOT_BIT,
        conaffinity=WORLD_BIT,
        # Rubber. Two points of contact resist the turning of an edge between the pads. One does not, where an edge
        # touches them with its round end only: a torsional coefficient would hold all of that edge.
        condim=3,
        priority=1,
        friction=(1.2, 0.0, 0.0),
        solref=CONTACT_SOLREF,
        solimp=CONTACT_SOLIMP,
        mass=0.0,
        rgba=(0.1, 0.1, 0.1, 1.0),
    )
    actuator = _add_actuator(spec, f"{name}/finger{number}", f"{name}/finger_joint{number}", gripper.force_n)
    actuator.set_to_position(kp=_FINGER_STIFFNESS_N_M, kv=_FINGER_DAMPING_N_S_M)


def _add_actuator(spec: mujoco.MjSpec, name: str, joint: str, force: float) -> mujoco.MjsActuator:
    return spec.add_actuator(
        name=name,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        forcelimited=True,
        forcerange=(-force, force),
    )
