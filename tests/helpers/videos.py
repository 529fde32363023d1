"""Reads videos back."""

from pathlib import Path

import cv2
import numpy as np

from dlokit.types.arrays import UInt8Array


def read_video(path: Path) -> list[UInt8Array]:
    """All pictures (height, width, 3) RGB of a video."""
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    pictures: list[UInt8Array] = []
    while True:
        read, frame = video.read()
        if not read:
            video.release()
            return pictures
        pictures.append(np.asarray(frame[:, :, ::-1], dtype=np.uint8))


def apart(one: UInt8Array, other: UInt8Array) -> float:
    """Mean difference of the pixels of two pictures [grey levels of 255]."""
    return float(np.abs(one.astype(np.float64) - other).mean())
