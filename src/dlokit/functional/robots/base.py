"""The protocol of robot drivers, between the robot skills and an arm, and of their settings."""

from types import TracebackType
from typing import ClassVar, Protocol, Self

from dlokit.communication.port import Port
from dlokit.communication.timing.pulse import Pulse
from dlokit.description.arm.model import ArmModel
from dlokit.description.arm.mounts import ArmMount
from dlokit.types.robot import ArmProtection, GripResult, JointTrajectory, Lease, MotionResult, RobotState


class Robot(Protocol):
    """One arm with its gripper. Use as an asynchronous context manager: connected inside it, at rest afterwards.

    Failures are `SkillFailure` with a named reason; a device that is gone is ``robot_lost``.
    """

    @property
    def arm(self) -> ArmModel:
        """The model of the arm: joints, limits, home, tool, gripper, shapes."""
        ...

    async def __aenter__(self) -> Self:
        """Connect. Raises `HardwareError` when the arm does not answer."""
        ...

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the arm at rest and disconnect."""
        ...

    def state(self) -> RobotState:
        """The newest state, at once. Raises `HardwareError` before the arm's first state."""
        ...

    def now_ns(self) -> int:
        """The present time on the clock of the states' stamps [ns]; from any thread."""
        ...

    def newest_ns(self) -> int:
        """Stamp of the newest received feedback, also while this process is busy [ns]; from any thread."""
        ...

    def protection(self) -> ArmProtection | None:
        """The protection settings of the last connection or recovery; None for an arm without such settings."""
        ...

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Run a trajectory that starts at rest where the arm is; cancelling it brakes the arm.

        The driver sends heartbeats more often than every ``lease.duration_s``; without them the arm brakes.
        """
        ...

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        """Move the fingers to a width, pressing with at most `force_n` on an object between them.

        Cancelling the call holds the fingers at their present width; so does the death of this driver.
        """
        ...

    async def halt(self) -> None:
        """Brake within the limits; returns when the arm is at rest. The next motion may begin at once."""
        ...

    async def stop(self) -> None:
        """Brake, hold the fingers, and refuse motions until `enable`; returns when the arm is at rest.

        The device keeps this state, not the driver: ``state().stop_latched`` is also set for a later connection.
        """
        ...

    async def enable(self) -> None:
        """Clear a `stop`; called only at a person's request."""
        ...

    def brake(self) -> None:
        """Order the arm to brake within the limits, and return at once.

        From any thread, also while the event loop hangs; repeated calls do no harm.
        """
        ...

    async def recover(self) -> None:
        """Clear a fault; the arm stays where it is, and a `stop` stays."""
        ...


class RobotDriverConfig(Protocol):
    """The settings of a robot driver: a frozen dataclass, all fields with defaults, with a method that builds it.

    Every process loads it and its module, so large libraries are imported in the methods that call them.
    """

    name: ClassVar[str]
    in_cell: ClassVar[bool]
    """Whether its arm is in the simulated cell, and moves the DLO that the cell's cameras see."""
    is_real: ClassVar[bool]
    """Whether it moves a real arm: a run then begins with questions to the operator, and needs the live runtime."""

    def build(self, port: Port, mount: ArmMount, pulse: Pulse) -> Robot:
        """The driver of the arm at `mount`.

        `port` has the clock of the run, and calls the cell for an arm in it; `pulse` sends heartbeats during a motion.
        Raises `ConfigError` when a setting names something that is missing.
        """
        ...
