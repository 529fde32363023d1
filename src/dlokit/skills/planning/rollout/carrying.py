"""Pick-and-place and drag: move one node to its position in the goal, or slightly beside it."""

import numpy as np

from dlokit.skills.planning.rollout.candidates import Candidate, PlanningScene
from dlokit.types.action import Action, Drag, PickPlace
from dlokit.types.arrays import Float64Array

_LOWEST_LIFT_M = 0.02
_HIGHEST_LIFT_M = 0.25
_DRAG_LIFT_M = 0.004
_SPEED_M_S = (0.1, 0.5)
_OVERSHOOTS = (0.0, 0.12, 0.25)
_AIM = 0.5  # fraction of a correction that is applied at once
_FAR_M = 0.05  # error from which the full spread is used


class Carrying:
    """Parameters: node, offset of the release (x, y) [m], turn beyond the goal's tangent [rad], lift [m], bow, speed.

    The bow is the distance of the path's middle from the straight line, as a fraction of its length. A drag keeps the
    rod on the table.
    """

    def __init__(self, scene: PlanningScene, *, dragging: bool) -> None:
        self.kind: type[Action] = Drag if dragging else PickPlace
        self._scene, self._dragging = scene, dragging
        error_m = float(np.sqrt(np.mean(scene.error_m**2)))
        self._scale = min(max(error_m / _FAR_M, 0.3), 1.0)

    @property
    def spread(self) -> Float64Array:
        """Spread of the parameters; smaller where the shape is already near the goal."""
        beside = 0.015 * self._scale
        return np.array([1.5, beside, beside, 0.25 * self._scale, 0.015, 0.1, 0.04])

    def first(self, count: int, rng: np.random.Generator) -> list[Float64Array]:
        """Nodes along the whole rod moved to their goals; then the same with an overshoot."""
        scene, path = self._scene, self._scene.tools.actions.path
        to_goal = (scene.goal_world - scene.nodes_world)[:, :2]
        found = [
            np.array([node, *(fraction * to_goal[node]), 0.0, path.lift_m, 0.0, path.speed_m_s])
            for fraction in _OVERSHOOTS
            for node in scene.nodes_to_move
        ]
        return found[:count]

    def aimed(self, numbers: Float64Array, nodes_world: Float64Array) -> Float64Array:
        """The release shifted by the displacement that best corrects the node and its neighbours."""
        scene = self._scene
        error = (scene.goal_world - nodes_world)[:, :2]
        corrected = numbers.copy()
        corrected[1:3] += scene.helpful(float(numbers[0]), error, _AIM)
        return corrected

    def make(self, numbers: Float64Array) -> Candidate | None:
        """The candidate of these numbers."""
        node, x, y, more_turn, lift, bow, speed = (float(number) for number in numbers)
        scene = self._scene
        hold = scene.hold(int(min(max(round(node), 0), scene.count - 1)))
        if hold is None:
            return None
        first, turn = scene.start(hold, more_turn)
        last = np.array([*(hold.there.position_world[:2] + np.array([x, y])), first[2], first[3] + turn])
        height = _DRAG_LIFT_M if self._dragging else min(max(lift, _LOWEST_LIFT_M), _HIGHEST_LIFT_M)
        up, carry = np.array([0.0, 0.0, height, 0.0]), last - first
        middle = first + 0.5 * carry + min(max(bow, -0.5), 0.5) * np.array([-carry[1], carry[0], 0.0, 0.0])
        tool = np.stack((first, first + up, middle + up, last + up, last))
        clean = np.array([hold.node, x, y, more_turn, height, bow, speed])
        velocity = scene.tools.actions.path.velocity(min(max(speed, _SPEED_M_S[0]), _SPEED_M_S[1]))
        return scene.candidate(self.kind, clean, hold, tool, velocity)
