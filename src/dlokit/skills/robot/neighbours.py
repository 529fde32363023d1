"""The other arms of a cell: where they are, as far as they were heard of, and whether they are too near."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from dlokit.communication import topics
from dlokit.communication.port import Port
from dlokit.errors import SkillFailure
from dlokit.motion.arm_distance import AS_FAR_M, gap_m, stopping_gap_m
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotReason, RobotState

SILENT_S = 0.2
"""An arm that was not heard of for so long may be anywhere [s of the arm's own clock]; ten of its states."""
_WAIT_S = 2.0
"""How long a motion waits for another arm to be heard of, when both have just started [s]."""
_POLL_S = 0.02
_STANDS_RAD = 0.005
"""An arm all of whose joints are within this of where they were has not moved: fingers that close shake it less, and it
moves no part of an arm by half of what arms keep apart."""


class Neighbours:
    """The other arms, by the instances of their robot components; a `Deadline`: over when one is silent."""

    def __init__(self, port: Port, instances: tuple[str, ...], clearance_m: float, now_ns: Callable[[], int]) -> None:
        """`clearance_m` is the least distance to keep [m]; `now_ns` is the clock of this arm's own states."""
        self._port = port
        self._instances = instances
        self._now_ns = now_ns
        self._heard: dict[str, tuple[RobotState, int]] = {}
        """Of each that was heard of, its newest state and when that came [ns]."""
        for instance in instances:
            port.tap(topics.ROBOT_STATE.at(instance), partial(self._hear, instance))
        self._clearance_m = clearance_m
        self._met: dict[str, Float64Array] = {}
        """Joint angles (7,) [rad] of the others when the motion was held against them, by robot."""

    async def now(self) -> list[RobotState]:
        """Where they are, for a motion to be held against; what they do later is watched on the way.

        Raises `SkillFailure` ``neighbour_silent`` when one is not heard of within 2 s.
        """
        clock = self._port.clock
        give_up_ns = clock.now_ns() + round(_WAIT_S * 1e9)
        while silent := self._silent():
            if clock.now_ns() >= give_up_ns:
                raise SkillFailure(
                    RobotReason.NEIGHBOUR_SILENT,
                    f"nothing was heard of the arm {silent!r} for {_WAIT_S:g} s, so it may be in the way; see whether "
                    "its robot process runs",
                )
            await clock.sleep(_POLL_S)
        known = self._known()
        self._met = {state.robot: state.q_rad for state in known}
        return known

    def too_near(self, mine: RobotState) -> str:
        """Why an arm that moves must brake now for another that is heard of; empty when it need not.

        It must where both, braking now, would come nearer than they may and than they are: to part is allowed. Another
        that stands where it stood when the motion was held against it is in nobody's way: the motion, which ends near
        it as slowly as an arm can brake, would else be broken off.
        """
        for other in self._known():
            met = self._met.get(other.robot)
            if met is not None and np.max(np.abs(other.q_rad - met)) < _STANDS_RAD:
                continue
            stopping_m = stopping_gap_m(mine, other)
            if stopping_m < self._clearance_m and stopping_m < gap_m(mine, other) - AS_FAR_M:
                return f"{other.robot} is {1e3 * gap_m(mine, other):.0f} mm away and both are under way"
        return ""

    @property
    def left_s(self) -> float:
        """As `Deadline`: until one has been silent for too long [s]."""
        return SILENT_S - max(map(self._age_s, self._instances))

    def _hear(self, instance: str, state: RobotState) -> None:
        """On a thread of the network's: past a loop that is busy. An arm whose feedback is frozen says nothing new."""
        heard = self._heard.get(instance)
        if heard is None or state.stamp_ns != heard[0].stamp_ns:
            self._heard[instance] = state, self._now_ns()

    def _age_s(self, instance: str) -> float:
        heard = self._heard.get(instance)
        return math.inf if heard is None else (self._now_ns() - heard[1]) / 1e9

    def _silent(self) -> str:
        """An arm that is not heard of, or empty."""
        return next((instance or "first" for instance in self._instances if self._age_s(instance) > SILENT_S), "")

    def _known(self) -> list[RobotState]:
        return [self._heard[instance][0] for instance in self._instances if instance in self._heard]
