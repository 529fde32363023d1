"""The rod between two looks: held nodes follow their tools, friction and elasticity do the rest."""

import math
from collections.abc import Mapping

import numpy as np

from dlokit.skills.model.config import ModelConfig
from dlokit.skills.model.grip import Grip, take_hold
from dlokit.skills.model.rod import RodModel, fit_length
from dlokit.skills.model.tracking import Pin
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotState

_LONGEST_GAP_S = 0.1  # after a longer silence of the robot the time between is not caught up with


class Carry:
    """A rod on the table whose held nodes move with the robots' tools."""

    def __init__(self, config: ModelConfig) -> None:
        self._config = config
        self._rod = RodModel(config, timestep_s=config.rollout.timestep_s)
        self._rod.on_table(True)
        self._grips: dict[str, Grip] = {}
        self._last: dict[str, RobotState] = {}
        self.travelled_m = 0.0
        """Path of the tools since the rod was last free [m]."""

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m]."""
        return self._rod.nodes_world

    @property
    def holds(self) -> bool:
        """Whether any robot is said to hold the rod."""
        return bool(self._grips)

    def place(self, nodes_world: Float64Array) -> None:
        """Set the rod to what was seen, (M, 3) [m]; grips stay."""
        self._rod.place(fit_length(self._config, nodes_world))

    def take_hold(self, robot: str, node: int, tool: RobotState, nodes_world: Float64Array) -> None:
        """Tie `node` of a rod lying as `nodes_world` (M, 3) [m] to a robot's tool."""
        if not self._grips:
            self.travelled_m = 0.0
        if 0 <= node < self._config.nodes:
            self._grips[robot] = take_hold(nodes_world, node, tool.T_world_tcp)
            self._last[robot] = tool

    def move(self, robot: RobotState) -> bool:
        """Follow a tool to where it is now; False when that robot holds nothing."""
        grip = self._grips.get(robot.robot)
        if grip is None or not robot.holding:
            return False
        last = self._last[robot.robot]
        # Time passes once, however many robots tell of it.
        newest_ns = max(self._last[name].stamp_ns for name in self._grips)
        passed_s = min((robot.stamp_ns - newest_ns) / 1e9, _LONGEST_GAP_S)
        steps = math.floor(passed_s / self._config.rollout.timestep_s + 1e-6)
        if steps < 1 and (len(self._grips) == 1 or robot.stamp_ns <= last.stamp_ns):
            return False
        self._last[robot.robot] = robot
        self.travelled_m += float(np.linalg.norm(robot.T_world_tcp.position_m - last.T_world_tcp.position_m))
        targets, gains = self._rod.nodes_world, np.zeros((self._config.nodes, 3))
        if steps < 1:
            return False
        for name, held in self._grips.items():
            targets[held.nodes] = held.targets_world(self._last[name].T_world_tcp)
            gains[held.nodes] = held.gains_n_m(self._config.rollout.grip_stiffness_n_m)
        self._rod.pull(targets, gains)
        self._rod.step(steps)
        return True

    def release(self, robot: str) -> bool:
        """Let go and let the rod come to rest; False when that robot held nothing, or another holds it still."""
        if self._grips.pop(robot, None) is None:
            return False
        if self._grips:
            return False  # the rod comes to rest when the last one lets go
        self._rod.let_go()
        self._rod.step(math.ceil(self._config.rollout.release_s / self._config.rollout.timestep_s))
        return True

    def forget(self) -> None:
        """Let go of everything at once."""
        self._grips.clear()
        self._rod.let_go()

    def pins(self, tools: Mapping[str, RobotState]) -> tuple[Pin, ...]:
        """Where the held nodes are, by the tools of their robots."""
        return tuple(
            Pin(node=grip.node, position_world=grip.targets_world(tools[robot].T_world_tcp)[grip.nodes == grip.node][0])
            for robot, grip in self._grips.items()
            # A state from before the grip cannot know of it.
            if tools[robot].holding or tools[robot].stamp_ns <= self._last[robot].stamp_ns
        )
