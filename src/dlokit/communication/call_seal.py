"""What goes beside a call and its answers over the network: a check sum, and what kind of answer it is."""

import enum
import struct

import msgspec

from dlokit.communication.envelope import check_sum

_CHECK = struct.Struct(">Q")
_MARK = struct.Struct(">Q1s")


class Kind(enum.Enum):
    """What an answer is."""

    OUTCOME = b"o"
    PROGRESS = b"p"
    """The outcome is still to come."""
    ALTERED = b"a"
    """The call came altered, and was not run: it may be sent again."""


_KINDS = {kind.value: kind for kind in Kind}


class Label(msgspec.Struct, frozen=True, gc=False):
    """Read from beside a call."""

    call_id: str
    check: int

    def fits(self, request: bytes) -> bool:
        """Whether the call is the one that was sent."""
        return check_sum(request) == self.check


def label_of(call_id: str, request: bytes) -> bytes:
    """What goes beside a call."""
    return _CHECK.pack(check_sum(request)) + call_id.encode()


def read_label(data: bytes) -> Label:
    """The label in what came beside a call."""
    return Label(data[_CHECK.size :].decode(errors="replace"), int.from_bytes(data[: _CHECK.size], "big"))


def mark_of(kind: Kind, answer: bytes) -> bytes:
    """What goes beside an answer."""
    return _MARK.pack(check_sum(answer), kind.value)


def read_mark(data: bytes, answer: bytes) -> Kind | None:
    """What kind of answer came; None for one that nobody can have sent so."""
    if len(data) != _MARK.size:
        return None
    check, value = _MARK.unpack(data)
    kind = _KINDS.get(value)
    if check == check_sum(answer):
        return kind
    # Of a piece of progress there comes another; an outcome is asked for again.
    return Kind.ALTERED if kind is Kind.OUTCOME else None
