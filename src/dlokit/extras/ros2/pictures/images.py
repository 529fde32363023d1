"""Messages with pictures as arrays: colours, depths, point clouds, and the calibrations beside them.

Messages are those of `Definitions.decode`; `topic` names them in errors. Every function raises `HardwareError`: what
was found, what is taken, what to do.
"""

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from dlokit.errors import HardwareError
from dlokit.extras.ros2.link.frames import MOST_PAYLOAD
from dlokit.types.arrays import Float32Array, UInt8Array

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"

_COLOURS: dict[str, tuple[int, int | None]] = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
}
"""Encodings of colour pictures: number of channels, and OpenCV's conversion to RGB."""
_STEPS = ("16UC1", "mono16")
_METRES = "32FC1"
_STEPS_PER_M = np.float32(1000.0)
_MOST_PIXELS = MOST_PAYLOAD // 3
"""Largest compressed picture, as large as a raw one may be [px]: a small file can announce a huge picture."""
_QUANTISED = struct.Struct("<iff")
"""Header of `compressedDepth`: the format, and the parameters a and b of ``depth = a / (step - b)``."""


def is_colour(message: Any) -> bool:
    """Whether `colour_of` takes an Image or a CompressedImage, by its encoding."""
    if message.__msgtype__ == COMPRESSED:
        return not is_depth(message)
    return message.encoding in _COLOURS


def is_depth(message: Any) -> bool:
    """Whether `depth_of` takes an Image or a CompressedImage, by its encoding."""
    encoding = message.format.partition(";")[0].strip() if message.__msgtype__ == COMPRESSED else message.encoding
    return encoding in (*_STEPS, _METRES)


def colour_of(message: Any, topic: str) -> UInt8Array:
    """The pixels (height, width, 3) RGB of an Image or a CompressedImage; a view of the message where possible."""
    if message.__msgtype__ == COMPRESSED:
        return _decompressed_colour(message, topic)
    if message.encoding not in _COLOURS:
        raise HardwareError(
            f"the pictures of {topic} have the encoding {message.encoding!r}; taken are {', '.join(_COLOURS)}: set one "
            "of them in the camera's driver, or convert the pictures (image_proc)"
        )
    channels, conversion = _COLOURS[message.encoding]
    pixels = _rows(message, np.dtype(np.uint8), channels, topic)
    if conversion is None:
        return np.ascontiguousarray(pixels)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), conversion), dtype=np.uint8)


def depth_of(message: Any, topic: str) -> Float32Array:
    """The depths (height, width) [m] of an Image or a CompressedImage; 0 where unknown."""
    if message.__msgtype__ == COMPRESSED:
        return _decompressed_depth(message, topic)
    if message.encoding in _STEPS:
        return _of_steps(_rows(message, np.dtype(np.uint16), 1, topic))
    if message.encoding == _METRES:
        return _known(_rows(message, np.dtype(np.float32), 1, topic))
    raise HardwareError(
        f"the depths of {topic} have the encoding {message.encoding!r}; taken are 16UC1 and mono16 in millimetres and "
        "32FC1 in metres: set one of them in the camera's driver, or convert them (depth_image_proc)"
    )


def _rows(message: Any, dtype: np.dtype[Any], channels: int, topic: str) -> NDArray[Any]:
    """The pixels (height, width) or (height, width, channels) of an Image, without the padding of its rows."""
    height, width, step = message.height, message.width, message.step
    row = width * channels * dtype.itemsize
    if height == 0 or row == 0 or step < row or len(message.data) < height * step:
        raise HardwareError(
            f"a picture of {topic} is damaged: {len(message.data)} bytes in rows of {step} are no {width} by {height} "
            f"px of {message.encoding}, which need rows of {row} bytes or more"
        )
    data = np.asarray(message.data, dtype=np.uint8)[: height * step].reshape(height, step)[:, :row]
    values = data.view(dtype.newbyteorder(">" if message.is_bigendian else "<"))
    return values if channels == 1 else values.reshape(height, width, channels)


def _of_steps(steps: NDArray[Any]) -> Float32Array:
    """Depths [m] of whole millimetres."""
    return np.divide(steps, _STEPS_PER_M, dtype=np.float32)


def _known(depth_m: NDArray[np.float32]) -> Float32Array:
    """Depths [m] with 0 where they are not finite or not positive."""
    known = (depth_m > 0.0) & (depth_m < np.inf)  # NaN is neither
    return np.where(known, depth_m, np.float32(0.0)).astype(np.float32, copy=False)


def _decompressed_colour(message: Any, topic: str) -> UInt8Array:
    if "compressedDepth" in message.format:
        raise HardwareError(
            f"{topic} has compressed depths ({message.format!r}), and colours are needed: name the colour camera's "
            "topic, or this one with --camera.depth"
        )
    # Its writer has taken RGB for OpenCV's BGR; what decodes it here takes it back.
    swapped = "compressed rgb" in message.format
    order = cv2.IMREAD_COLOR_BGR if swapped else cv2.IMREAD_COLOR_RGB
    picture = _decompressed(message.data, order | cv2.IMREAD_IGNORE_ORIENTATION, topic, message.format)
    return np.asarray(picture, dtype=np.uint8)


def _decompressed_depth(message: Any, topic: str) -> Float32Array:
    encoding, _, compression = (part.strip() for part in message.format.partition(";"))
    if "compressedDepth" not in compression:
        return _of_steps(_steps_of(message.data, topic, message.format))
    # Writers before Iron name no compression; they have PNG alone.
    if encoding not in (*_STEPS, _METRES) or compression.split()[-1] not in ("png", "compressedDepth"):
        raise HardwareError(
            f"the depths of {topic} are {message.format!r}; taken is PNG of 16UC1 or 32FC1: set the publisher's "
            "parameter compressedDepth.format to png, or name the topic without /compressedDepth"
        )
    if len(message.data) <= _QUANTISED.size:
        raise _undecodable(topic, message.format)
    _, a, b = _QUANTISED.unpack(bytes(message.data[: _QUANTISED.size]))
    steps = _steps_of(message.data[_QUANTISED.size :], topic, message.format)
    if encoding != _METRES:
        return _of_steps(steps)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = np.float32(a) / (steps.astype(np.float32) - np.float32(b))
    return _known(np.where(steps > 0, depth_m, np.float32(0.0)))


def _steps_of(data: Any, topic: str, form: str) -> NDArray[np.uint16]:
    steps = _decompressed(data, cv2.IMREAD_UNCHANGED, topic, form)
    if steps.dtype != np.uint16 or steps.ndim != 2:
        raise HardwareError(
            f"the depths of {topic} ({form!r}) decompress to {steps.shape} of {steps.dtype}; taken is PNG of one "
            "channel of 16 bits: name the topic that ends in /compressedDepth, or the one without compression"
        )
    return steps


def _decompressed(data: Any, how: int, topic: str, form: str) -> NDArray[Any]:
    encoded = np.asarray(data, dtype=np.uint8)
    height, width = _announced(encoded.tobytes())
    if not 0 < height * width <= _MOST_PIXELS:
        raise _undecodable(topic, form)
    try:
        picture = cv2.imdecode(encoded, how)
    except cv2.error as error:
        raise _undecodable(topic, form) from error
    if picture is None:
        raise _undecodable(topic, form)
    return np.asarray(picture)


def _announced(data: bytes) -> tuple[int, int]:
    """Height and width [px] in the header of a PNG or JPEG; 0 where it is neither."""
    if data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return height, width
    if data[:2] != b"\xff\xd8":
        return 0, 0
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, size = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        # A frame header; the four others of the range define tables.
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            return height, width
        at += 2 + size
    return 0, 0


def _undecodable(topic: str, form: str) -> HardwareError:
    return HardwareError(
        f"a picture of {topic} ({form!r}) cannot be decompressed; taken are PNG and JPEG of at most {_MOST_PIXELS} px: "
        "it is damaged, or of another format; name the topic without compression"
    )
