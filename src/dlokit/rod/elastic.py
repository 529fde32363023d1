"""A DLO in MuJoCo: a 1D flex, which is a discrete elastic rod (Bergou et al., SIGGRAPH 2008).

Every node is a body with three slide joints, every edge has a hinge for twist. Bending and torsion are
elastic; edge equalities keep the length. The model it is added to must use the ``discrete`` integrator.
"""

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlokit.description.dlo import DloPreset
from dlokit.description.table import CONTACT_SOLIMP, CONTACT_SOLREF, ROLLING_M
from dlokit.errors import ConfigError
from dlokit.types.arrays import Float64Array, Int64Array

IMPRATIO = 100.0
"""Ratio of frictional to normal impedance; with elliptic cones, it keeps a bent rod from creeping."""


def set_rod_physics(spec: Any, timestep_s: float) -> None:
    """Set the options of `spec` (MjSpec) that keep a rod stable and prevent creep under friction."""
    spec.option.timestep = timestep_s
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = IMPRATIO


def add_rod(spec: Any, preset: DloPreset, nodes: int, *, hangs: bool = False) -> None:
    """Add a straight rod of `nodes` nodes, centred at the origin along x, to `spec` (MjSpec).

    If the rod `hangs`, its edges are as hard as contacts: a rope of 17 g that hangs from one end lengthens by 0.26 %,
    and by 2.3 % with MuJoCo's usual impedance. Other rods keep that impedance, because it amplifies rounding less.

    Its flex is called ``rod/flex``, its bodies ``rod/flex_0`` and following. Raises ConfigError if the nodes are too
    close together for their radius.
    """
    check_spacing(preset, nodes)
    child = mujoco.MjSpec.from_string(_mjcf(preset, nodes, _HANGING if hangs else ""))
    spec.attach(child, prefix="rod/", frame=spec.worldbody.add_frame())


def check_spacing(preset: DloPreset, nodes: int) -> None:
    """Raise ConfigError if `nodes` nodes are too close together for their radius."""
    spacing_m = preset.length_m / (nodes - 1) if nodes > 1 else 0.0
    if nodes < 3 or spacing_m < 2.2 * preset.radius_m:
        most = int(preset.length_m / (2.2 * preset.radius_m)) + 1
        raise ConfigError(
            f"A rod of {preset.length_m} m and radius {preset.radius_m} m cannot have {nodes} nodes; "
            f"3 to {most} are allowed, or its neighbours touch. Choose fewer nodes or a thinner rod."
        )


def rod_bodies(model: Any) -> Int64Array:
    """Body ids of the nodes of the rod, in order, (M,)."""
    flex = _flex(model)
    if flex < 0:
        raise ConfigError("The model has no rod; add one with add_rod first.")
    start, count = model.flex_vertadr[flex], model.flex_vertnum[flex]
    return np.array(model.flex_vertbodyid[start : start + count], dtype=np.int64)


def rod_nodes(model: Any, data: Any) -> Float64Array:
    """Current nodes of the rod (M, 3) [m], in the world frame."""
    bodies = rod_bodies(model)
    return np.asarray(data.qpos[_slide_addresses(model, bodies)] + model.body_pos[bodies], dtype=np.float64)


def set_rod_friction(model: Any, friction: float) -> None:
    """Set the coefficient of sliding friction of the whole rod."""
    model.flex_friction[_flex(model), 0] = friction


def set_rod_nodes(model: Any, data: Any, nodes_world: ArrayLike) -> None:
    """Put the nodes of the rod at `nodes_world` (M, 3) [m], at rest and without twist.

    Call mj_forward afterwards if derived quantities are read before the next step.
    """
    bodies = rod_bodies(model)
    nodes = np.asarray(nodes_world, dtype=np.float64)
    if nodes.shape != (len(bodies), 3):
        raise ConfigError(
            f"The rod has {len(bodies)} nodes; nodes_world must be ({len(bodies)}, 3), not {nodes.shape}."
        )
    data.qpos[_slide_addresses(model, bodies)] = nodes - model.body_pos[bodies]
    dofs = model.jnt_dofadr[model.body_jntadr[bodies]]
    data.qvel[dofs[:, None] + np.arange(3)] = 0.0
    for edge in range(len(bodies) - 1):
        joint = _twist_joint(model, edge, len(bodies) - 1)
        data.qpos[model.jnt_qposadr[joint]] = 0.0
        data.qvel[model.jnt_dofadr[joint]] = 0.0
    # Zero frames make the engine compute them from the current tangents, free of twist.
    data.plastic[:] = 0.0
    data.qacc_warmstart[:] = 0.0


def _slide_addresses(model: Any, bodies: Int64Array) -> NDArray[np.int64]:
    """Addresses in qpos of the three slides of each body, (M, 3)."""
    return np.asarray(model.jnt_qposadr[model.body_jntadr[bodies]][:, None] + np.arange(3), dtype=np.int64)


def _flex(model: Any) -> int:
    """Id of the rod's flex; negative if there is none."""
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_FLEX, "rod/flex"))


def _twist_joint(model: Any, edge: int, edges: int) -> int:
    joint = "rod/flex_twist" if edge == edges - 1 else f"rod/flex_twist_{edge}"
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint))


_HANGING = 'solimp="{} {} {}"'.format(*CONTACT_SOLIMP[:3])


def _mjcf(preset: DloPreset, nodes: int, edges: str) -> str:
    return f"""
<mujoco>
  <worldbody>
    <flexcomp name="flex" dim="1" {_vertices(preset, nodes)}
              radius="{preset.radius_m:.9g}" mass="{preset.mass_kg:.9g}" rgba="{_numbers(preset.color_rgb)} 1">
      <edge equality="true" solref="{_numbers(CONTACT_SOLREF)}" {edges}/>
      <elasticity young="{preset.young_pa:.9g}" poisson="{preset.poisson:.9g}" damping="{preset.damping_s:.9g}"/>
      <contact condim="6" friction="{preset.friction:.9g} {ROLLING_M:.9g} {ROLLING_M:.9g}"
               solref="{_numbers(CONTACT_SOLREF)}" solimp="{_numbers(CONTACT_SOLIMP)}"
               selfcollide="auto" contype="1" conaffinity="1"/>
    </flexcomp>
  </worldbody>
</mujoco>"""


def _vertices(preset: DloPreset, nodes: int) -> str:
    """The rod's unloaded shape: straight along x, or curved, in the xy plane."""
    if preset.curl_1_m == 0.0:
        return f'type="grid" count="{nodes} 1 1" spacing="{preset.length_m / (nodes - 1):.12g} 1 1"'
    turns = preset.curl_1_m * np.linspace(-preset.length_m / 2.0, preset.length_m / 2.0, nodes)
    points = np.column_stack((np.sin(turns), 1.0 - np.cos(turns), np.zeros(nodes))) / preset.curl_1_m
    # The chord between neighbouring nodes on the arc equals the rod's node distance.
    chord_m = np.linalg.norm(points[1] - points[0])
    points *= preset.length_m / (nodes - 1) / chord_m
    edges = " ".join(f"{i} {i + 1}" for i in range(nodes - 1))
    return f'type="direct" point="{_numbers(points.ravel())}" element="{edges}"'


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def add_ground(spec: mujoco.MjSpec, friction: float) -> None:
    """Add an infinite ground plane at z = 0 on which a rod does not creep; `friction` is the sliding coefficient."""
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[3.0, 3.0, 0.1],
        condim=3,
        friction=[friction, 0.001, 0.0001],
        solref=list(CONTACT_SOLREF),
        solimp=list(CONTACT_SOLIMP),
    )


class RodBody:
    """The flex `rod` in a compiled model, behind the interface of the cell's DLO."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m]."""
        return rod_nodes(self._model, self._data)

    def place(self, nodes_world: ArrayLike) -> None:
        """Place the rod along `nodes_world` (M, 3) [m], at rest."""
        set_rod_nodes(self._model, self._data, nodes_world)

    def set_friction(self, friction: ArrayLike) -> None:
        """Set the friction on the table to the mean of the nodes' coefficients, (M,)."""
        # A flex has one coefficient, so it gets the mean over its nodes.
        set_rod_friction(self._model, float(np.asarray(friction, dtype=np.float64).mean()))
