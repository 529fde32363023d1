"""Lay-down: lift the rod by one end until most of it hangs, and lay it along the goal curve, the other end first."""

import numpy as np

from dlokit import geometry
from dlokit.skills.planning.rollouts.candidates import Candidate, Scene
from dlokit.types.action import Action, LayDown, VelocityProfile
from dlokit.types.arrays import Float64Array

_PIECES = 8  # straight pieces of the path along the goal
_LIFT_M = (0.05, 0.5)
_SPEED_M_S = (0.15, 0.32)
_USUAL = np.array([0.35, 0.0, 0.0, 1.0, 0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25])
_SPREAD = np.array([0.12, 0.03, 0.03, 0.25, 0.03, 0.02, 0.02, 0.4, 0.02, 0.02, 0.05])
_INNER_NODES = 4  # where the end cannot be grasped, one of the next may be


class Laying:
    """Numbers: lift [m], where the laying starts (x, y) from the far end of the goal [m], how the height falls
    (exponent), lead of the tool along the goal [m], release (x, y) from the near end [m], turn beyond the goal's
    tangent [rad], bow of the path in one and in two waves [m], speed [m/s].
    """

    def __init__(self, scene: Scene, *, from_last: bool) -> None:
        """The end that is held is the last node or the first."""
        self.kind: type[Action] = LayDown
        self._scene, self._from_last = scene, from_last
        nodes = range(scene.count - 1, scene.count - 1 - _INNER_NODES, -1) if from_last else range(_INNER_NODES)
        self._hold = next((hold for hold in map(scene.hold, nodes) if hold is not None), None)

    @property
    def spread(self) -> Float64Array:
        """Spread of the numbers."""
        return 0.5 * _SPREAD

    def first(self, count: int, rng: np.random.Generator) -> list[Float64Array]:
        """The usual lay-down, and others around it."""
        if self._hold is None:
            return []
        return [_USUAL, *(_USUAL + _SPREAD * rng.standard_normal((count - 1, len(_USUAL))))]

    def make(self, numbers: Float64Array) -> Candidate | None:
        """The candidate of these numbers."""
        hold, scene = self._hold, self._scene
        if hold is None:
            return None
        clean = numbers.copy()
        clean[0], clean[3] = min(max(numbers[0], _LIFT_M[0]), _LIFT_M[1]), min(max(numbers[3], 0.5), 2.0)
        first, turn = scene.start(hold, float(clean[7]))
        share = np.linspace(0.0, 1.0, _PIECES + 1)
        tool = np.empty((_PIECES + 3, 4))
        tool[0] = first
        tool[1] = first + np.array([0.0, 0.0, clean[0], 0.0])
        tool[2:, :2] = self._along_goal(share, clean)
        tool[2:, 2] = first[2] + clean[0] * (1.0 - share) ** clean[3]
        tool[2:, 3] = first[3] + turn * share
        # Gently, so that the joints can follow and a hanging rod does not swing: the rollout knows of no joints.
        speed = min(max(float(clean[10]), _SPEED_M_S[0]), _SPEED_M_S[1])
        velocity = VelocityProfile(speed_m_s=speed, acceleration_m_s2=0.6, jerk_m_s3=6.0)
        return scene.candidate(self.kind, clean, hold, tool, velocity)

    def _along_goal(self, share: Float64Array, numbers: Float64Array) -> Float64Array:
        """Places of the tool (K, 2) [m]: the goal curve, led, bowed and shifted."""
        assert self._hold is not None
        scene = self._scene
        goal = scene.goal_world[:, :2] if self._from_last else scene.goal_world[::-1, :2]
        held_at = abs(self._hold.node - (0 if self._from_last else scene.count - 1)) / (scene.count - 1)
        lead = float(numbers[4]) / scene.length_m
        at = np.clip(held_at * share + lead * (np.sin(np.pi * share) + 1.0 - share), -0.2, 1.2)
        inside, known = np.clip(at, 0.0, 1.0), np.linspace(0.0, 1.0, scene.count)
        tangents = geometry.tangents(goal)
        place = np.column_stack([np.interp(inside, known, goal[:, axis]) for axis in range(2)])
        along = np.column_stack([np.interp(inside, known, tangents[:, axis]) for axis in range(2)])
        across = np.column_stack((-along[:, 1], along[:, 0]))
        bow = numbers[8] * np.sin(np.pi * share) + numbers[9] * np.sin(2.0 * np.pi * share)
        place += ((at - inside) * scene.length_m)[:, None] * along + bow[:, None] * across
        return place + np.outer(1.0 - share, numbers[1:3]) + np.outer(share**2, numbers[5:7])
