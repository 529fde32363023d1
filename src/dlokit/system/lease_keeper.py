"""The decision process holds the robot's lease: while it lives, it renews; when it is gone, the arm brakes."""

import asyncio
import logging
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from dlokit.communication.transport import Transport
from dlokit.description.arms import FIRST_ALONE, ArmMount
from dlokit.errors import ProcessFailure
from dlokit.skills.robot import api
from dlokit.system.tasks import end_tasks
from dlokit.types.outcome import Succeeded

log = logging.getLogger(__name__)

RENEWALS_A_LEASE = 5
"""One that comes late, or is lost, stops no arm."""


@asynccontextmanager
async def lease_held(
    transport: Transport, lease_s: float, arms: tuple[ArmMount, ...] = FIRST_ALONE
) -> AsyncGenerator[None]:
    """Hold the lease of every arm meanwhile, `lease_s` at a time. Raises `ProcessFailure` when one does not give it."""
    for mount in arms:
        taken = await transport.call(api.RENEW_LEASE.at(mount.instance), transport.identity, lease_s)
        if not isinstance(taken, Succeeded):
            raise ProcessFailure("no_lease", f"the robot {mount.robot} does not take commands: {taken}")
    renewing = [asyncio.create_task(_renew(transport, mount, lease_s), name="renew the lease") for mount in arms]
    try:
        yield
    finally:
        await end_tasks(*renewing)
        for mount in arms:
            await transport.call(api.RELEASE_LEASE.at(mount.instance), transport.identity)


async def _renew(transport: Transport, mount: ArmMount, lease_s: float) -> None:
    while True:
        # On the machine's clock, as the lease itself: a slow cell is no reason to brake.
        await asyncio.sleep(lease_s / RENEWALS_A_LEASE)
        outcome = await transport.call(api.RENEW_LEASE.at(mount.instance), transport.identity, lease_s)
        if not isinstance(outcome, Succeeded):
            log.warning("the lease of the robot %s was not renewed: %s", mount.robot, outcome)
