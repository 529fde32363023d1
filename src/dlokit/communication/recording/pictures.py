"""Pictures as JPEG files and back."""

import cv2
import numpy as np

from dlokit.communication.recording.channels import IMAGE_FORMAT, IMAGE_QUALITY
from dlokit.errors import CommunicationError
from dlokit.types.arrays import UInt8Array


def to_jpeg(pixels: UInt8Array) -> bytes:
    """A picture (height, width, 3) RGB, or (height, width) grey, as the bytes of a file."""
    picture = cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR) if pixels.ndim == 3 else pixels
    _, data = cv2.imencode(f".{IMAGE_FORMAT}", picture, [cv2.IMWRITE_JPEG_QUALITY, IMAGE_QUALITY])
    return data.tobytes()


def from_jpeg(data: bytes) -> UInt8Array:
    """The picture (height, width, 3) RGB. Raises `CommunicationError` when there is none."""
    picture = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise CommunicationError("a recorded picture cannot be decoded: its bytes are no JPEG file")
    return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
