"""The rod between two looks: held nodes follow their tools, friction and elasticity do the rest.

It is the planning rod. A rod in MuJoCo was tried: with contacts that appear and break, rounding in the last digit grew
to centimetres within one carry, so that the same run differed between processors.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from dlokit import geometry
from dlokit.description.scene import NO_POSTS
from dlokit.rod.believed import BelievedDlo
from dlokit.rod.planning_rod import Contacts, advance
from dlokit.rod.rollout import REST_S, SINK_M, PlanningRod, between_pads, fine_rod
from dlokit.skills.model.tracking import Pin
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotState

_LONGEST_GAP_S = 0.1  # a longer gap between two states of the robot counts as this long
_STEP_S = 0.005  # of one physics step, about
# The rod follows a tool at this speed at most, also one that moved on while its states were lost: released by a tool of
# 1.5 m/s, it came to rest up to 0.16 m farther away than it is long.
_FASTEST_M_S = 1.0


@dataclass(frozen=True, kw_only=True)
class _Grip:
    """What is between the fingers of one tool."""

    node: int
    place_tcp: Float64Array
    """Where the node is in the tool's frame (3,) [m]; closing fingers bring it to the middle between them."""
    pads: Float64Array
    """(3, 4) as `between_pads` gives them."""
    tool: Float64Array
    """The tool (4,) that the rod has followed so far: x, y, z [m], yaw [rad]."""
    newest: RobotState
    """Where the tool is now."""


class Carry:
    """A rod on the table whose held nodes move with the robots' tools, which point down."""

    def __init__(self, config: BelievedDlo, posts: Float64Array = NO_POSTS) -> None:
        """`posts` (P, 8) are from `Scene.posts_world`."""
        self._config, self._posts = config, posts
        straight = np.column_stack((np.linspace(0.0, config.length_m, config.nodes), np.zeros((config.nodes, 2))))
        self._grips: dict[str, _Grip] = {}
        self.travelled_m = 0.0
        """Path of the tools since the rod was last free [m]."""
        self.place(straight)
        # The kernel is loaded, or compiled after an installation, before an arm carries anything.
        self._advance(_STEP_S, Contacts(posts=posts), rest_steps=1)

    @property
    def nodes_world(self) -> Float64Array:
        """Nodes (M, 3) [m], none below the table."""
        nodes = geometry.resample(self._x[:, :3], self._config.nodes)
        nodes[:, 2] = np.maximum(nodes[:, 2] + SINK_M, self._config.radius_m)
        return nodes

    @property
    def holds(self) -> bool:
        """Whether any robot is said to hold the rod."""
        return bool(self._grips)

    def place(self, nodes_world: Float64Array) -> None:
        """Set the rod to what was seen, (K, 3) [m], at rest; grips stay."""
        nodes = fine_rod(self._config, nodes_world)
        # A node at rest lies as deep in the table as its weight presses it.
        nodes[:, 2] = np.maximum(nodes[:, 2], self._config.radius_m) - SINK_M
        self._rod = PlanningRod().numbers(self._config, len(nodes))
        self._x = np.column_stack((nodes, np.zeros((len(nodes), 2))))
        self._v, self._rest = np.zeros((len(nodes), 4)), np.zeros(len(nodes))

    def take_hold(self, robot: str, node: int, tool: RobotState) -> None:
        """Tie `node` of the rod to a robot's tool."""
        if not self._grips:
            self.travelled_m = 0.0
        if not 0 <= node < self._config.nodes:
            return
        at = _pointing_down(tool, near_yaw_rad=0.0)
        near = round(node * (len(self._x) - 1) / (self._config.nodes - 1))
        place = geometry.transform(geometry.inverse(tool.T_world_tcp), self.nodes_world[node])
        self._grips[robot] = _Grip(
            node=node,
            place_tcp=place * (1.0, 0.0, 1.0),
            pads=between_pads(self._x[:, :3], near, at),
            tool=at,
            newest=tool,
        )

    def move(self, robot: RobotState) -> bool:
        """Follow a tool to where it is now; False when that robot holds nothing, or no time has passed."""
        grip = self._grips.get(robot.robot)
        if grip is None or not robot.holding or robot.stamp_ns <= grip.newest.stamp_ns:
            return False
        # Time passes once, however many robots report it.
        before_ns = max(one.newest.stamp_ns for one in self._grips.values())
        moved = robot.T_world_tcp.position_m - grip.newest.T_world_tcp.position_m
        self.travelled_m += float(np.linalg.norm(moved))
        self._grips[robot.robot] = replace(grip, newest=robot)
        passed_s = min((robot.stamp_ns - before_ns) / 1e9, _LONGEST_GAP_S)
        if passed_s <= 0.0:
            return False
        ends = {name: _pointing_down(held.newest, near_yaw_rad=held.tool[3]) for name, held in self._grips.items()}
        farthest_m = max(float(np.linalg.norm((ends[name] - held.tool)[:3])) for name, held in self._grips.items())
        passed_s = max(passed_s, farthest_m / _FASTEST_M_S)
        steps = max(1, round(passed_s / _STEP_S))
        tools = list[Float64Array]()
        pads = list[Float64Array]()
        for arm, (name, held) in enumerate(self._grips.items()):
            end = ends[name]
            tools.append(np.linspace(held.tool, end, steps + 1)[1:])
            pads.append(np.column_stack((held.pads[:, :3], np.full(len(held.pads), float(arm)))))
            self._grips[name] = replace(held, tool=end)
        contacts = Contacts(np.hstack(tools), np.concatenate(pads), posts=self._posts)
        self._advance(passed_s / steps, contacts, rest_steps=0)
        return True

    def release(self, robot: str) -> bool:
        """Let go and let the rod come to rest; False when that robot held nothing, or another holds it still."""
        if self._grips.pop(robot, None) is None:
            return False
        if self._grips:
            return False  # the rod comes to rest when the last one lets go
        rest_steps = math.ceil(REST_S / _STEP_S)
        self._advance(_STEP_S, Contacts(posts=self._posts), rest_steps=rest_steps)
        return True

    def forget(self) -> None:
        """Let go of everything at once."""
        self._grips.clear()

    def pins(self, tools: Mapping[str, RobotState]) -> tuple[Pin, ...]:
        """Where the held nodes are, by the tools of their robots."""
        return tuple(
            Pin(node=grip.node, position_world=geometry.transform(tools[robot].T_world_tcp, grip.place_tcp))
            for robot, grip in self._grips.items()
            # A state from before the grip cannot know of it.
            if tools[robot].holding or tools[robot].stamp_ns <= grip.newest.stamp_ns
        )

    def _advance(self, step_s: float, contacts: Contacts, rest_steps: int) -> None:
        advance(self._x, self._v, self._rest, self._rod, step_s, rest_steps, contacts)


def _pointing_down(robot: RobotState, near_yaw_rad: float) -> Float64Array:
    """A tool (4,): x, y, z [m], and its yaw [rad], of whole turns the one nearest to `near_yaw_rad`."""
    R = geometry.rotation(robot.T_world_tcp)
    yaw_rad = math.atan2(R[1, 0], R[0, 0])
    yaw_rad += 2.0 * math.pi * round((near_yaw_rad - yaw_rad) / (2.0 * math.pi))
    return np.array([*robot.T_world_tcp.position_m, yaw_rad])
