"""A rod on a table that hands move: the physics behind the bench's own sequences.

The rod is the one of `description.rod`, in a world of its own. A hand holds a node and its neighbours, as the pads of a
gripper do, and carries them without turning them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dlokit.description.dlo import DloPreset
from dlokit.rod.elastic import (
    CONTACT_SOLIMP,
    add_ground,
    add_rod,
    rod_bodies,
    rod_nodes,
    set_rod_nodes,
    set_rod_physics,
)
from dlokit.types.arrays import Float64Array

TIMESTEP_S = 0.001
GRIP_STIFFNESS_N_M = 300.0  # a node weighs 0.3 g: it follows its hand within a time step


@dataclass(frozen=True, kw_only=True)
class MovingHand:
    """One gripper during one phase."""

    node: int
    offset_m: Callable[[float], Float64Array]
    """How far (3,) [m] the hand is from where it took hold, at a time [s] after that; 0 at 0."""


@dataclass(frozen=True, kw_only=True)
class Phase:
    """What happens for a while."""

    duration_s: float
    hands: tuple[MovingHand, ...] = ()


Script = Callable[[Float64Array], Phase]
"""The next phase, given the nodes (K, 3) [m] at the end of the one before."""


@dataclass(frozen=True, kw_only=True)
class Recording:
    """What the stage showed."""

    nodes_world: Float64Array  # (T, K, 3) [m]
    pin_nodes: tuple[int, ...]
    pins_world: Float64Array  # (T, P, 3) [m], NaN while a node is free


class RodStage:
    """The rod, the table and the hands."""

    def __init__(self, rod: DloPreset, start_world: Float64Array) -> None:
        """Put the rod at `start_world` (K, 3) [m]."""
        self._model = _compile(rod, len(start_world))
        self._data: Any = mujoco.MjData(self._model)
        bodies = rod_bodies(self._model)
        self._rest: Float64Array = self._model.body_pos[bodies].copy()  # (K, 3)
        self._joints = self._model.body_jntadr[bodies][:, None] + np.arange(3)  # (K, 3)
        self._qpos = self._model.jnt_qposadr[self._joints]
        set_rod_nodes(self._model, self._data, start_world)

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (K, 3) [m] now."""
        return rod_nodes(self._model, self._data)

    def settle(self, hands: tuple[MovingHand, ...], duration_s: float) -> None:
        """Let the rod come to rest in hands that do not move."""
        grips = [_Grip(hand, self.nodes_world) for hand in hands]
        for _ in range(round(duration_s / TIMESTEP_S)):
            self._step(grips, 0.0)

    def record(self, script: Script, *, frames: int, rate_hz: float, pace: float) -> Recording:
        """Play a script at `pace` times its speed, and record `frames` frames from now on."""
        every = round(1.0 / (rate_hz * TIMESTEP_S))
        nodes = np.empty((frames, len(self._rest), 3))
        held: list[dict[int, Float64Array]] = []
        phase, grips, elapsed_s = self._next(script)
        for tick in range((frames - 1) * every + 1):
            if elapsed_s >= phase.duration_s:
                phase, grips, elapsed_s = self._next(script)
            if tick % every == 0:
                nodes[tick // every] = self.nodes_world
                held.append({grip.node: grip.position(elapsed_s) for grip in grips})
            elapsed_s += TIMESTEP_S * pace
            self._step(grips, elapsed_s)
        pin_nodes = tuple(sorted({node for at in held for node in at}))
        nowhere = np.full(3, np.nan)
        pins = np.array([[at.get(node, nowhere) for node in pin_nodes] for at in held]).reshape(frames, -1, 3)
        return Recording(nodes_world=nodes, pin_nodes=pin_nodes, pins_world=pins)

    def _next(self, script: Script) -> "tuple[Phase, list[_Grip], float]":
        phase = script(self.nodes_world)
        return phase, [_Grip(hand, self.nodes_world) for hand in phase.hands], 0.0

    def _step(self, grips: "list[_Grip]", elapsed_s: float) -> None:
        self._model.jnt_stiffness[self._joints] = 0.0
        for grip in grips:
            self._model.jnt_stiffness[self._joints[grip.nodes]] = GRIP_STIFFNESS_N_M
            self._model.qpos_spring[self._qpos[grip.nodes]] = grip.targets(elapsed_s) - self._rest[grip.nodes]
        mujoco.mj_step(self._model, self._data)


class _Grip:
    def __init__(self, hand: MovingHand, nodes_world: Float64Array) -> None:
        self.node = hand.node
        self.nodes = np.arange(max(hand.node - 1, 0), min(hand.node + 2, len(nodes_world)))
        self._from = nodes_world[self.nodes].copy()
        self._hand = hand

    def targets(self, elapsed_s: float) -> Float64Array:
        return self._from + self._hand.offset_m(elapsed_s)

    def position(self, elapsed_s: float) -> Float64Array:
        return self.targets(elapsed_s)[int(np.flatnonzero(self.nodes == self.node)[0])]


def _compile(rod: DloPreset, count: int) -> Any:
    spec = mujoco.MjSpec()
    set_rod_physics(spec, TIMESTEP_S)
    add_ground(spec, rod.friction)
    add_rod(spec, rod, count)
    model: Any = spec.compile()
    # In the air the whole weight hangs on the edges: softer ones would let the rod stretch by several per cent.
    model.eq_solref[:] = (2.0 * TIMESTEP_S, 1.0)
    model.eq_solimp[:] = CONTACT_SOLIMP
    return model
