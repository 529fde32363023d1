"""`check_robot`: whether the driver of an arm, simulated or real, keeps to its protocol; the arm moves slowly.

The check covers the whole path of a motion: the driver behind the gate (`GatedRobot`), as in a run.
"""

import asyncio
import time
from dataclasses import dataclass

from dlokit.communication.timing.deadlines import ThreadWatchdog
from dlokit.communication.timing.pulse import ThreadPulse
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.errors import BadValue
from dlokit.extras.checks.checks import require_none
from dlokit.extras.checks.device_report import CheckedDevice
from dlokit.extras.checks.new_process import BuildRobot, driver_port, latched_in_new_process, sent
from dlokit.extras.checks.robot_checks import (
    RATE_HZ,
    WANTED,
    Confirm,
    LatchSeen,
    RobotUnderTest,
    SilenceablePulse,
    try_all,
)
from dlokit.functional.robots.base import Robot
from dlokit.functional.robots.gate import GateConfig, GatedRobot


@dataclass(frozen=True, kw_only=True)
class RobotCheckReport:
    """Result for a robot that passed every check; attach it to a bug report."""

    arm: str
    facts: dict[str, str]
    timing: dict[str, str]
    passed: tuple[str, ...]
    """Names of the checks."""

    def __str__(self) -> str:
        known = "; ".join(f"{name}: {value}" for name, value in self.timing.items())
        return f"{self.arm}: {len(self.passed)} checks passed; {known}"


def check_robot(build: BuildRobot, mount: ArmMount = FIRST_ALONE[0], *, rate_hz: float = RATE_HZ) -> RobotCheckReport:
    """Try every requirement of the robot protocol on the driver that `build` makes. **The arm moves.**

    `build` is called as `build(port, mount, pulse)`, as that of the driver's settings, e.g. `MyArmConfig().build`; a
    new process calls it again. `mount` is the arm, by default a Panda at the world's origin. `rate_hz` is the rate of
    the driver's states. Raises `CheckFailed` with the finding; after the first failed check nothing moves. Raises
    `BadValue` where `build` makes no robot, or a new process cannot import it.
    """
    checked = asyncio.run(examined_driver(build, mount, rate_hz=rate_hz))
    require_none(checked.what, checked.found)
    return RobotCheckReport(
        arm=mount.model.title, facts=dict(checked.facts), timing=dict(checked.timing), passed=tuple(WANTED)
    )


async def examined_driver(
    build: BuildRobot, mount: ArmMount, *, confirm: Confirm | None = None, rate_hz: float = RATE_HZ
) -> CheckedDevice:
    """As `check_robot`, with all data for a report, whether the driver passes or not.

    `confirm` asks the operator before anything moves. Raises `StartNotConfirmed` at the first No.
    """
    sent_driver = sent(build, mount)
    pulse = SilenceablePulse(ThreadPulse())
    driver = build(driver_port(), mount, pulse)
    missing = [name for name in _MEMBERS if not hasattr(driver, name)]
    if missing:
        raise BadValue(
            f"{build!r} made a {type(driver).__name__}, which is no robot: it lacks {', '.join(missing)}. "
            "dlokit.functional.robots.base describes the protocol."
        )
    gated = GatedRobot(
        driver,
        GateConfig(),
        time.monotonic_ns,
        T_world_base=mount.T_world_base,
        workspace=mount.workspace,
        watch=ThreadWatchdog(),
    )

    async def latch_seen() -> bool:
        return await latched_in_new_process(sent_driver)

    what = f"robot {type(driver).__module__}:{type(driver).__qualname__}, behind the gate"
    return await examined_robot(gated, pulse=pulse, latch_seen=latch_seen, confirm=confirm, rate_hz=rate_hz, what=what)


async def examined_robot(
    robot: Robot,
    *,
    pulse: SilenceablePulse,
    latch_seen: LatchSeen,
    confirm: Confirm | None = None,
    rate_hz: float = RATE_HZ,
    what: str = "",
) -> CheckedDevice:
    """As `examined_driver`, for a robot that was built with `pulse`; `latch_seen` is called while it is stopped."""
    tested = RobotUnderTest(robot=robot, confirm=confirm, rate_hz=rate_hz, pulse=pulse, latch_seen=latch_seen)
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


_MEMBERS = ("__aenter__", "__aexit__", *(name for name in vars(Robot) if not name.startswith("_")))
