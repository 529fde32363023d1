"""What one action did: the shape before it, where the tool went, the shape after it. All as seen, nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dlokit import geometry
from dlokit.skills.model.quick_rollout import Motion
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotState


@dataclass(frozen=True, kw_only=True)
class Experience:
    """One grasp-to-release in which the DLO was held all the way."""

    before_world: Float64Array  # (M, 3) [m] at rest
    after_world: Float64Array  # (M, 3) [m] at rest
    node: int
    """The node between the fingers."""
    times_s: Float64Array  # (T,) [s], rising
    tool: Float64Array  # (T, 4) x, y, z [m] and yaw [rad] of the tool from the grasp to the release

    def motion(self, timestep_s: float) -> Motion:
        """The same for the quick rod: where the tool was at every time step."""
        steps = max(2, round((self.times_s[-1] - self.times_s[0]) / timestep_s) + 1)
        times_s = np.linspace(self.times_s[0], self.times_s[-1], steps)
        track = np.column_stack([np.interp(times_s, self.times_s, column) for column in self.tool.T])
        return Motion(node=self.node, waypoints=track[[0, -1]], velocity=VelocityProfile(), track=track)

    @property
    def moved_m(self) -> Float64Array:
        """How far each node came to lie from where it was (M,) [m]."""
        return np.linalg.norm((self.after_world - self.before_world)[:, :2], axis=1)


def tool_of(states: Sequence[RobotState]) -> tuple[Float64Array, Float64Array]:
    """Times (T,) [s] and places (T, 4) of a tool that points down: x, y, z [m], yaw [rad]. Stamps rise."""
    turns = [geometry.rotation(state.T_world_tcp) for state in states]
    yaw = np.unwrap([np.arctan2(turn[1, 0], turn[0, 0]) for turn in turns])
    places = np.array([state.T_world_tcp.position_m for state in states])
    return np.array([state.stamp_ns / 1e9 for state in states]), np.column_stack((places, yaw))
