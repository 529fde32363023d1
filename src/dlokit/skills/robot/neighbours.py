"""The other arms of a cell: their last known states, and whether they are too near."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from dlokit.communication import topics
from dlokit.communication.port import Port
from dlokit.description.arm.model import ArmModel
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import SkillFailure
from dlokit.motion.arm_distance import AS_FAR_M, gap_m, stopping_gap_m
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotReason, RobotState

SILENT_S = 0.2
"""An arm without a new state for this long may be anywhere [s of the arm's own clock]; ten periods of its state."""
_WAIT_S = 2.0
"""Longest wait of a motion for another arm's first state, when both have just started [s]."""
_POLL_S = 0.02
_AT_REST_RAD = 0.005
"""An arm whose joints all changed by less than this [rad] has not moved: closing fingers shake it less, and no part of
the arm moves by half of the clearance."""


class Neighbours:
    """The other arms, by the addresses of their robot components; a `Deadline` that expires when one is silent."""

    def __init__(
        self,
        port: Port,
        arm: ArmModel,
        others: tuple[ArmMount, ...],
        clearance_m: float,
        now_ns: Callable[[], int],
    ) -> None:
        """`arm` is this arm, `others` are the remaining ones; `clearance_m` is the least distance to keep [m];
        `now_ns` is the clock of this arm's own states.
        """
        self._port = port
        self._arm = arm
        self._others = {mount.instance: mount for mount in others}
        self._now_ns = now_ns
        self._received: dict[str, tuple[PosedArm, int]] = {}
        """Instance → its newest state, and when it arrived [ns]."""
        for instance in self._others:
            port.tap(topics.ROBOT_STATE.at(instance), partial(self._receive, instance))
        self._clearance_m = clearance_m
        self._met: dict[str, Float64Array] = {}
        """Robot → joint angles (J,) [rad] when the motion was checked against it."""

    async def now(self) -> list[PosedArm]:
        """Their present states, to check a motion against; later states are watched during the motion.

        Raises `SkillFailure` ``neighbour_silent`` when one publishes none within 2 s.
        """
        clock = self._port.clock
        give_up_ns = clock.now_ns() + round(_WAIT_S * 1e9)
        while silent := self._silent():
            if clock.now_ns() >= give_up_ns:
                raise SkillFailure(
                    RobotReason.NEIGHBOUR_SILENT,
                    f"no state of the {silent} arm arrived for {_WAIT_S:g} s, so it may be in the way; check that "
                    "its robot process runs",
                )
            await clock.sleep(_POLL_S)
        known = self._known()
        self._met = {other.state.robot: other.state.q_rad for other in known}
        return known

    def too_near(self, mine: RobotState) -> str:
        """Why a moving arm must brake now for another one; empty when it need not.

        It must if both arms, braking now, would come nearer than the clearance and than they are; moving apart is
        allowed. An arm that has not moved since the motion was checked against it is ignored: a motion that ends near
        it would otherwise be aborted.
        """
        this = PosedArm(self._arm, mine)
        for other in self._known():
            met = self._met.get(other.state.robot)
            if met is not None and np.max(np.abs(other.state.q_rad - met)) < _AT_REST_RAD:
                continue
            stopping_m = stopping_gap_m(this, other)
            if stopping_m < self._clearance_m and stopping_m < gap_m(this, other) - AS_FAR_M:
                return f"the {other.state.robot} arm is {1e3 * gap_m(this, other):.0f} mm away and both move"
        return ""

    @property
    def left_s(self) -> float:
        """Time until one arm has been silent for too long [s], as `Deadline`."""
        return SILENT_S - max(map(self._age_s, self._others))

    def _receive(self, instance: str, state: RobotState) -> None:
        """Keep a state; called on the network's thread, also while the loop is busy. A repeated stamp is not new."""
        received = self._received.get(instance)
        if received is None or state.stamp_ns != received[0].state.stamp_ns:
            self._received[instance] = PosedArm(self._others[instance].model, state), self._now_ns()

    def _age_s(self, instance: str) -> float:
        received = self._received.get(instance)
        return math.inf if received is None else (self._now_ns() - received[1]) / 1e9

    def _silent(self) -> str:
        """The name of an arm that is silent, or empty."""
        return next((mount.robot for mount in self._others.values() if self._age_s(mount.instance) > SILENT_S), "")

    def _known(self) -> list[PosedArm]:
        return [self._received[instance][0] for instance in self._others if instance in self._received]
