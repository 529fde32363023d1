"""Write a video: VP9 in MP4, by OpenCV.

OpenCV is already a dependency. Its FFmpeg has an encoder for VP9, which browsers play and LeRobot decodes. The wheels
of PyAV would encode faster, but contain encoders under the GPL.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from dlokit.errors import MachineError
from dlokit.types.arrays import UInt8Array

CODEC, TAG = "vp9", "vp09"
"""Name of the codec, and its mark in a file."""


class VideoFile:
    """A video file that gets its final name when it is complete. A context manager; an exception removes the file.

    A thread encodes each picture while the caller makes the next one.
    """

    def __init__(self, path: Path, fps: float, width_px: int, height_px: int) -> None:
        """Open the file; the codec requires an even width and height. Raises `MachineError` if there is no encoder."""
        assert width_px % 2 == 0, "the caller has made it even"
        assert height_px % 2 == 0, "the caller has made it even"
        self.frames = 0
        self._path = path
        self._part = path.with_name(f".{path.stem}.part{path.suffix}")  # the ending chooses the container
        self._writer = cv2.VideoWriter(
            str(self._part), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*TAG), fps, (width_px, height_px)
        )
        if not self._writer.isOpened():
            self._part.unlink(missing_ok=True)
            raise MachineError(
                f"{path} cannot be written: OpenCV found no encoder of {CODEC.upper()}, or no permission or space; "
                "use the wheel of opencv-python-headless, and a folder you may write to"
            )
        self._thread = ThreadPoolExecutor(max_workers=1)
        self._encoding: Future[bool] | None = None

    @property
    def size_bytes(self) -> int:
        """Number of bytes written so far, without the last pictures, which the encoder delays."""
        return self._part.stat().st_size

    def add(self, picture: UInt8Array) -> None:
        """Append a picture (height, width, 3) RGB of the video's size; waits until the previous one is encoded.

        Raises `MachineError` if the previous picture could not be written.
        """
        self._check_written()
        frame = np.ascontiguousarray(picture[:, :, ::-1])
        self._encoding = self._thread.submit(self._writer.write, frame)
        self.frames += 1

    def close(self) -> None:
        """Complete the file and give it its name. Raises `MachineError` if it could not be written."""
        self._end()
        self._check_written()
        self._part.replace(self._path)

    def __enter__(self) -> Self:
        """The video."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Complete the file, or remove it after an exception."""
        if kind is None:
            self.close()
        else:
            self._end()
            self._part.unlink(missing_ok=True)

    def _check_written(self) -> None:
        if self._encoding is not None and not self._encoding.result():
            raise MachineError(
                f"{self._path} could not be written to its end: free space on the disk, and export again"
            )

    def _end(self) -> None:
        self._thread.shutdown(wait=True)
        self._writer.release()
