"""Time, as the cell tells it."""

from dlokit.types.message import Message


class ClockTick(Message, frozen=True, kw_only=True, eq=False):
    """The cell's time is its ``stamp_ns``; components that live by its clock wait for these."""

    real_time_factor: float = 1.0
    """Cell seconds a machine second, lately."""
