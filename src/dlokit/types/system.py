"""What the system tells of itself: time, signs of life, where the page is; a strategy as it travels over the bus."""

from dlokit.types.message import Message, Value


class ClockTick(Message, frozen=True, kw_only=True, eq=False):
    """The cell's time is its ``stamp_ns``; components that live by its clock wait for these."""

    real_time_factor: float = 1.0
    """Cell seconds a machine second, lately."""


class Heartbeat(Message, frozen=True, kw_only=True, eq=False):
    """The holder of the robots' leases is there: each of these keeps its leases for their duration from now on."""

    holder: str
    """Who says so, as the robot knows it: the caller that took the lease."""


class ViewerPage(Message, frozen=True, kw_only=True, eq=False):
    """The page is served from now on."""

    url: str
    """As a browser on the viewer's machine opens it, with the key without which nothing is served."""


class StrategySpec(Value, frozen=True, kw_only=True, eq=False):
    """A strategy by its name, with its settings encoded; the component that has it decodes them."""

    name: str
    """As its package registers it, e.g. ``"brightness"``."""
    settings: bytes = b"{}"
    """The settings as a JSON object; what is left out has its default."""
