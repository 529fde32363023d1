"""`check_robot`: whether the driver of an arm, simulated or real, keeps to its protocol; the arm moves slowly.

The check covers the whole path of a motion: a driver behind the gate (`GatedRobot`), or one that checks its motions
itself.
"""

import asyncio
from dataclasses import dataclass

from dlokit.extras.checks.checks import require_none
from dlokit.extras.checks.device_report import CheckedDevice
from dlokit.extras.checks.robot_checks import RATE_HZ, WANTED, Confirm, RobotUnderTest, SilenceablePulse, try_all
from dlokit.functional.robots.base import Robot


@dataclass(frozen=True, kw_only=True)
class RobotCheckReport:
    """Result for a robot that passed every tried check; attach it to a bug report."""

    arm: str
    facts: dict[str, str]
    timing: dict[str, str]
    passed: tuple[str, ...]
    """Names of the checks."""

    def __str__(self) -> str:
        known = "; ".join(f"{name}: {value}" for name, value in self.timing.items())
        return f"{self.arm}: {len(self.passed)} checks passed; {known}"


def check_robot(robot: Robot, *, rate_hz: float = RATE_HZ, pulse: SilenceablePulse | None = None) -> RobotCheckReport:
    """Try every requirement of the robot protocol on a robot that is not connected yet. **The arm moves.**

    A robot is a driver behind the gate, or one that checks its motions itself. `rate_hz` is the rate of its states;
    `pulse` the heartbeats with which it was built; without them the check of their end is skipped. Raises
    `CheckFailed` with the finding; after the first failed check nothing moves.
    """
    return asyncio.run(checked_robot(robot, rate_hz=rate_hz, pulse=pulse))


async def checked_robot(
    robot: Robot, *, rate_hz: float = RATE_HZ, pulse: SilenceablePulse | None = None
) -> RobotCheckReport:
    """As `check_robot`, for a robot that needs a running event loop."""
    checked = await examined_robot(robot, rate_hz=rate_hz, pulse=pulse)
    require_none(checked.what, checked.found)
    passed = tuple(name for name in WANTED if name not in checked.untried)
    return RobotCheckReport(arm=robot.arm.title, facts=dict(checked.facts), timing=dict(checked.timing), passed=passed)


async def examined_robot(
    robot: Robot,
    *,
    confirm: Confirm | None = None,
    rate_hz: float = RATE_HZ,
    pulse: SilenceablePulse | None = None,
    what: str = "",
) -> CheckedDevice:
    """As `checked_robot`, with all data for a report, whether the robot passes or not.

    `confirm` asks the operator before anything moves. Raises `StartNotConfirmed` at the first No.
    """
    tested = RobotUnderTest(robot=robot, confirm=confirm, rate_hz=rate_hz, pulse=pulse)
    await try_all(tested)
    failed = {finding.check for finding in tested.found}
    return CheckedDevice(
        what=what or f"robot {type(robot).__module__}:{type(robot).__qualname__}",
        wanted=WANTED,
        found=tested.found,
        untried=tuple(name for name in WANTED if name not in failed and name not in tested.tried),
        facts=tested.facts,
        timing=tested.timing,
    )
