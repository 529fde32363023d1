"""Starts a run that moves a real arm: perception looks, an operator answers questions, then the arm may move.

A simulated cell begins with an empty gripper, the DLO in view and no person near the arm. On a real table only a
person can check this. Until `robot.confirm_start`, the robot's process rejects every motion as ``no_operator``.
"""

import sys
from dataclasses import dataclass
from typing import Protocol

from dlokit.communication import topics
from dlokit.communication.transport import Transport, first_message
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import ConfigError, HardwareError, StartNotConfirmed
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.types.outcome import Failed, Succeeded, TimedOut, Unreachable
from dlokit.types.robot import RobotState

_PAGE_S = 10.0
"""Longest wait for the viewer's address [s]; after that, the operator is asked without it."""
_STATE_S = 5.0
"""Longest wait for the state of an arm [s], which is published 50 times a second."""
_LOOKS = 3
"""Maximum number of looks until the camera returns a picture: a device's first frames may be incomplete."""


@dataclass(frozen=True, kw_only=True)
class Sighting:
    """The observation before the start."""

    points: int
    """Points of the DLO, after segmentation and filters."""
    nodes: int
    """Nodes of the DLO that the observer found; 0: none."""
    problem: str = ""
    """Why no DLO was found; empty when one was found."""
    pictured: bool = True
    """Whether the camera gave pictures that can be used; without them nothing is known of the DLO."""


class RealStart:
    """The start of one run, before anything moves."""

    def __init__(self, transport: Transport, config: RunConfig, *, resumed: bool = False) -> None:
        """`resumed`: the gripper may hold the DLO and releases it first."""
        self._transport = transport
        self.config = config
        self.resumed = resumed

    async def page(self) -> str | None:
        """The viewer's address; None without a viewer."""
        if self.config.headless:
            return None
        shown = await first_message(self._transport, topics.VIEWER_PAGE, _PAGE_S)
        return None if shown is None else shown.url

    async def grippers(self) -> dict[str, float]:
        """Distance between the fingers of each arm [m]. Raises `HardwareError` when an arm publishes no state."""
        mounts = self.config.mounts
        return {mount.robot: (await state_of(self._transport, mount)).finger_width_m for mount in mounts}

    async def look(self) -> Sighting:
        """Look without moving the arms, and search for the DLO in the picture."""
        seen = await self._transport.call(perception.LOOK)
        for _ in range(_LOOKS - 1):
            if not isinstance(seen, Failed) or seen.reason not in perception.MAY_RETURN:
                break
            seen = await self._transport.call(perception.LOOK)
        if not isinstance(seen, Succeeded):
            no_picture = isinstance(seen, TimedOut | Unreachable) or (
                isinstance(seen, Failed) and seen.reason in perception.MAY_RETURN
            )
            return Sighting(points=0, nodes=0, problem=seen.why, pictured=not no_picture)
        points = seen.result.points
        found = await self._transport.call(observer.INITIALISE, seen.result.stamp_ns, None)
        await self._transport.call(observer.RESET)  # the task finds the DLO itself, with the arms at home
        if not isinstance(found, Succeeded):
            return Sighting(points=points, nodes=0, problem=found.why)
        return Sighting(points=points, nodes=len(found.result.nodes_world))


async def state_of(transport: Transport, mount: ArmMount) -> RobotState:
    """The present state of an arm: the next message, not the last one. Raises `HardwareError` when none arrives."""
    state = await first_message(transport, topics.ROBOT_STATE.at(mount.instance), _STATE_S, with_last=False)
    if state is None:
        raise HardwareError(
            f"no state of the arm {mount.robot} came within {_STATE_S:g} s; is it switched on and connected, and does "
            "its process run? See dlokit ps"
        )
    return state


class StartOperator(Protocol):
    """Interface that asks for the confirmation of a start."""

    async def confirm(self, start: RealStart) -> None:
        """Return when an operator has confirmed the start. Raises `StartNotConfirmed` otherwise."""
        ...


FLAG = "--operator-confirms"


def has_terminal() -> bool:
    """Whether a person can read questions here and answer them."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def check_operator(config: RunConfig, *, confirms: bool) -> None:
    """Raise `ConfigError` for a run with a real arm whose start no operator could confirm."""
    if config.moves_real_arm and not confirms and not has_terminal():
        raise ConfigError(
            f"--driver {config.driver.name} moves a real arm, and its start asks an operator, who needs a terminal: "
            f"start it in one. {FLAG} (in Python: operator_confirms=True) says instead that an operator stands by and "
            "has checked everything that the questions ask; --dry-run moves no arm."
        )


async def confirmed_start(transport: Transport, config: RunConfig, operator: StartOperator, *, resumed: bool) -> None:
    """Ask an operator for confirmation if the run moves a real arm, then allow this process to move it.

    This process holds the leases of the arms. Raises `StartNotConfirmed`, and `HardwareError` for an absent arm.
    """
    if not config.moves_real_arm:
        return
    await operator.confirm(RealStart(transport, config, resumed=resumed))
    for mount in config.mounts:
        allowed = await transport.call(robot.CONFIRM_START.at(mount.instance))
        if not isinstance(allowed, Succeeded):
            raise StartNotConfirmed(f"the robot {mount.robot} does not take the confirmation: {allowed.why}")
