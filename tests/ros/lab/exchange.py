"""How the programs of the lab speak with the test that runs them; without dlokit, in an environment of ROS 2.

Orders come on standard input as frames: two unsigned 32-bit numbers, little-endian, the sizes of header and payload;
then the header, a JSON object whose `kind` names the order, and the payload. Answers are JSON objects on standard
output, one a line, whose `kind` says what they are. The end of the input ends the program.
"""

import hashlib
import importlib
import json
import struct
import sys
import threading

import numpy as np
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

MOST_SHOWN = 64
"""Numbers of an array that are told as they are; a longer array is told by its length and its hash."""
_sizes = struct.Struct("<II")
_line = threading.Lock()


def orders():
    """The orders from standard input with their payloads, until its end."""
    while len(sizes := sys.stdin.buffer.read(_sizes.size)) == _sizes.size:
        header, payload = (sys.stdin.buffer.read(size) for size in _sizes.unpack(sizes))
        yield json.loads(header), payload


def say(kind, **fields):
    """Write an answer."""
    with _line:
        print(json.dumps({"kind": kind, **fields}), flush=True)


def interface(name):
    """The class of ``package/msg/Name`` or ``package/srv/Name``."""
    package, folder, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.{folder}"), kind)


def qos(order):
    """The QoS of an order: `reliable`, `transient_local` and `depth`."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=order.get("depth", 10),
        reliability=ReliabilityPolicy.RELIABLE if order.get("reliable", True) else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if order.get("transient_local") else DurabilityPolicy.VOLATILE,
    )


def stamp_ns(message):
    """The stamp of a message's header, or of its first element that has one [ns]; None without any."""
    for name in ("header", "transforms", "markers", "status"):
        part = getattr(message, name, None)
        part = part[0] if isinstance(part, list) and part else part
        header = getattr(part, "header", part)
        if hasattr(header, "stamp"):
            return header.stamp.sec * 10**9 + header.stamp.nanosec
    return None


def told(value):
    """A message, or a value in it, as JSON; long arrays by length and SHA-256 of their little-endian bytes."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: told(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):  # the type `byte`, whose arrays are lists of it
        return value[0]
    if not isinstance(value, (list, tuple, str, bool, int, float)):  # array.array, ndarray
        value = np.asarray(value)
    if isinstance(value, np.ndarray):
        if value.size > MOST_SHOWN:
            return {"length": int(value.size), "sha256": hashlib.sha256(value.tobytes()).hexdigest()}
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [told(one) for one in value]
    return value
