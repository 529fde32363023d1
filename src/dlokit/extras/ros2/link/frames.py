"""Frames of the link between dlokit and the node in a ROS 2 workspace: a length, a JSON header, and raw CDR.

A frame is two unsigned 32-bit numbers, little-endian: the sizes of header and payload; then the header, a JSON object
in UTF-8 whose `kind` says which of the messages below it is; then the payload, the CDR bytes of one ROS message, or
nothing. The node (`ros/dlokit_ros`) has nothing but Python's standard library. Decoding executes nothing, and a frame
is refused by its sizes before anything is allocated for it.
"""

import asyncio
import struct

import msgspec

from dlokit.errors import CommunicationError

VERSION = 1
"""Version of the link; both sides must have the same."""
MOST_HEADER, MOST_PAYLOAD = 2**20, 2**26
"""Largest header, the graph of a lab with thousands of topics, and largest payload: a picture of 20 megapixels [bytes].
"""
_SIZES = struct.Struct("<II")


class _Header(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag=str.lower):
    """A header; fields that a newer node adds are ignored."""


class Hello(_Header, frozen=True, kw_only=True):
    """First frame of the node."""

    version: int
    distribution: str
    """Name of the ROS 2 distribution, e.g. ``jazzy``."""
    rmw: str
    """Name of the middleware, e.g. ``rmw_fastrtps_cpp``."""
    node: str
    """Full name of the node, e.g. ``/dlokit``."""
    package: str
    """Version of the package dlokit_ros."""
    hashes: dict[str, str]
    """Type hashes of its definitions by type; empty on Humble, which has none."""


class Time(_Header, frozen=True, kw_only=True):
    """Clocks of the node; once a second, also as its heartbeat."""

    ros_ns: int
    """ROS time [ns]: the machine's, or the simulation's where the node follows one."""
    monotonic_ns: int
    """Monotonic time of the machine at the same moment [ns]."""
    dropped: int = 0
    """Messages that dlokit did not read in time on this connection; the node has dropped them."""


class Endpoint(msgspec.Struct, frozen=True, kw_only=True):
    """A publisher or a subscription of a topic."""

    node: str
    """Full name of its node."""
    type: str
    reliable: bool
    transient_local: bool
    hash: str = ""
    """Its type hash; empty on Humble."""


class Graph(_Header, frozen=True, kw_only=True):
    """What the node sees of the ROS graph; once a second."""

    topics: dict[str, list[str]]
    """All topics that are published, with their types."""
    publishers: dict[str, list[Endpoint]]
    """Publishers of the topics to which the node subscribes for dlokit."""
    subscriptions: dict[str, list[Endpoint]]
    """Subscriptions to the topics that the node publishes for dlokit."""


class RosMessage(_Header, frozen=True, kw_only=True, tag="received"):
    """A ROS message, in the payload, that arrived at the node."""

    topic: str
    type: str
    arrived_ns: int
    """Time of its arrival on the machine's monotonic clock [ns]."""


class Lacks(_Header, frozen=True, kw_only=True):
    """The node cannot publish or subscribe to a topic."""

    topic: str
    why: str


class Welcome(_Header, frozen=True, kw_only=True):
    """Answer to `Hello`."""

    version: int
    dlokit: str
    """Version of dlokit."""


class Refused(_Header, frozen=True, kw_only=True):
    """Answer to a `Hello` that is not accepted; the link is closed after it."""

    why: str


class Beat(_Header, frozen=True, kw_only=True):
    """Heartbeat of dlokit with its clocks; once a second."""

    real_ns: int
    """Wall clock [ns since 1970]."""
    monotonic_ns: int


class Advertise(_Header, frozen=True, kw_only=True):
    """Publish a topic; its messages follow. Always reliable."""

    topic: str
    type: str
    transient_local: bool
    """Whether late subscribers get the last message."""
    depth: int = 1


class Subscribe(_Header, frozen=True, kw_only=True):
    """Forward a topic, with the reliability and durability that its publishers offer."""

    topic: str
    type: str
    depth: int = 10


class Publish(_Header, frozen=True, kw_only=True):
    """Publish the payload on an advertised topic."""

    topic: str


FromNode = Hello | Time | Graph | RosMessage | Lacks
ToNode = Welcome | Refused | Beat | Advertise | Subscribe | Publish
_DECODER = msgspec.json.Decoder(FromNode | ToNode)


def encode(header: FromNode | ToNode, payload: bytes = b"") -> bytes:
    """The bytes of a frame. Raises `CommunicationError` when it is too large."""
    encoded = msgspec.json.encode(header)
    _check(len(encoded), len(payload))
    return b"".join((_SIZES.pack(len(encoded), len(payload)), encoded, payload))


async def read(reader: asyncio.StreamReader) -> tuple[FromNode | ToNode, bytes]:
    """The next frame.

    Raises `CommunicationError` for one that is damaged or too large, `EOFError` where the other side has closed it.
    """
    try:
        sizes = _SIZES.unpack(await reader.readexactly(_SIZES.size))
        _check(*sizes)
        header, payload = await reader.readexactly(sizes[0]), await reader.readexactly(sizes[1])
    except asyncio.IncompleteReadError as error:
        raise EOFError("the other side has closed the link") from error
    try:
        return _DECODER.decode(header), payload
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as error:
        raise CommunicationError(f"a frame's header cannot be read: {error}") from error


def _check(header: int, payload: int) -> None:
    if not 0 < header <= MOST_HEADER or payload > MOST_PAYLOAD:
        raise CommunicationError(
            f"a frame has {header} bytes of header and {payload} of payload; allowed are {MOST_HEADER} and "
            f"{MOST_PAYLOAD}"
        )
