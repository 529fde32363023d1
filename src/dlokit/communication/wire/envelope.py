"""What goes beside a message over the network: its schema, and when it was sent on which machine's clock."""

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
    """Read from beside a message."""

    schema: bytes
    machine: int
    """Whose clock `sent_ns` is on: monotonic clocks begin anew with each boot."""
    sent_ns: int
    """When it was sent, on the sender's monotonic clock."""

    def sent_s(self, arrived_s: float) -> float:
        """When it was sent on this machine's monotonic clock [s]; when it arrived, if another machine sent it."""
        return self.sent_ns * 1e-9 if self.machine == this_machine() else arrived_s

    def not_after(self, other: "Envelope | None") -> bool:
        """Whether it is known to have been sent no later than another one."""
        return other is not None and self.machine == other.machine and self.sent_ns <= other.sent_ns


def seal(schema: bytes) -> bytes:
    """The envelope of a message that is sent now."""
    return _LAYOUT.pack(schema, this_machine(), time.monotonic_ns())


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
