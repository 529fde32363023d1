"""The paper's three movable frames, without the page: which nodes they pull, and where to."""

from dataclasses import dataclass, replace

import numpy as np

from dlokit import geometry
from dlokit.types.arrays import Float64Array
from dlokit.types.flow import GoalFrame, GoalFrames

TURNED_RAD = 0.02
"""A frame turned by less than this (1.1°) is not meant to be turned: its direction stays free."""


@dataclass(frozen=True)
class Handle:
    """One movable frame on the table."""

    node: int
    x_m: float
    y_m: float
    yaw_rad: float
    """How the frame is drawn."""
    turned: bool = False
    """Whether the operator turned it; then its direction is imposed on the rod."""


class GoalHandles:
    """Three frames, at the first, the middle and the last node of the goal rod.

    They lie on the goal, whoever made it, until the operator drags one; from then on they are the operator's.
    """

    def __init__(self, goal_nodes_world: Float64Array, x_m: tuple[float, float], y_m: tuple[float, float]) -> None:
        self._x_m, self._y_m = x_m, y_m
        self.dragged = False
        self._goal = goal_nodes_world
        self.handles = self._on(goal_nodes_world)

    def follow(self, goal_nodes_world: Float64Array) -> bool:
        """A new goal (M, 3) [m]: lie on it, unless the operator has dragged; whether the frames moved."""
        self._goal = goal_nodes_world
        if self.dragged:
            return False
        self.handles = self._on(goal_nodes_world)
        return True

    def release(self) -> None:
        """Lie on the goal as it is now, with free directions, and follow it again."""
        self.dragged = False
        self.handles = self._on(self._goal)

    def drag(self, index: int, x_m: float, y_m: float, yaw_rad: float) -> Handle:
        """The operator moved frame `index`; it stays within the table. Returns where it is now."""
        old = self.handles[index]
        turn = (yaw_rad - old.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
        new = replace(
            old,
            x_m=float(np.clip(x_m, *self._x_m)),
            y_m=float(np.clip(y_m, *self._y_m)),
            # While it is free, the drawn yaw is kept, so that many small turns add up to a meant one.
            yaw_rad=yaw_rad if old.turned or abs(turn) > TURNED_RAD else old.yaw_rad,
            turned=old.turned or abs(turn) > TURNED_RAD,
        )
        self.handles = (*self.handles[:index], new, *self.handles[index + 1 :])
        self.dragged = True
        return new

    def message(self, stamp_ns: int) -> GoalFrames:
        """What the model needs to know."""
        return GoalFrames(
            stamp_ns=stamp_ns,
            frames=tuple(
                GoalFrame(node=h.node, x_m=h.x_m, y_m=h.y_m, yaw_rad=h.yaw_rad if h.turned else None)
                for h in self.handles
            ),
        )

    def _on(self, nodes_world: Float64Array) -> tuple[Handle, ...]:
        directions = geometry.tangents(nodes_world)
        last = len(nodes_world) - 1
        return tuple(
            Handle(
                node=node,
                x_m=float(nodes_world[node, 0]),
                y_m=float(nodes_world[node, 1]),
                yaw_rad=float(np.arctan2(directions[node, 1], directions[node, 0])),
            )
            for node in (0, last // 2, last)
        )
