"""The cell's kind of rod on a table, among posts, without arm and fingers: springs hold its nodes between the pads."""

import itertools
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from dlokit import geometry
from dlokit.description.dlo import DloPreset
from dlokit.description.scene import Post
from dlokit.description.table import CONTACT_SOLIMP, CONTACT_SOLREF, ROLLING_M
from dlokit.functional.cell.world import NODES, TABLE_FRICTION, TIMESTEP_S
from dlokit.rod.elastic import RodBody, add_ground, add_rod, rod_bodies, set_rod_physics
from dlokit.types.arrays import Float64Array

TICK_S = 0.01
"""Time between two poses of a tool [s]."""
_PADS_M = 0.016  # nodes nearer than this to the tool, along it, are held
_SPRING_N_M, _TWIST_N_M_RAD = 400.0, 1.0


class HeldRod:
    """A rod that follows a tool and is released."""

    def __init__(self, dlo: DloPreset, posts: Sequence[Post] = ()) -> None:
        spec: Any = mujoco.MjSpec()
        set_rod_physics(spec, TIMESTEP_S)
        add_ground(spec, TABLE_FRICTION)
        for post in posts:
            _add_post(spec, post)
        add_rod(spec, dlo, NODES, hangs=True)
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        self._rod = RodBody(self._model, self._data)
        bodies = rod_bodies(self._model)
        self._rest: Float64Array = self._model.body_pos[bodies].copy()
        self._slides = self._model.body_jntadr[bodies][:, None] + np.arange(3)  # (Mc, 3)
        self._posts = np.array([self._model.geom(post.name).id for post in posts], dtype=np.int64)
        self.touched_post = False
        """Whether the rod touched a post during the last motion."""

    def after(self, nodes_world: Float64Array, tool: Float64Array, free_s: float) -> Float64Array:
        """Nodes (Mc, 3) [m] after a tool (T, 4) has moved a rod at `nodes_world` (Mc, 3) [m] and released it.

        `tool`: x, y, z [m], yaw [rad] every `TICK_S`; it holds the rod from the first to the last. The rod is free for
        `free_s` [s] after that.
        """
        model, data = self._model, self._data
        mujoco.mj_resetData(model, data)
        self._rod.place(nodes_world)
        self.touched_post = False
        model.jnt_stiffness[:] = 0.0
        in_tool = (nodes_world - tool[0, :3]) @ _turned(tool[0, 3])  # (Mc, 3)
        held = np.flatnonzero((abs(in_tool[:, 0]) < _PADS_M) & (abs(in_tool[:, 1]) < _PADS_M))
        model.jnt_stiffness[self._slides[held]] = _SPRING_N_M
        for edge in held[:-1]:
            # Pads keep the rod from turning about its axis.
            name = "rod/flex_twist" if edge == NODES - 2 else f"rod/flex_twist_{edge}"
            model.jnt_stiffness[model.joint(name).id] = _TWIST_N_M_RAD
        springs, steps = model.jnt_qposadr[self._slides[held]], round(TICK_S / TIMESTEP_S)
        for start, end in itertools.pairwise(tool):
            for share in np.arange(1, steps + 1) / steps:
                now = (1.0 - share) * start + share * end
                model.qpos_spring[springs] = now[:3] + in_tool[held] @ _turned(now[3]).T - self._rest[held]
                mujoco.mj_step(model, data)
            self._note_contacts()
        model.jnt_stiffness[:] = 0.0
        mujoco.mj_step(model, data, round(free_s / TIMESTEP_S))
        self._note_contacts()
        return self._rod.nodes_world

    def _note_contacts(self) -> None:
        if not self.touched_post:
            self.touched_post = bool(np.isin(np.asarray(self._data.contact.geom), self._posts).any())


def _add_post(spec: Any, post: Post) -> None:
    spec.worldbody.add_geom(
        name=post.name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[post.diameter_m / 2.0, post.height_m / 2.0, 0.0],
        pos=geometry.transform(post.T_world_foot, [[0.0, 0.0, post.height_m / 2.0]])[0],
        quat=post.T_world_foot.wxyz,
        priority=1,  # its friction counts, even where the rod's is larger
        condim=6,
        friction=[post.friction, ROLLING_M, ROLLING_M],
        solref=list(CONTACT_SOLREF),
        solimp=list(CONTACT_SOLIMP),
    )


def _turned(yaw_rad: float) -> Float64Array:
    """The rotation (3, 3) about the vertical."""
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
