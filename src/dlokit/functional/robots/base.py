"""What every robot driver is: the narrow waist between the robot skills and an arm."""

from types import TracebackType
from typing import Protocol, Self

from dlokit.types.robot import GripResult, JointLimits, JointTrajectory, Lease, MotionResult, RobotState


class Robot(Protocol):
    """One arm with its gripper. Use as an asynchronous context manager: connected inside, at rest after it.

    Failures are `SkillFailure` with a named reason; a device that is gone is ``robot_lost``.
    """

    @property
    def limits(self) -> JointLimits:
        """Position, velocity, acceleration and jerk of the joints."""
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
        """The newest state, at once. Raises `HardwareError` when the arm has not been heard of."""
        ...

    def now_ns(self) -> int:
        """The time now on the clock of the stamps of its states [ns]; from any thread."""
        ...

    def newest_ns(self) -> int:
        """Stamp of the newest feedback that has come, however busy this process is [ns]; from any thread."""
        ...

    async def follow(self, trajectory: JointTrajectory, lease: Lease) -> MotionResult:
        """Run a trajectory that starts at rest where the arm is; cancelling it brakes the arm.

        The arm also brakes when this driver dies: it hears from it more often than every ``lease.duration_s``.
        """
        ...

    async def grip(self, width_m: float, force_n: float, lease: Lease) -> GripResult:
        """Bring the fingers to a width, pressing with at most `force_n` on what is between them.

        Cancelling it holds the fingers where they are, and so does the death of this driver.
        """
        ...

    async def halt(self) -> None:
        """Brake within the limits; returns when the arm stands. The next motion may begin at once."""
        ...

    async def stop(self) -> None:
        """Brake, hold the fingers, and refuse whatever moves until `enable`; returns when the arm stands.

        The device keeps this, not the driver: ``state().stop_latched`` says so, to whoever connects later as well.
        """
        ...

    async def enable(self) -> None:
        """Clear a `stop`; called only because a person asked for it."""
        ...

    def brake(self) -> None:
        """Order the arm to brake within the limits, and return at once.

        From any thread, whether the event loop comes round or not; again and again does no harm.
        """
        ...

    async def recover(self) -> None:
        """Clear a fault; the arm stays where it is, and a `stop` stays."""
        ...
