"""Heartbeats of the decision process that keep the robots' leases; the arms brake when they stop."""

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
from dlokit.types.robot import Lease
from dlokit.types.system import Heartbeat


@asynccontextmanager
async def leases_held(
    transport: Transport, clock: Clock, config: RobotConfig, arms: tuple[ArmMount, ...] = FIRST_ALONE
) -> AsyncGenerator[None]:
    """Hold the lease of every arm with heartbeats from a separate thread.

    `clock` is the run's, for their stamps. Raises `ProcessFailure` when an arm does not grant its lease.
    """
    lease = Lease(holder=transport.identity, duration_s=config.commander_lease_s)
    give = heartbeats(transport, clock)
    pulse = ThreadPulse()
    # Heartbeats start before the first lease is taken: taking the second may take longer than the first lasts.
    async with garbage_frozen(), pulse(give, lease.heartbeat_s):
        for mount in arms:
            taken = await transport.call(api.RENEW_LEASE.at(mount.instance), lease.holder, lease.duration_s)
            if not isinstance(taken, Succeeded):
                raise ProcessFailure("no_lease", f"the robot {mount.robot} does not take commands: {taken}")
        try:
            yield
        finally:
            for mount in arms:
                await transport.call(api.RELEASE_LEASE.at(mount.instance), transport.identity)


def heartbeats(transport: Transport, clock: Clock) -> Callable[[], None]:
    """A function that sends one heartbeat of this process, callable on any thread."""
    # The loop's clock can be read only on its own thread; with hardware it is the machine's clock.
    now_ns = clock.now_ns if isinstance(clock, FollowedClock) else time.monotonic_ns
    numbers = itertools.count(1)

    def give() -> None:
        heartbeat = Heartbeat(stamp_ns=now_ns(), seq=next(numbers), holder=transport.identity)
        transport.publish(topics.HEARTBEAT, heartbeat)

    return give
