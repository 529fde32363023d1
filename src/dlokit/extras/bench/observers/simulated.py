"""The bench's own sequences: a rod that hands move on a table, seen by the paper's camera.

The rod is the one of `description.rod`, in a separate MuJoCo world. A hand holds a node and its neighbours, as the
pads of a gripper do, and carries them without a turn. The motions of the hands are drawn from a seed; a speed is the
speed of the fastest hand. Scripts are for full speed; `RodStage.record` can slow them down.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

from dlokit.description import shapes
from dlokit.description.default_cameras import default_calibration
from dlokit.description.dlo import SOFT_ROPE, DloPreset
from dlokit.description.shapes import RANDOM_X_M, RANDOM_Y_M
from dlokit.errors import ConfigError
from dlokit.extras.bench.observers.sequence import Sequence
from dlokit.geometry import arc_lengths, resample
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
    """Displacement (3,) [m] of the hand from its grasp, at a time [s] after it; 0 at 0."""


@dataclass(frozen=True, kw_only=True)
class Phase:
    """Motions of the hands during a time."""

    duration_s: float
    hands: tuple[MovingHand, ...] = ()


Script = Callable[[Float64Array], Phase]
"""The next phase, given the nodes (K, 3) [m] at the end of the previous one."""


@dataclass(frozen=True, kw_only=True)
class SimulatedMotion:
    """The recorded nodes and grips of the stage."""

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

    def record(self, script: Script, *, frames: int, rate_hz: float, pace: float) -> SimulatedMotion:
        """Run a script at `pace` times its speed, and record `frames` frames from now on."""
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
        return SimulatedMotion(nodes_world=nodes, pin_nodes=pin_nodes, pins_world=pins)

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


LIFT_M = 0.05
"""Height to which a rod's node is lifted for a carry [m]."""
LONGEST_CARRY_M = 0.20
SWING_RAD_S = 5.0
"""Rate of a swing [rad/s]: well below that of the hanging rod itself, or it would loop."""
_LOOP_CENTRE_M = (0.52, 0.03)
_REST_S = 0.2
_SECONDS = np.linspace(0.0, 4.0, 1601)  # where speeds are measured: a full sequence
_ATTEMPTS = 1000
_LOW = np.array([0.36, -0.22, 0.22])  # hands in the air stay in this box: the camera sees the whole rod
_HIGH = np.array([0.68, 0.26, 0.40])


def hanging(length_m: float, count: int, span_m: float) -> Float64Array:
    """A rod hanging from two hands in the air `span_m` apart, as a parabola of its length, (count, 3) [m]."""
    ends = np.array([[0.52, 0.06 - span_m / 2.0, 0.32], [0.52, 0.06 + span_m / 2.0, 0.32]])
    t = np.linspace(0.0, 1.0, 401)
    chord = ends[0] + t[:, None] * (ends[1] - ends[0])

    def sagging(sag_m: float) -> Float64Array:
        return chord - 4.0 * sag_m * (t * (1.0 - t))[:, None] * np.array([0.0, 0.0, 1.0])

    low_m, high_m = 0.0, length_m
    for _ in range(60):
        sag_m = (low_m + high_m) / 2.0
        low_m, high_m = (sag_m, high_m) if arc_lengths(sagging(sag_m))[-1] < length_m else (low_m, sag_m)
    return resample(sagging(high_m), count)


def loop(rng: np.random.Generator, length_m: float, count: int, radius_m: float) -> Float64Array:
    """A rod on the table as an open loop of 260°, turned at random, (count, 3) [m]."""
    angle = np.linspace(0.0, np.deg2rad(260.0), 401) + rng.uniform(-np.pi, np.pi)
    size_m = length_m / np.deg2rad(260.0)
    circle = size_m * np.column_stack([np.cos(angle), np.sin(angle)])
    return resample(np.column_stack([circle + _LOOP_CENTRE_M, np.full(len(angle), radius_m)]), count)


def two_hands(rng: np.random.Generator, nodes: Float64Array, speed_m_s: float) -> Script:
    """Both ends are moved through the air along independent smooth random paths."""
    span = nodes[-1] - nodes[0]
    for _ in range(_ATTEMPTS):
        paths = [_wander(rng), _wander(rng)]
        moved = [path(_SECONDS) for path in paths]
        factor = speed_m_s / max(_fastest(track) for track in moved)
        a, b = (node + factor * track for node, track in zip(nodes[[0, -1]], moved, strict=True))
        apart = np.linalg.norm(b - a, axis=1)
        in_view = all(bool(np.all((track >= _LOW) & (track <= _HIGH))) for track in (a, b))
        if in_view and apart.min() > 0.3 * np.linalg.norm(span) and apart.max() < 1.45 * np.linalg.norm(span):
            hands = tuple(
                MovingHand(node=node, offset_m=_scaled(path, factor))
                for node, path in zip((0, len(nodes) - 1), paths, strict=True)
            )
            return lambda nodes_world: Phase(duration_s=np.inf, hands=hands)
    raise ConfigError(f"No path of two hands at {speed_m_s} m/s stays in view of the camera; choose a lower speed.")


def swing(rng: np.random.Generator, nodes: Float64Array, speed_m_s: float) -> Script:
    """Both ends are swung together to and fro, across the view of the camera; the rod between them lags behind."""
    angle = rng.uniform(-0.5, 0.5) + rng.choice([0.0, np.pi])
    direction = np.array([np.cos(angle), np.sin(angle), 0.0])

    def path(t: Float64Array) -> Float64Array:
        return _ease(t)[..., None] * np.sin(SWING_RAD_S * t)[..., None] * direction

    offset = _scaled(path, speed_m_s / _fastest(path(_SECONDS)))
    hands = tuple(MovingHand(node=node, offset_m=offset) for node in (0, len(nodes) - 1))
    return lambda nodes_world: Phase(duration_s=np.inf, hands=hands)


def pick_and_place(rng: np.random.Generator, speed_m_s: float) -> Script:
    """Random nodes of a rod on the table are picked, carried to random places, and released, one after another."""
    held = False

    def script(nodes_world: Float64Array) -> Phase:
        nonlocal held
        held = not held
        if not held:
            return Phase(duration_s=_REST_S)
        node = int(rng.integers(len(nodes_world)))
        goal = np.array([rng.uniform(*RANDOM_X_M), rng.uniform(*RANDOM_Y_M)])
        return _carry(node, goal - nodes_world[node, :2], speed_m_s)

    return script


def crossing(rng: np.random.Generator, speed_m_s: float) -> Script:
    """One end of a loop is carried over the rod near its other end and laid down on the other side, to and fro."""
    over = rng.uniform(0.78, 0.88)
    number = 0

    def script(nodes_world: Float64Array) -> Phase:
        nonlocal number
        number += 1
        if number % 2 == 0:
            return Phase(duration_s=_REST_S)
        middle = round(over * (len(nodes_world) - 1))
        along = nodes_world[middle + 1, :2] - nodes_world[middle - 1, :2]
        across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        carried = nodes_world[middle, :2] - nodes_world[0, :2]
        past_it = across * np.copysign(0.06, carried @ across)
        return _carry(0, carried + past_it, speed_m_s, longest_m=np.inf)

    return script


def _carry(node: int, carry_m: Float64Array, speed_m_s: float, longest_m: float = LONGEST_CARRY_M) -> Phase:
    """Lift, carry by `carry_m` (2,) [m], lower; each with a speed that rises and falls smoothly to `speed_m_s`."""
    far_m = float(np.linalg.norm(carry_m))
    carried = carry_m * min(1.0, longest_m / max(far_m, 1e-9))
    x, y = carried
    corners = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, LIFT_M], [x, y, LIFT_M], [x, y, 0.0]])
    # The smoothest profile from rest to rest has a top speed of 15/8 of its mean.
    times = np.linalg.norm(np.diff(corners, axis=0), axis=1) * 1.875 / speed_m_s
    begins = np.concatenate(([0.0], np.cumsum(times)))

    def offset_m(t: float) -> Float64Array:
        leg = min(int(np.searchsorted(begins, t, side="right")) - 1, len(times) - 1)
        part = min((t - begins[leg]) / max(times[leg], 1e-9), 1.0)
        return corners[leg] + (corners[leg + 1] - corners[leg]) * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)

    return Phase(duration_s=float(begins[-1]), hands=(MovingHand(node=node, offset_m=offset_m),))


def _wander(rng: np.random.Generator) -> Callable[[Float64Array], Float64Array]:
    """A smooth random path (…, 3) over time (…) [s], from 0 and from rest, of any size."""
    rates = 2.0 * np.pi * rng.uniform(0.3, 0.9, size=(2, 3))  # [rad/s]
    sizes = rng.normal(size=(2, 3)) / rates * np.array([1.0, 1.0, 0.5])
    phases = rng.uniform(-np.pi, np.pi, size=(2, 3))

    def path(t: Float64Array) -> Float64Array:
        waves = sizes * (np.sin(rates * t[..., None, None] + phases) - np.sin(phases))
        return _ease(t)[..., None] * waves.sum(axis=-2)

    return path


def _ease(t: Float64Array) -> Float64Array:
    """0 to 1 within half a second, without a jump of the acceleration at the start."""
    part = np.clip(t / 0.5, 0.0, 1.0)
    return part**3 * (10.0 - 15.0 * part + 6.0 * part**2)


def _fastest(track: Float64Array) -> float:
    """Top speed along a track (len(_SECONDS), 3)."""
    return float(np.linalg.norm(np.diff(track, axis=0), axis=1).max() / (_SECONDS[1] - _SECONDS[0]))


def _scaled(path: Callable[[Float64Array], Float64Array], factor: float) -> Callable[[float], Float64Array]:
    return lambda t: factor * path(np.asarray(t, dtype=np.float64))


Motion = Literal["two hands", "pick and place", "swing", "crossing"]

NODES = 50
RATE_HZ = 25.0
SPEED_M_S = 0.5
"""Full speed of a hand."""
_SWING_HAND_M_S = 0.34  # the fastest node then reaches about 1 m/s
_NUMBER: dict[Motion, int] = {"two hands": 0, "pick and place": 1, "swing": 2, "crossing": 3}
_SETTLE_S = 1.0


def simulate(motion: Motion, seed: int, *, frames: int, pace: float = 1.0) -> Sequence:
    """A motion of the default rope, `frames` long at `RATE_HZ`, at `pace` times its full speed."""
    if frames < 2 or seed < 0 or not 0.0 < pace <= 1.0:
        raise ConfigError(f"frames {frames}, seed {seed}, pace {pace}: at least 2, at least 0, above 0 and at most 1.")
    rng = np.random.default_rng([seed, _NUMBER[motion]])
    start = _start(motion, rng)
    stage = RodStage(SOFT_ROPE, start)
    in_air = motion in ("two hands", "swing")
    ends = tuple(MovingHand(node=node, offset_m=lambda _: np.zeros(3)) for node in (0, NODES - 1))
    stage.settle(ends if in_air else (), _SETTLE_S)
    now = stage.nodes_world
    match motion:
        case "two hands":
            script = two_hands(rng, now, SPEED_M_S)
        case "swing":
            script = swing(rng, now, _SWING_HAND_M_S)
        case "pick and place":
            script = pick_and_place(rng, SPEED_M_S)
        case "crossing":
            script = crossing(rng, SPEED_M_S)
    recording = stage.record(script, frames=frames, rate_hz=RATE_HZ, pace=pace)
    return Sequence(
        name=f"{motion} {seed}",
        rate_hz=RATE_HZ,
        nodes_world=recording.nodes_world,
        radius_m=SOFT_ROPE.radius_m,
        pin_nodes=recording.pin_nodes,
        pins_world=recording.pins_world,
        T_world_camera=default_calibration().T_world_camera,
    )


def _start(motion: Motion, rng: np.random.Generator) -> Float64Array:
    match motion:
        case "two hands":
            return hanging(SOFT_ROPE.length_m, NODES, span_m=0.30)
        case "swing":
            return hanging(SOFT_ROPE.length_m, NODES, span_m=0.46)
        case "pick and place":
            return shapes.random_shape(rng, SOFT_ROPE.length_m, NODES, radius_m=SOFT_ROPE.radius_m)
        case "crossing":
            return loop(rng, SOFT_ROPE.length_m, NODES, SOFT_ROPE.radius_m)
