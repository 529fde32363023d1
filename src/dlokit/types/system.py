"""System messages: clock ticks, heartbeats, the viewer's address; and strategies on the bus."""

from dlokit.types.message import Message, Value


class ClockTick(Message, frozen=True, kw_only=True, eq=False):
    """A tick of the cell's clock; its ``stamp_ns`` is the cell's time."""

    real_time_factor: float = 1.0
    """Recent ratio of the cell's time to machine time."""


class Heartbeat(Message, frozen=True, kw_only=True, eq=False):
    """Heartbeat of the holder of the robots' leases: each one renews its leases for their full duration."""

    holder: str
    """Identity of the caller that holds the lease, as the robot knows it."""


class ViewerPage(Message, frozen=True, kw_only=True, eq=False):
    """Address of the viewer, published when it starts to serve the page."""

    url: str
    """URL for a browser on the viewer's machine; it contains the key that the viewer requires."""


class StrategySpec(Value, frozen=True, kw_only=True, eq=False):
    """A strategy's name with its encoded settings, which the component that runs it decodes."""

    name: str
    """Name under which its package registers it, e.g. ``"brightness"``."""
    settings: bytes = b"{}"
    """The settings as a JSON object; omitted settings have their defaults."""


class StrategyChosen(Message, frozen=True, kw_only=True, eq=False):
    """A component uses another strategy, or other settings, than before."""

    spec: StrategySpec


class StrategyProposal(Value, frozen=True, kw_only=True, eq=False):
    """Settings of a strategy that were found for the user, who may take them."""

    spec: StrategySpec | None
    """None: nothing is proposed."""
    text: str
    """What is proposed, or why nothing is, as a sentence."""
