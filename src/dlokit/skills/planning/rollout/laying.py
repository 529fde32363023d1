"""Lay-down: lift the rod by one end until most of it hangs, and lay it along the goal curve, the other end first."""

import numpy as np

from dlokit import geometry
from dlokit.skills.planning.rollout.candidates import Candidate, PlanningScene
from dlokit.types.action import Action, LayDown, VelocityProfile
from dlokit.types.arrays import Float64Array

_PIECES = 8  # straight pieces of the path along the goal
_LIFT = (0.1, 0.88)  # fractions of the length: a free-hanging end swings, a dragged end does not
_EXPONENT = (0.5, 2.0)
_SPEED_M_S = (0.15, 0.32)
_USUAL = np.array([0.86, 1.0, 0.02, 0.0, 0.22])
_SPREAD = np.array([0.06, 0.12, 0.015, 0.4, 0.04])
_SHIFT_M = 0.004  # spread of the shifts
_AIM = 0.7  # fraction of an error by which the path is shifted; more overshoots where the rod slides
_INNER_NODES = 4  # nodes next to an end that may be grasped in its place
_PLAIN = len(_USUAL)


class Laying:
    """Parameters: lift (fraction of the length), exponent of the descent, lead of the tool along the goal [m],
    turn beyond the goal's tangent [rad], speed [m/s]; then the shift of each corner of the path beside it (x, y) [m].
    """

    def __init__(self, scene: PlanningScene, *, from_last: bool) -> None:
        """Whether the held end is the last node or the first."""
        self.kind: type[Action] = LayDown
        self._scene, self._from_last = scene, from_last
        nodes = range(scene.count - 1, scene.count - 1 - _INNER_NODES, -1) if from_last else range(_INNER_NODES)
        self._hold = next((hold for hold in map(scene.hold, nodes) if hold is not None), None)

    @property
    def spread(self) -> Float64Array:
        """Spread of the numbers."""
        return np.concatenate((0.5 * _SPREAD, np.full(2 * (_PIECES + 1), _SHIFT_M)))

    def first(self, count: int, rng: np.random.Generator) -> list[Float64Array]:
        """The default lay-down and variations of it, without shifts."""
        if self._hold is None:
            return []
        plain = [_USUAL, *(_USUAL + _SPREAD * rng.standard_normal((count - 1, _PLAIN)))]
        return [np.concatenate((numbers, np.zeros(2 * (_PIECES + 1)))) for numbers in plain]

    def aimed(self, numbers: Float64Array, nodes_world: Float64Array) -> Float64Array:
        """The path shifted against the error of each node, at the tool position at which the node was laid.

        `nodes_world` (M, 3) [m] is the resulting shape.
        """
        error = (self._scene.goal_world - nodes_world)[:, :2]
        error = error if self._from_last else error[::-1]  # the far end is laid first
        fraction, known = np.linspace(0.0, 1.0, _PIECES + 1), np.linspace(0.0, 1.0, len(error))
        shift = np.column_stack([np.interp(fraction, known, error[:, axis]) for axis in range(2)])
        return np.concatenate((numbers[:_PLAIN], numbers[_PLAIN:] + _AIM * shift.ravel()))

    def make(self, numbers: Float64Array) -> Candidate | None:
        """The candidate of these numbers."""
        hold, scene = self._hold, self._scene
        if hold is None:
            return None
        clean = numbers.copy()
        for k, (low, high) in ((0, _LIFT), (1, _EXPONENT), (4, _SPEED_M_S)):
            clean[k] = min(max(numbers[k], low), high)
        lift, exponent, lead, more_turn, speed = (float(number) for number in clean[:_PLAIN])
        first, turn = scene.start(hold, more_turn)
        lift_m = lift * scene.length_m
        fraction = np.linspace(0.0, 1.0, _PIECES + 1)
        tool = np.empty((_PIECES + 3, 4))
        tool[0] = first
        tool[1] = first + np.array([0.0, 0.0, lift_m, 0.0])
        tool[2:, :2] = self._along_goal(fraction, lead) + clean[_PLAIN:].reshape(-1, 2)
        tool[2:, 2] = first[2] + lift_m * (1.0 - fraction) ** exponent
        tool[2:, 3] = first[3] + turn * fraction
        # Low acceleration, so that the joints can follow and a hanging rod does not swing: the rollout has no joints.
        velocity = VelocityProfile(speed_m_s=speed, acceleration_m_s2=0.6, jerk_m_s3=6.0)
        return scene.candidate(self.kind, clean, hold, tool, velocity)

    def _along_goal(self, fraction: Float64Array, lead_m: float) -> Float64Array:
        """Positions of the tool (K, 2) [m]: the goal curve from its far end, with the lead."""
        assert self._hold is not None
        scene = self._scene
        goal = scene.goal_world[:, :2] if self._from_last else scene.goal_world[::-1, :2]
        held_at = abs(self._hold.node - (0 if self._from_last else scene.count - 1)) / (scene.count - 1)
        lead = lead_m / scene.length_m
        at = np.clip(held_at * fraction + lead * (np.sin(np.pi * fraction) + 1.0 - fraction), -0.2, 1.2)
        inside, known = np.clip(at, 0.0, 1.0), np.linspace(0.0, 1.0, scene.count)
        tangents = geometry.tangents(goal)
        place = np.column_stack([np.interp(inside, known, goal[:, axis]) for axis in range(2)])
        along = np.column_stack([np.interp(inside, known, tangents[:, axis]) for axis in range(2)])
        return place + ((at - inside) * scene.length_m)[:, None] * along
