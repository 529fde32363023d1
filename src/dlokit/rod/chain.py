"""A DLO in MuJoCo as a chain: stiff capsules on ball joints with bending stiffness, damping and yield.

Unlike the discrete elastic rod in `rod`, it takes a set: a joint that is bent beyond its yield angle keeps the
excess (ideal elastoplasticity; MuJoCo's ``springyield``). A joint's stiffness is ``EI / ds`` about every axis, also in
torsion; its damping is the same fraction of the stiffness as in the rod. Links cannot stretch. The root is
in the middle: two short branches cost half of one long one. Add it to a model with `rod.set_rod_physics`.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from dlokit.description.dlo import DloPreset
from dlokit.description.table import CONTACT_SOLIMP, CONTACT_SOLREF, LINK_BIT, ROBOT_BIT, ROLLING_M, WORLD_BIT
from dlokit.errors import ConfigError
from dlokit.rod.elastic import check_spacing
from dlokit.types.arrays import Float64Array, Int64Array

_HIDDEN_GROUP = 3
_PREFIX = "chain/"  # prefix of the names of its parts


def add_chain(spec: Any, preset: DloPreset, nodes: int) -> None:
    """Add a straight chain of `nodes` nodes and `nodes` - 1 links to `spec` (MjSpec), its middle link at the origin.

    Its bodies are ``chain/link_0`` and following. Raises ConfigError if the nodes are too close together.
    """
    check_spacing(preset, nodes)
    child = mujoco.MjSpec()
    child.compiler.degree = False
    links = nodes - 1
    root = links // 2
    link_m = preset.length_m / links
    middle = child.worldbody.add_body(name=f"link_{root}")
    middle.add_freejoint(name="root")
    _add_link(middle, preset, links, ends_m=(0.0, link_m), feet_m=(0.0, link_m))
    for indices, outward_m in ((range(root + 1, links), link_m), (range(root - 1, -1, -1), -link_m)):
        body = middle
        for index in indices:
            # The joint of the first link to the left is at the root's origin, all others are at their parent's far end.
            at_m = 0.0 if index == root - 1 else outward_m
            body = body.add_body(name=f"link_{index}", pos=[at_m, 0.0, 0.0])
            _add_joint(body, preset, link_m, index)
            _add_link(body, preset, links, ends_m=(0.0, outward_m), feet_m=(outward_m,))
    spec.attach(child, prefix=_PREFIX, frame=spec.worldbody.add_frame())


def _add_joint(body: Any, preset: DloPreset, link_m: float, index: int) -> None:
    stiffness = preset.bending_stiffness_n_m2 / link_m
    joint = body.add_joint(name=f"bend_{index}", type=mujoco.mjtJoint.mjJNT_BALL)
    joint.stiffness = [stiffness, 0.0, 0.0]
    joint.damping = [preset.damping_s * stiffness, 0.0, 0.0]
    if preset.yield_curvature_1_m is not None:
        joint.springyield = preset.yield_curvature_1_m * link_m


def _add_link(
    body: Any, preset: DloPreset, links: int, *, ends_m: tuple[float, float], feet_m: Sequence[float]
) -> None:
    """Add to a link its capsule between two ends [m], and invisible feet that touch the table."""
    friction = [preset.friction, ROLLING_M, ROLLING_M]
    capsule = body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[ends_m[0], 0.0, 0.0, ends_m[1], 0.0, 0.0])
    capsule.size = [preset.radius_m, 0.0, 0.0]
    capsule.mass = preset.mass_kg / links
    capsule.rgba = [*preset.color_rgb, 1.0]
    capsule.contype, capsule.conaffinity = LINK_BIT, LINK_BIT | ROBOT_BIT
    feet = [
        # A capsule has two contacts with a plane, and two links meet at a node: a load that is distributed ambiguously
        # over many contacts takes long to settle and costs the solver ten times the time. One sphere at each node
        # touches instead.
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=[foot_m, 0.0, 0.0], size=[preset.radius_m, 0.0, 0.0])
        for foot_m in feet_m
    ]
    for foot in feet:
        foot.mass = 0.0
        foot.contype, foot.conaffinity = 0, WORLD_BIT
        foot.group = _HIDDEN_GROUP
    for geom in (capsule, *feet):
        geom.condim, geom.friction = 6, friction
        geom.solref, geom.solimp = CONTACT_SOLREF, CONTACT_SOLIMP


class Chain:
    """A chain in a compiled model: reads its nodes and places it."""

    def __init__(self, model: Any, data: Any, curl_1_m: float) -> None:
        """Find the chain in `model` and set its intrinsic curvature about the vertical [1/m]."""
        self._model, self._data = model, data
        self._links = _bodies(model)  # (L,)
        self._root = len(self._links) // 2
        capsules: Int64Array = np.asarray(model.body_geomadr[self._links], dtype=np.int64)  # (L,)
        self._feet: Int64Array = np.insert(capsules + 1, self._root + 1, capsules[self._root] + 2)  # (L + 1,)
        joints = model.body_jntadr[self._links]
        self._qpos: Int64Array = model.jnt_qposadr[joints]
        self._plastic: Int64Array = model.jnt_plasticadr[joints]
        self._link_m = 2.0 * float(np.linalg.norm(model.geom_pos[capsules[self._root]]))
        turn = Rotation.from_rotvec(np.tile([0.0, 0.0, curl_1_m * self._link_m], (len(self._links) - 1, 1)))
        model.qpos_spring[self._bend_addresses(self._qpos)] = self._of_children(turn)

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (L + 1, 3) [m], in the world frame. Kinematics must be up to date."""
        origins = self._data.xpos[self._links]
        along = self._link_m * self._data.xmat[self._links][:, ::3]  # (L, 3) link vectors, first node to last
        nodes = np.empty((len(origins) + 1, 3))
        # Links before the root have their joint, and so their origin, at the far end.
        nodes[:-1] = origins
        nodes[: self._root] -= along[: self._root]
        nodes[-1] = origins[-1] + along[-1]
        return nodes

    def set_friction(self, friction: ArrayLike) -> None:
        """Set the coefficient of sliding friction on the table at each node, (L + 1,) or one for all."""
        self._model.geom_friction[self._feet, 0] = friction

    def place(self, nodes_world: ArrayLike) -> None:
        """Place the relaxed chain along `nodes_world` (L + 1, 3) [m], at rest and without twist.

        Links keep their length, so nodes away from the middle can deviate from `nodes_world`. Call mj_forward before
        reading derived quantities.
        """
        nodes = np.asarray(nodes_world, dtype=np.float64)
        count = len(self._links) + 1
        if nodes.shape != (count, 3):
            raise ConfigError(f"The chain has {count} nodes; nodes_world must be ({count}, 3), not {nodes.shape}.")
        frames = link_frames(nodes)
        turns = frames[:-1].inv() * frames[1:]  # from each link to the next
        data, root = self._data, self._root
        data.qpos[self._qpos[root] + np.arange(3)] = nodes[root]
        data.qpos[self._qpos[root] + np.arange(3, 7)] = frames[root].as_quat(scalar_first=True)
        data.qpos[self._bend_addresses(self._qpos)] = self._of_children(turns)
        first = self._model.jnt_dofadr[self._model.body_jntadr[self._links]].min()
        data.qvel[first : first + 6 + 3 * (len(self._links) - 1)] = 0.0
        if self._plastic.max() >= 0:
            data.plastic[self._bend_addresses(self._plastic)] = self._model.qpos_spring[
                self._bend_addresses(self._qpos)
            ]
        data.qacc_warmstart[:] = 0.0

    def _bend_addresses(self, starts: Int64Array) -> Int64Array:
        """Addresses (L - 1, 4) of the quaternions of all joints but the root's, in the order of the links."""
        return np.delete(starts, self._root)[:, None] + np.arange(4)

    def _of_children(self, turns: Rotation) -> Float64Array:
        """Joint quaternions (L - 1, 4) of the turns (L - 1) from each link to the next: left of the root the
        next link is the parent."""
        quats = np.concatenate((turns[: self._root].inv().as_quat(scalar_first=True),
                                turns[self._root :].as_quat(scalar_first=True)))  # fmt: skip
        return np.asarray(quats, dtype=np.float64)


def link_frames(nodes_world: Float64Array) -> Rotation:
    """Frames (L) of the links between nodes (L + 1, 3) [m]: x along the link, without twist from link to link.

    The z axis of the first frame points as far up as possible, so on a table all z axes point up.
    """
    along = np.diff(nodes_world, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    up = np.array([0.0, 0.0, 1.0]) if abs(along[0, 2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    y = np.cross(up, along[0])
    y /= np.linalg.norm(y)
    frames = [Rotation.from_matrix(np.column_stack((along[0], y, np.cross(along[0], y))))]
    for before, after in itertools.pairwise(along):
        axis = np.cross(before, after)
        sine = float(np.linalg.norm(axis))
        angle = float(np.arctan2(sine, before @ after))
        frames.append(Rotation.from_rotvec(axis * (angle / sine if sine > 1e-12 else 1.0)) * frames[-1])
    return Rotation.concatenate(frames)


def _bodies(model: Any) -> Int64Array:
    """Body ids of the links of the chain, in order from the first node to the last, (L,)."""
    found: list[int] = []
    while (body := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{_PREFIX}link_{len(found)}")) >= 0:
        found.append(body)
    if not found:
        raise ConfigError("The model has no chain; add one with add_chain first.")
    return np.array(found, dtype=np.int64)
