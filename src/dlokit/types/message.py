"""Base classes of messages and of the values inside them."""

import msgspec


class Value(msgspec.Struct, frozen=True, kw_only=True, eq=False, forbid_unknown_fields=True):
    """An immutable value inside messages and skill calls.

    Equality is identity: values hold arrays, whose comparison is not a truth value.
    """


class Message(Value, frozen=True, kw_only=True, eq=False):
    """Content of a topic: a value with a stamp, a frame and a sequence number."""

    stamp_ns: int
    """Time to which the content refers [ns], on the clock of the cell or the hardware."""
    frame: str = "world"
    """Frame of all fields that do not name their own."""
    seq: int = 0
    """Sequence number on the topic, from 1; set when the message is published."""
