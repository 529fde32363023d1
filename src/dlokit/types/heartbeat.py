"""The commander's sign of life."""

from dlokit.types.message import Message


class Heartbeat(Message, frozen=True, kw_only=True, eq=False):
    """The holder of the robots' leases is there: each of these keeps its leases for their duration from now on."""

    holder: str
    """Who says so, as the robot knows it: the caller that took the lease."""
