"""What goes beside a call and its answers over the network: a check sum, and what kind of answer it is."""

import enum

import msgspec

from dlokit.communication.envelope import check_sum

_CHECK_BYTES = 4


class Kind(enum.Enum):
    """What an answer is."""

    OUTCOME = b"o"
    PROGRESS = b"p"
    """The outcome is still to come."""
    ALTERED = b"a"
    """The call came altered, and was not run: it may be sent again."""


class Label(msgspec.Struct, frozen=True, gc=False):
    """Read from beside a call."""

    call_id: str
    check: int

    def fits(self, request: bytes) -> bool:
        """Whether the call is the one that was sent."""
        return check_sum(request) == self.check


def label_of(call_id: str, request: bytes) -> bytes:
    """What goes beside a call."""
    return check_sum(request).to_bytes(_CHECK_BYTES, "big") + call_id.encode()


def read_label(data: bytes) -> Label:
    """The label in what came beside a call."""
    return Label(data[_CHECK_BYTES:].decode(errors="replace"), int.from_bytes(data[:_CHECK_BYTES], "big"))


def mark_of(kind: Kind, answer: bytes) -> bytes:
    """What goes beside an answer."""
    return check_sum(answer).to_bytes(_CHECK_BYTES, "big") + kind.value


def read_mark(data: bytes, answer: bytes) -> Kind | None:
    """What kind of answer came; None for one that nobody can have sent so."""
    try:
        kind = Kind(data[_CHECK_BYTES:])
    except ValueError:
        return None
    if check_sum(answer) == int.from_bytes(data[:_CHECK_BYTES], "big"):
        return kind
    # Of a piece of progress there comes another; an outcome is asked for again.
    return Kind.ALTERED if kind is Kind.OUTCOME else None
