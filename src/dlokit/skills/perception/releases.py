"""Remembers where robots let the rod go, until it is seen there."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dlokit.types.observation import Gripped
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotState

_STOOD_M = 0.002
"""A tool that went farther than this after it felt the rod last has lost it on the way."""
_AWAY_M = 0.1
"""A tool nearer than this to the place may hide it."""


@dataclass(frozen=True)
class Release:
    """Where a tool was when it let the rod go."""

    T_world_tcp: Pose
    lifted: bool
    """Whether the rod hung from the fingers before."""


class Releases:
    """The releases since anything was gripped last."""

    def __init__(self, highest_m: float) -> None:
        """`highest_m`: a tool above it has lifted the rod, and a rod let go above it falls."""
        self._highest_m = highest_m
        self._held: dict[str, Release | None] = {}
        """Of each robot that is said to hold: the last state in which it felt the rod."""
        self._places: tuple[Release, ...] = ()

    def moved(self, state: RobotState) -> None:
        """Follow a tool that holds."""
        if state.robot not in self._held or not state.holding:
            return
        before = self._held[state.robot]
        lifted = before is not None and before.lifted
        lifted = lifted or bool(state.T_world_tcp.position_m[2] > self._highest_m)
        self._held[state.robot] = Release(state.T_world_tcp, lifted)

    def gripped(self, message: Gripped, tool: RobotState | None) -> None:
        """A grip makes all places worthless, since the rod will move; its end is a release, if nothing slipped."""
        if message.node is not None:
            self._held[message.robot] = None
            self._places = ()
            return
        held = self._held.pop(message.robot, None)
        if held is None or tool is None:
            return
        last = held.T_world_tcp.position_m
        stood = float(np.linalg.norm(tool.T_world_tcp.position_m - last)) < _STOOD_M
        if stood and last[2] <= self._highest_m:
            self._places = (*self._places, held)

    def in_view(self, robots: Iterable[RobotState]) -> tuple[Release, ...]:
        """The releases whose places can be seen now, each once."""
        if self._held:
            return ()
        tools = [state.T_world_tcp.position_m for state in robots]
        seen = tuple(
            place
            for place in self._places
            if all(float(np.linalg.norm(tool - place.T_world_tcp.position_m)) > _AWAY_M for tool in tools)
        )
        self._places = tuple(place for place in self._places if place not in seen)
        return seen
