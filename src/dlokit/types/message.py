"""What every message and every value inside one has in common."""

import msgspec


class Value(msgspec.Struct, frozen=True, kw_only=True, eq=False, forbid_unknown_fields=True):
    """An immutable value inside messages and skill calls.

    Equality is identity: values hold arrays, whose comparison is not a truth value.
    """


class Message(Value, frozen=True, kw_only=True, eq=False):
    """What a topic carries: a value with a stamp, a frame and a sequence number."""

    stamp_ns: int
    """Time of what the message speaks of [ns], on the clock of the cell or the hardware."""
    frame: str = "world"
    """Frame of everything in it that does not name its own."""
    seq: int = 0
    """Number of this message on its topic, counted from 1; set when it is published."""
