"""The decision process holds the robots' leases: while it lives, it says so; when it is gone, the arms brake."""

import itertools
import time
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager

from dlokit.communication import topics
from dlokit.communication.timing.clock import Clock, FollowedClock
from dlokit.communication.timing.pulse import ThreadPulse
from dlokit.communication.timing.urgency import garbage_frozen
from dlokit.communication.transport import Transport
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.errors import ProcessFailure
from dlokit.skills.robot import api
from dlokit.skills.robot.config import RobotConfig
from dlokit.types.outcome import Succeeded
from dlokit.types.system import Heartbeat

HEARTBEATS_A_LEASE = 5
"""One that comes late, or is lost, stops no arm."""


@asynccontextmanager
async def leases_held(
    transport: Transport, clock: Clock, config: RobotConfig, arms: tuple[ArmMount, ...] = FIRST_ALONE
) -> AsyncGenerator[None]:
    """Hold the lease of every arm meanwhile, by heartbeats that come from a thread of their own.

    `clock` is the run's, for their stamps. Raises `ProcessFailure` when an arm does not give its lease.
    """
    give = heartbeats(transport, clock)
    pulse = ThreadPulse()
    # It beats before the first lease is taken: taking the second one may take longer than the first one lasts.
    async with garbage_frozen(), pulse(give, config.commander_lease_s / HEARTBEATS_A_LEASE):
        for mount in arms:
            taken = await transport.call(
                api.RENEW_LEASE.at(mount.instance), transport.identity, config.commander_lease_s
            )
            if not isinstance(taken, Succeeded):
                raise ProcessFailure("no_lease", f"the robot {mount.robot} does not take commands: {taken}")
        try:
            yield
        finally:
            for mount in arms:
                await transport.call(api.RELEASE_LEASE.at(mount.instance), transport.identity)


def heartbeats(transport: Transport, clock: Clock) -> Callable[[], None]:
    """What gives one heartbeat of this process, on whichever thread it is called."""
    # The loop's clock can be read on its own thread alone; with hardware it is the machine's.
    now_ns = clock.now_ns if isinstance(clock, FollowedClock) else time.monotonic_ns
    numbers = itertools.count(1)

    def give() -> None:
        heartbeat = Heartbeat(stamp_ns=now_ns(), seq=next(numbers), holder=transport.identity)
        transport.publish(topics.HEARTBEAT, heartbeat)

    return give
