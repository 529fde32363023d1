"""The tracking rod: the DLO as a discrete elastic rod without weight, in MuJoCo. It touches at most posts.

Bending and twist follow Bergou et al., Discrete Elastic Rods, SIGGRAPH 2008 (MuJoCo's 1D flex); a constraint
holds the length of every edge. Forces of the form ``F = Kp (target - x) - Kd v`` are joint springs, which the
integrator treats implicitly: any gain is stable at any time step.
"""

from typing import Any

import mujoco
import numpy as np

from dlokit.description.dlo import DloPreset
from dlokit.description.scene import NO_POSTS
from dlokit.description.table import CONTACT_SOLIMP
from dlokit.rod.believed import DAMPING_S, POISSON, BelievedDlo, topology
from dlokit.rod.elastic import add_rod, rod_bodies, set_rod_physics
from dlokit.types.arrays import Float64Array, Int64Array

_GRAVITY = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
_SUNK_M = 0.02  # a post goes on below the table, so that no rod touches its lower end


class RodModel:
    """One weightless rod: M nodes, with a spring from each to a target."""

    def __init__(
        self,
        config: BelievedDlo,
        *,
        timestep_s: float,
        damping_n_s_m: float = 0.0,
        posts: Float64Array = NO_POSTS,
    ) -> None:
        """Build the rod straight along x.

        `damping_n_s_m` acts on every node's velocity against the world. `posts` (P, 8), from `Scene.posts_world`, push
        the rod out without friction. Raises `ConfigError` on a rod that cannot be built, e.g. one whose radius is too
        large for its number of nodes.
        """
        self.config = config
        self.topology = topology(config)
        self._model: Any = _compile(config, timestep_s, posts)
        self._data: Any = mujoco.MjData(self._model)
        bodies = rod_bodies(self._model)
        self._rest: Float64Array = self._model.body_pos[bodies].copy()  # (M, 3)
        joints: Int64Array = np.add.outer(self._model.body_jntadr[bodies], np.arange(3)).astype(np.int64)  # (M, 3)
        self._joints = joints
        self._qpos = self._model.jnt_qposadr[joints]
        self._dofs = self._model.jnt_dofadr[joints]
        self._model.dof_damping[self._dofs] = damping_n_s_m

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m], world frame."""
        return self._rest + self._data.qpos[self._qpos]

    @property
    def speed_m_s(self) -> float:
        """Largest speed of a node [m/s]."""
        return float(np.abs(self._data.qvel[self._dofs]).max())

    def place(self, nodes_world: Float64Array) -> None:
        """Set the nodes (M, 3) [m] at rest, without twist, and remove all target forces."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[self._qpos] = nodes_world - self._rest
        self.let_go()

    def pull(self, targets_world: Float64Array, stiffness_n_m: Float64Array) -> None:
        """Pull each node to its target (M, 3) [m] with gains Kp (M, 3) along the axes [N/m]; 0 leaves it free."""
        self._model.qpos_spring[self._qpos] = targets_world - self._rest
        self._model.jnt_stiffness[self._joints] = stiffness_n_m

    def let_go(self) -> None:
        """Remove all target forces."""
        self._model.jnt_stiffness[self._joints] = 0.0

    def step(self, count: int) -> None:
        """Advance the physics by `count` steps."""
        mujoco.mj_step(self._model, self._data, count)


def _compile(config: BelievedDlo, timestep_s: float, posts: Float64Array) -> Any:
    spec = mujoco.MjSpec()
    set_rod_physics(spec, timestep_s)
    spec.option.disableflags = _GRAVITY if len(posts) else _GRAVITY | _CONTACT
    rope = DloPreset(
        name="model",
        length_m=config.length_m,
        radius_m=config.radius_m,
        mass_per_length_kg_m=config.mass_kg_m,
        bending_stiffness_n_m2=config.bending_stiffness_n_m2,
        poisson=POISSON,
        damping_s=DAMPING_S,
        friction=config.friction,
    )
    add_rod(spec, rope, config.nodes)
    if len(posts):
        spec.flex("rod/flex").selfcollide = mujoco.mjtFlexSelf.mjFLEXSELF_NONE
    for post in posts:
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*post[:2], post[2] - _SUNK_M, *post[3:6]],
            size=[post[6], 0.0, 0.0],
            priority=1,  # without friction, though the rod has some
            condim=1,
            solimp=CONTACT_SOLIMP,
        )
    return spec.compile()
