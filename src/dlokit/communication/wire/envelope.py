"""What goes beside a message, a call or an answer over the network: its schema, when it was sent, a check sum."""

import enum
import struct
import time
from functools import cache
from pathlib import Path

import msgspec
import xxhash

from dlokit.communication.wire.schema import FINGERPRINT_BYTES
from dlokit.errors import CommunicationError, SchemaMismatch

_LAYOUT = struct.Struct(f"<{FINGERPRINT_BYTES}sQqQ")
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class Envelope(msgspec.Struct, frozen=True, gc=False):
    """Read from beside a message."""

    schema: bytes
    machine: int
    """Whose clock `sent_ns` is on: monotonic clocks begin anew with each boot."""
    sent_ns: int
    """When it was sent, on the sender's monotonic clock."""
    check: int
    """Of the message."""

    def sent_s(self, arrived_s: float) -> float:
        """When it was sent on this machine's monotonic clock [s]; when it arrived, if another machine sent it."""
        return self.sent_ns * 1e-9 if self.machine == this_machine() else arrived_s

    def require_unaltered(self, message: bytes) -> None:
        """Raise `CommunicationError` when a message is not the one that was sent."""
        if check_sum(message) != self.check:
            raise CommunicationError("it was altered on its way, its check sum does not fit; look for a faulty network")

    def not_after(self, other: "Envelope | None") -> bool:
        """Whether it is known to have been sent no later than another one."""
        return other is not None and self.machine == other.machine and self.sent_ns <= other.sent_ns


def seal(schema: bytes, message: bytes | bytearray) -> bytes:
    """The envelope of a message that is sent now."""
    return _LAYOUT.pack(schema, this_machine(), time.monotonic_ns(), check_sum(message))


def check_sum(message: bytes | bytearray) -> int:
    """XXH3, 64 bits: a tenth of the time in which memory is copied, so that pictures have one as well."""
    return xxhash.xxh3_64_intdigest(message)


def opened(envelope: bytes | None, schema: bytes) -> Envelope:
    """What an envelope says. Raises `SchemaMismatch` when the message is not what the reader knows under its name."""
    if envelope is None or len(envelope) != _LAYOUT.size:
        raise SchemaMismatch("it does not say in which schema it was written; this version reads only its own")
    read = Envelope(*_LAYOUT.unpack(envelope))
    if read.schema != schema:
        raise mismatch(read.schema.hex(), schema)
    return read


def mismatch(theirs: str, ours: bytes) -> SchemaMismatch:
    """The error for a peer of another version; `theirs` in hexadecimal digits."""
    return SchemaMismatch(
        f"schema {theirs or 'unnamed'} there, {ours.hex()} here; run the same version of dlokit on both ends"
    )


@cache
def this_machine() -> int:
    """A number of this machine since it was booted."""
    try:
        return int(_BOOT_ID.read_text(encoding="ascii").replace("-", "")[:16], 16)
    except (OSError, ValueError):  # not a Linux: nobody else's number, so that ages count from the arrival
        return time.time_ns()


_CHECK = struct.Struct(">Q")
_MARK = struct.Struct(">Q1s")


class AnswerKind(enum.Enum):
    """What an answer is."""

    OUTCOME = b"o"
    PROGRESS = b"p"
    """The outcome is still to come."""
    ALTERED = b"a"
    """The call came altered, and was not run: it may be sent again."""


_KINDS = {kind.value: kind for kind in AnswerKind}


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


def mark_of(kind: AnswerKind, answer: bytes) -> bytes:
    """What goes beside an answer."""
    return _MARK.pack(check_sum(answer), kind.value)


def read_mark(data: bytes, answer: bytes) -> AnswerKind | None:
    """What kind of answer came; None for one that nobody can have sent so."""
    if len(data) != _MARK.size:
        return None
    check, value = _MARK.unpack(data)
    kind = _KINDS.get(value)
    if check == check_sum(answer):
        return kind
    # Of a piece of progress there comes another; an outcome is asked for again.
    return AnswerKind.ALTERED if kind is AnswerKind.OUTCOME else None
