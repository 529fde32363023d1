"""The goal shape, dragged by the operator's frames: forces on the grabbed nodes, the rod does the rest.

So that a goal obeys the DLO: its length is kept and it bends as the rod bends.
"""

import math

import numpy as np

from dlokit.description.scene import NO_POSTS
from dlokit.rod.believed import BelievedDlo, fit_length
from dlokit.rod.tracking_rod import RodModel
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import GoalFrame

_STEP_S = 0.01  # of one physics step
_STEPS = 150  # of one update
_ROUNDS = 5  # the limit on the force is renewed this often in one update
_SPRING_N_M = 40.0  # between a frame and its node
_FORCE_LIMIT_N = 0.1  # of a frame on its node; more would stretch the rod
_DAMPING_N_S_M = 0.05  # of each node against the table


class GoalRod:
    """A rod in the plane of the table, among posts (P, 8), that frames pull into a goal."""

    def __init__(self, config: BelievedDlo, posts: Float64Array = NO_POSTS) -> None:
        self.config = config
        self._rod = RodModel(config, timestep_s=_STEP_S, damping_n_s_m=_DAMPING_N_S_M, posts=posts)

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m], all in the plane z = radius."""
        nodes = self._rod.nodes_world
        nodes[:, 2] = self.config.radius_m
        return nodes

    def place(self, nodes_world: Float64Array) -> None:
        """Set the goal rod to a curve (K, 3) [m], brought to the rod's length."""
        nodes = fit_length(self.config, nodes_world)
        nodes[:, 2] = self.config.radius_m
        self._rod.place(nodes)

    def drag(self, frames: tuple[GoalFrame, ...]) -> Float64Array:
        """One update: pull the frames' nodes, and their neighbours where a yaw is asked for; nodes (M, 3) [m].

        Called again with the same frames it goes on from where it was, so that a far drag settles over several.
        """
        nodes = self._rod.nodes_world
        targets, gains = nodes.copy(), np.zeros_like(nodes)
        targets[:, 2] = self.config.radius_m
        gains[:, 2] = _SPRING_N_M  # the table: an elastic rod would buckle out of the plane
        for frame in frames:
            self._grab(frame, targets, gains)
        for _ in range(_ROUNDS):
            pull_n = gains[:, 0] * np.linalg.norm(targets - self._rod.nodes_world, axis=1)
            fraction = np.minimum(1.0, _FORCE_LIMIT_N / np.maximum(pull_n, 1e-12))
            self._rod.pull(targets, gains * np.column_stack((fraction, fraction, np.ones_like(fraction))))
            self._rod.step(math.ceil(_STEPS / _ROUNDS))
        return self.nodes_world

    def _grab(self, frame: GoalFrame, targets: Float64Array, gains: Float64Array) -> None:
        centre = np.array([frame.x_m, frame.y_m])
        targets[frame.node, :2], gains[frame.node, :2] = centre, _SPRING_N_M
        if frame.yaw_rad is None:
            return
        spacing = self.config.length_m / (self.config.nodes - 1)
        along = spacing * np.array([np.cos(frame.yaw_rad), np.sin(frame.yaw_rad)])
        for side in (-1, 1):
            if 0 <= frame.node + side < self.config.nodes:
                targets[frame.node + side, :2] = centre + side * along
                gains[frame.node + side, :2] = _SPRING_N_M
