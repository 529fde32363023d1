"""A peer without the key of a run, of this user or of another: it claims to be the commander of the arm.

Arguments: the user's id, the namespace, the commander's name, and the sockets. Prints what it reached, as JSON.
"""

import asyncio
import json
import os
import sys
import time
from collections.abc import Iterable

from dlokit.communication import topics
from dlokit.communication.zenoh.session import Login, ZenohConfig, open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import MachineError
from dlokit.skills.robot import api
from dlokit.types.system import Heartbeat

NOBODY = 65534
"""A user that owns nothing."""
BEATS_FOR_S = 1.5
EVERY_S = 0.02
REFUSED = {"joined": [], "outcomes": ["Unreachable"] * 3}
"""What a peer prints that reached nothing."""


def command(user: int, namespace: str, commander: str, endpoints: Iterable[str]) -> tuple[str, ...]:
    """The command of such a peer."""
    return (sys.executable, __file__, str(user), namespace, commander, *endpoints)


def joined(namespace: str, endpoint: str, login: Login | None) -> bool:
    """Whether a session was opened."""
    try:
        session = open_session(ZenohConfig(namespace=namespace, connect=(endpoint,), login=login, connect_within_s=0.3))
    except MachineError:
        return False
    session.close()
    return True


async def forge(namespace: str, commander: str, endpoints: tuple[str, ...], for_s: float = BEATS_FOR_S) -> list[str]:
    """Send heartbeats and calls in the commander's name, while connecting again and again; the calls' outcomes."""
    transport = ZenohTransport(ZenohConfig(namespace=namespace, connect=endpoints))
    transport.identity = commander
    end_s = time.monotonic() + for_s
    while True:
        transport.publish(topics.HEARTBEAT, Heartbeat(stamp_ns=1, holder=commander))
        if time.monotonic() >= end_s:
            break
        await asyncio.sleep(EVERY_S)
    outcomes = [
        await transport.call(api.RENEW_LEASE, commander, api.LONGEST_LEASE_S),
        await transport.call(api.RELEASE_LEASE, commander),
        await transport.call(api.HOME),
    ]
    await transport.close()
    return [type(outcome).__name__ for outcome in outcomes]


def main(user: int, namespace: str, commander: str, *endpoints: str) -> None:
    """Try each endpoint without a key and with a wrong one, then forge."""
    if user != os.getuid():
        asyncio.run(forge(namespace, commander, (), 0.0))  # loads what the other user may not read
        os.setgroups([])
        os.setgid(user)
        os.setuid(user)
    logins = (None, Login(user="dlokit", password="guessed"))
    found = [endpoint for endpoint in endpoints for login in logins if joined(namespace, endpoint, login)]
    outcomes = asyncio.run(forge(namespace, commander, endpoints))
    print(json.dumps({"joined": found, "outcomes": outcomes}))


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
