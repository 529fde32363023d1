"""Pairs of grasps: two arms each move a node to its position in the goal at the same time."""

from dataclasses import replace

import numpy as np

from dlokit.motion.tool_path import TURN_LEVER_M
from dlokit.rod.rollout import Motion
from dlokit.skills.planning.base import SecondArm
from dlokit.skills.planning.rollout.candidates import Candidate, NodeToGoal, PlanningScene, tool_pose
from dlokit.types.action import Action, PairPlace, VelocityProfile
from dlokit.types.arrays import Float64Array

_LEAST_BETWEEN_M = 0.16  # distance that two grippers side by side need
_LEAST_APART_M = 0.03  # of the arms, by their capsules
_LIFT_M = (0.02, 0.2)
_SPEED_M_S = (0.1, 0.4)
_FRACTIONS = ((0.0, 1.0), (0.1, 0.9), (0.2, 0.8), (0.25, 0.65), (0.35, 0.75), (0.3, 0.7), (0.0, 0.6), (0.4, 1.0))
_OVERSHOOTS = (0.0, 0.12)
_AIM = 0.7


class Pairing:
    """Parameters: for both grasps the node, offset of the release (x, y) [m] and turn beyond the tangent [rad]; then
    the lift [m] and the speed of the tool with the longer path [m/s]."""

    def __init__(self, scene: PlanningScene, second: SecondArm) -> None:
        self.kind: type[Action] = PairPlace
        self._scene, self._second = scene, second

    @property
    def spread(self) -> Float64Array:
        """Spread of the numbers."""
        one = [1.5, 0.012, 0.012, 0.2]
        return np.array([*one, *one, 0.015, 0.04])

    def first(self, count: int, rng: np.random.Generator) -> list[Float64Array]:
        """Nodes far apart, each moved to its position and with an overshoot; then variations of these."""
        scene, path = self._scene, self._scene.tools.actions.path
        to_goal = (scene.goal_world - scene.nodes_world)[:, :2]
        found: list[Float64Array] = []
        for overshoot in _OVERSHOOTS:
            for fractions in _FRACTIONS:
                nodes = [round(fraction * (scene.count - 1)) for fraction in fractions]
                ends = [number for node in nodes for number in (node, *(overshoot * to_goal[node]), 0.0)]
                found.append(np.array([*ends, path.lift_m, path.speed_m_s]))
        usual = list(found)
        while len(found) < count:
            found.append(usual[len(found) % len(usual)] + self.spread * rng.standard_normal(len(self.spread)))
        return found[:count]

    def aimed(self, numbers: Float64Array, nodes_world: Float64Array) -> Float64Array:
        """Both releases shifted by the displacements that best correct the nodes and their neighbours."""
        scene = self._scene
        error = (scene.goal_world - nodes_world)[:, :2]
        corrected = numbers.copy()
        for at in (0, 4):
            corrected[at + 1 : at + 3] += scene.helpful(float(numbers[at]), error, _AIM)
        return corrected

    def make(self, numbers: Float64Array) -> Candidate | None:
        """The candidate with these parameters and arms that do not cross; None when neither assignment is valid."""
        scene = self._scene
        nodes = [int(min(max(round(float(numbers[at])), 0), scene.count - 1)) for at in (0, 4)]
        if abs(nodes[0] - nodes[1]) * scene.length_m / (scene.count - 1) < _LEAST_BETWEEN_M:
            return None
        clean = numbers.copy()
        clean[[0, 4]] = nodes
        moves = ((nodes[0], clean[1:4]), (nodes[1], clean[5:8]))
        for own, other in (moves, moves[::-1]):
            made = self._by(own, other, clean)
            if made is not None:
                return made
        return None

    def _by(
        self, own: tuple[int, Float64Array], other: tuple[int, Float64Array], numbers: Float64Array
    ) -> Candidate | None:
        """The first arm moves `own`, the second `other`, each a node with its release; None when a gripper does not
        fit, or the arms do not reach or come too near each other."""
        holds = self._scene.hold(own[0]), self._scene.hold(other[0], second=True)
        if holds[0] is None or holds[1] is None:
            return None
        lift_m = min(max(float(numbers[8]), _LIFT_M[0]), _LIFT_M[1])
        first = self._tool(holds[0], own[1], lift_m, second=False)
        second = self._tool(holds[1], other[1], lift_m, second=True)
        poses = [tool_pose(point) for point in first], [tool_pose(point) for point in second]
        if not (all(map(self._scene.tools.reachable, poses[0])) and all(map(self._second.reachable, poses[1]))):
            return None
        if self._second.apart_m(*poses) < _LEAST_APART_M:
            return None
        opening_m = self._scene.tools.room.opening_m(first, holds[0].openings_m)
        partner_opening_m = self._scene.second_tools.room.opening_m(second, holds[1].openings_m)
        if opening_m is None or partner_opening_m is None:
            return None
        lengths_m = _length_m(first), _length_m(second)
        paces = [self._pace(float(numbers[9]), length_m / max(lengths_m)) for length_m in lengths_m]
        partner = Motion(node=other[0], waypoints=second, velocity=paces[1])
        return Candidate(
            kind=self.kind,
            numbers=numbers,
            motion=replace(Motion(node=own[0], waypoints=first, velocity=paces[0]), partner=partner),
            opening_m=opening_m,
            partner_opening_m=partner_opening_m,
        )

    def _tool(self, hold: NodeToGoal, release: Float64Array, lift_m: float, *, second: bool) -> Float64Array:
        """Waypoints (5, 4) of one tool: down at the grasp, up, over, above the release, down."""
        first, turn = self._scene.start(hold, float(release[2]), second=second)
        last = np.array([*(hold.there.position_world[:2] + release[:2]), first[2], first[3] + turn])
        up = np.array([0.0, 0.0, lift_m, 0.0])
        return np.stack((first, first + up, 0.5 * (first + last) + up, last + up, last))

    def _pace(self, speed_m_s: float, fraction: float) -> VelocityProfile:
        """The velocity profile of the tool with the shorter path, scaled so that both arrive together."""
        path = self._scene.tools.actions.path
        return VelocityProfile(
            speed_m_s=fraction * min(max(speed_m_s, _SPEED_M_S[0]), _SPEED_M_S[1]),
            acceleration_m_s2=fraction * path.acceleration_m_s2,
            jerk_m_s3=fraction * path.jerk_m_s3,
        )


def _length_m(tool: Float64Array) -> float:
    steps = np.diff(tool, axis=0)
    return float(np.sum(np.maximum(np.linalg.norm(steps[:, :3], axis=1), TURN_LEVER_M * np.abs(steps[:, 3]))))
