"""Message definitions of ROS 2 distributions: CDR bytes to messages and back, without ROS, by `rosbags`."""

from __future__ import annotations

import importlib
import struct
from functools import cache
from typing import Any

from dlokit.errors import CommunicationError, ConfigError, MachineError, install_command

DISTRIBUTIONS = ("humble", "jazzy", "kilted", "lyrical")
"""Distributions whose definitions `rosbags` has; dlokit was run with jazzy and kilted."""

_BIG_ENDIAN, _LITTLE_ENDIAN, _ENCAPSULATION = b"\x00\x00", b"\x00\x01", 4


class Definitions:
    """The message definitions of one distribution."""

    def __init__(self, distribution: str) -> None:
        """Raises `ConfigError` for an unknown distribution, `MachineError` where `rosbags` is not installed."""
        if distribution not in DISTRIBUTIONS:
            raise ConfigError(
                f"the ROS 2 distribution {distribution!r} is not known; known are {', '.join(DISTRIBUTIONS)}."
            )
        typesys = rosbags_part("rosbags.typesys")
        self.distribution = distribution
        self._errors = (rosbags_part("rosbags.serde.errors").SerdeError, struct.error, UnicodeError, ValueError)
        self._store: Any = typesys.get_typestore(typesys.Stores(f"ros2_{distribution}"))

    def knows(self, kind: str) -> bool:
        """Whether there is a definition of the type, e.g. ``sensor_msgs/msg/Image``."""
        return kind in self._store.fielddefs

    def hash_of(self, kind: str) -> str:
        """The type hash (REP 2016) that nodes of the distribution announce for the type."""
        return str(self._store.hash_rihs01(kind))

    def text_of(self, kind: str) -> str:
        """The definition of the type with those of its fields, as bags contain it."""
        return str(self._store.generate_msgdef(kind, ros_version=2)[0])

    def agrees(self, kind: str, definition: str) -> bool:
        """Whether a definition of a type, as a bag carries it in the form of .msg files, has the fields of this one.

        Nothing of it is executed. Raises `CommunicationError` where it cannot be read.
        """
        try:
            found = rosbags_part("rosbags.typesys").get_types_from_msg(definition, kind)
        except (rosbags_part("rosbags.typesys").TypesysError, *self._errors) as error:
            raise CommunicationError(f"the definition of {kind} cannot be read: {error}") from error
        return all(self.knows(name) and self._store.fielddefs[name][1] == fields for name, (_, fields) in found.items())

    def make(self, kind: str, **fields: Any) -> Any:
        """A message of a type from all its fields; arrays are NumPy arrays."""
        return self._store.types[kind](**fields)

    def encode(self, kind: str, message: Any) -> bytes:
        """The CDR bytes of a message, with their encapsulation header."""
        return bytes(self._store.serialize_cdr(message, kind))

    def decode(self, kind: str, cdr: bytes) -> Any:
        """The message in CDR bytes; its arrays are views of the bytes. Raises `CommunicationError`.

        Bytes after its end are ignored: `rclpy.serialization.serialize_message` leaves some behind empty arrays, which
        `deserialize_cdr` of rosbags refuses.
        """
        if (order := bytes(cdr[:2])) not in (_BIG_ENDIAN, _LITTLE_ENDIAN) or len(cdr) < _ENCAPSULATION:
            raise CommunicationError(f"{len(cdr)} bytes are not a message {kind}: they do not begin as CDR does")
        try:
            definition = self._store.get_msgdef(kind)
            read = definition.deserialize_cdr_le if order == _LITTLE_ENDIAN else definition.deserialize_cdr_be
            return read(cdr[_ENCAPSULATION:], 0, definition.cls, self._store)[0]
        except self._errors as error:
            raise CommunicationError(f"{len(cdr)} bytes are not a message {kind}: {error}") from error

    def cdr_of_ros1(self, kind: str, data: bytes) -> bytes:
        """A message of ROS 1 as CDR bytes of the same fields, in whose header ROS 2 has no `seq`.

        Damaged bytes give no bytes, which no message is.
        """
        try:
            return bytes(self._store.ros1_to_cdr(data, kind))
        except (*self._errors, AssertionError, IndexError, KeyError):
            return b""


@cache
def definitions_of(distribution: str) -> Definitions:
    """The definitions of a distribution, read once. Raises as `Definitions`."""
    return Definitions(distribution)


def rosbags_part(module: str) -> Any:
    """A module of `rosbags`. Raises `MachineError` where it is not installed."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise MachineError(f"ROS 2 needs rosbags, which is not installed: {install_command('ros2')}") from error
