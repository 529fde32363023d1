"""The bench's own sequences: motions of a MuJoCo rod, seen by the paper's camera; the same for the same seed."""

from typing import Literal

import numpy as np

from dlokit.bench.observers import motions
from dlokit.bench.observers.sequence import Sequence
from dlokit.bench.observers.stage import MovingHand, RodStage
from dlokit.description import shapes
from dlokit.description.dlo import SOFT_ROPE
from dlokit.description.scene import default_calibration
from dlokit.errors import ConfigError
from dlokit.types.arrays import Float64Array

Motion = Literal["two hands", "pick and place", "swing", "crossing"]

NODES = 50
RATE_HZ = 25.0
SPEED_M_S = 0.5
"""Full speed of a hand."""
SWING_M_S = 1.0
"""Speed of the fastest node of the swing, within a tenth."""
_SWING_HAND_M_S = 0.34
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
            script = motions.two_hands(rng, now, SPEED_M_S)
        case "swing":
            script = motions.swing(rng, now, _SWING_HAND_M_S)
        case "pick and place":
            script = motions.pick_and_place(rng, SPEED_M_S)
        case "crossing":
            script = motions.crossing(rng, SPEED_M_S)
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
            return motions.hanging(SOFT_ROPE.length_m, NODES, span_m=0.30)
        case "swing":
            return motions.hanging(SOFT_ROPE.length_m, NODES, span_m=0.46)
        case "pick and place":
            return shapes.random_shape(rng, SOFT_ROPE.length_m, NODES, radius_m=SOFT_ROPE.radius_m)
        case "crossing":
            return motions.loop(rng, SOFT_ROPE.length_m, NODES, SOFT_ROPE.radius_m)
