"""The start of a run that moves a real arm: what perception sees, an operator's answers, then the right to move.

A simulated cell begins with an empty gripper, the DLO in view and nobody near the arm. On a real table only a person
knows. The robot's process enforces it: until `robot.confirm_start` it rejects every motion as ``no_operator``.
"""

from dataclasses import dataclass
from typing import Protocol

from dlokit.communication import topics
from dlokit.communication.transport import Transport, first_message
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import HardwareError, StartNotConfirmed
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.types.outcome import Failed, Succeeded
from dlokit.types.robot import RobotState

_PAGE_S = 10.0
"""Longest wait for the viewer's address [s]; without it the questions are asked all the same."""
_STATE_S = 5.0
"""Longest wait for the state of an arm, which comes 50 times a second [s]."""
_LOOKS = 3
"""Looks until the camera gives a picture: the first frames of a device may be incomplete."""


@dataclass(frozen=True, kw_only=True)
class Sighting:
    """What the camera sees before the start."""

    points: int
    """Points of the DLO, after segmentation and filters."""
    nodes: int
    """Nodes of the DLO that the observer found; 0: none."""
    problem: str = ""
    """Why there is no DLO; empty where one was found."""


class RealStart:
    """The start of one run, before anything moves."""

    def __init__(self, transport: Transport, config: RunConfig, *, resumed: bool = False) -> None:
        """`resumed`: the gripper may hold the DLO, which it first releases."""
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
        """How far the fingers of each arm are apart [m]. Raises `HardwareError` where an arm is silent."""
        mounts = self.config.mounts
        return {mount.robot: (await state_of(self._transport, mount)).finger_width_m for mount in mounts}

    async def look(self) -> Sighting:
        """Look with the arms where they are, and let the observer search for the DLO; nothing moves."""
        seen = await self._transport.call(perception.LOOK)
        for _ in range(_LOOKS - 1):
            if not isinstance(seen, Failed) or seen.reason not in perception.MAY_RETURN:
                break
            seen = await self._transport.call(perception.LOOK)
        if not isinstance(seen, Succeeded):
            return Sighting(points=0, nodes=0, problem=seen.why)
        points = seen.result.points
        found = await self._transport.call(observer.INITIALISE, seen.result.stamp_ns, None)
        await self._transport.call(observer.RESET)  # the task finds the DLO itself, with the arms at home
        if not isinstance(found, Succeeded):
            return Sighting(points=points, nodes=0, problem=found.why)
        return Sighting(points=points, nodes=len(found.result.nodes_world))


async def state_of(transport: Transport, mount: ArmMount) -> RobotState:
    """The present state of an arm: the next that arrives, not the last one. Raises `HardwareError` when none does."""
    state = await first_message(transport, topics.ROBOT_STATE.at(mount.instance), _STATE_S, with_last=False)
    if state is None:
        raise HardwareError(
            f"no state of the arm {mount.robot} came within {_STATE_S:g} s; is it switched on and connected, and does "
            "its process run? See dlokit ps"
        )
    return state


class StartOperator(Protocol):
    """Whoever confirms a start."""

    async def confirm(self, start: RealStart) -> None:
        """Return when an operator has confirmed the start. Raises `StartNotConfirmed` where not."""
        ...


async def confirmed_start(transport: Transport, config: RunConfig, operator: StartOperator, *, resumed: bool) -> None:
    """Ask an operator, where the run moves a real arm, and then allow this process to move it.

    This process holds the leases of the arms. Raises `StartNotConfirmed`, and `HardwareError` where an arm is gone.
    """
    if not config.moves_real_arm:
        return
    await operator.confirm(RealStart(transport, config, resumed=resumed))
    for mount in config.mounts:
        allowed = await transport.call(robot.CONFIRM_START.at(mount.instance))
        if not isinstance(allowed, Succeeded):
            raise StartNotConfirmed(f"the robot {mount.robot} does not take the confirmation: {allowed.why}")
