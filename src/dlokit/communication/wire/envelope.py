"""The envelope that accompanies a message over the network: its schema, send time, and sending machine."""

import struct
import time
from functools import cache
from pathlib import Path

import msgspec

from dlokit.communication.wire.schema import FINGERPRINT_BYTES
from dlokit.errors import SchemaMismatch

_LAYOUT = struct.Struct(f"<{FINGERPRINT_BYTES}sQq")
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class Envelope(msgspec.Struct, frozen=True, gc=False):
    """Schema, send time and sending machine of one message."""

    schema: bytes
    machine: int
    """Boot id of the sending machine: monotonic clocks restart with each boot."""
    sent_ns: int
    """Send time on the sender's monotonic clock [ns]."""

    def sent_s(self, arrived_s: float) -> float:
        """Send time on this machine's monotonic clock [s], or `arrived_s` if another machine sent it."""
        return self.sent_ns * 1e-9 if self.machine == this_machine() else arrived_s

    def is_not_newer_than(self, other: "Envelope | None") -> bool:
        """Whether it is known to have been sent no later than another."""
        return other is not None and self.machine == other.machine and self.sent_ns <= other.sent_ns


def pack_envelope(schema: bytes) -> bytes:
    """Encode the envelope of a message that is sent now."""
    return _LAYOUT.pack(schema, this_machine(), time.monotonic_ns())


def unpack_envelope(envelope: bytes | None, schema: bytes) -> Envelope:
    """Decode an envelope. Raises `SchemaMismatch` when the sender's schema differs from the reader's `schema`."""
    if envelope is None or len(envelope) != _LAYOUT.size:
        raise SchemaMismatch("the message has no envelope with its schema; run the same version of dlokit on both ends")
    read = Envelope(*_LAYOUT.unpack(envelope))
    if read.schema != schema:
        raise mismatch(read.schema.hex(), schema)
    return read


def mismatch(theirs: str, ours: bytes) -> SchemaMismatch:
    """The error for a peer of another version; `theirs` is its fingerprint in hexadecimal digits."""
    return SchemaMismatch(
        f"the peer has schema {theirs or 'unnamed'}, this process has {ours.hex()}; "
        "run the same version of dlokit on both ends"
    )


@cache
def this_machine() -> int:
    """An id of this machine since its last boot."""
    try:
        return int(_BOOT_ID.read_text(encoding="ascii").replace("-", "")[:16], 16)
    except (OSError, ValueError):  # not Linux: an id that no other process has, so that ages count from the arrival
        return time.time_ns()
