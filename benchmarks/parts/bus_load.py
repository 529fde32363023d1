"""What is sent: messages of given sizes over our bus, and the same numbers of bytes over the bare ones."""

import struct
import time

import msgspec
import numpy as np
import zenoh

from dlokit.communication.skill import Skill
from dlokit.communication.timing.urgency import threads_urgent
from dlokit.communication.topic import KeepLast, Topic
from dlokit.communication.wire import codec
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.types.arrays import Float32Array
from dlokit.types.message import Message

SIZES_BYTES = (200, 2_000, 24_000, 400_000, 4_000_000)
"""A robot's state, a DLO's state, a cloud, a picture, a pair of large pictures."""

NEAR, FAR = "near", "far"
_STAMP = struct.Struct("<q")


class Load(Message, frozen=True, kw_only=True, eq=False):
    """A message of some size; its stamp is the machine's monotonic clock when it was handed over."""

    body: Float32Array
    """(N,)"""


class BusPlan(msgspec.Struct, frozen=True, kw_only=True):
    """What the process at the far end needs to know."""

    bus: ZenohConfig
    """How the far end joins our bus."""
    bare_endpoint: str
    """Where bare zenoh does."""
    pushes: str = ""
    """Endpoint of pyzmq's messages; empty: without pyzmq."""
    answers: str = ""
    """Endpoint of pyzmq's calls."""
    sizes: tuple[int, ...] = SIZES_BYTES


class Delay(msgspec.Struct, frozen=True, kw_only=True):
    """How long one message was under way."""

    method: str
    size: int
    seconds: float


def topic_of(size: int) -> Topic[Load]:
    """The topic for messages of a size."""
    return Topic(f"bench/{size}", Load, "near", None, KeepLast(), "messages of one size")


SLOW_SIZE = 24_000
FAST = Topic("bench/fast", Load, NEAR, 100.0, KeepLast(), "for a reader that is slower")


def body_of(size: int) -> Float32Array:
    """An array with which a message has about `size` bytes on the wire."""
    empty = len(codec.encode(Load(stamp_ns=time.monotonic_ns(), body=np.zeros(0, dtype=np.float32))))
    return np.zeros(max(1, (size - empty) // 4), dtype=np.float32)


def load_now(body: Float32Array) -> Load:
    """A message handed over now."""
    return Load(stamp_ns=time.monotonic_ns(), body=body)


def stamped(buffer: bytearray) -> bytearray:
    """The bytes of a bare message, handed over now; the buffer is used again and again."""
    _STAMP.pack_into(buffer, 0, time.monotonic_ns())
    return buffer


def since_stamp(data: bytes) -> float:
    """Time since a bare message was handed over [s]."""
    return (time.monotonic_ns() - _STAMP.unpack_from(data)[0]) * 1e-9


def since_load(load: Load) -> float:
    """Time since a message was handed over [s]."""
    return (time.monotonic_ns() - load.stamp_ns) * 1e-9


def bare_session(*, listen: tuple[str, ...] = (), connect: tuple[str, ...] = ()) -> zenoh.Session:
    """Zenoh as it comes, but for where it meets, and for the priority of its threads: like our bus."""
    settings = zenoh.Config()
    values = {
        "listen/endpoints": listen,
        "connect/endpoints": connect,
        "connect/exit_on_failure": False,
        "scouting/multicast/enabled": False,
    }
    for key, value in values.items():
        settings.insert_json5(key, msgspec.json.encode(value).decode())
    with threads_urgent():
        return zenoh.open(settings)


def _take(load: Load) -> int:
    """Number of values in it."""
    ...


TAKE = Skill(FAR, "take", _take, timeout_s=10.0)
