"""Write a video: VP9 in MP4, by the `ffmpeg` of the machine, or else by OpenCV.

Browsers play VP9, and LeRobot decodes it. OpenCV is already a dependency, but its FFmpeg encodes a key frame every
twelve pictures, at a speed that cannot be chosen: a tenth of that of the program `ffmpeg`, which Linux distributions
have. The wheels of PyAV would encode as fast, but contain encoders under the GPL.
"""

import shutil
import subprocess
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray

from dlokit.errors import MachineError
from dlokit.types.arrays import UInt8Array

CODEC, TAG = "vp9", "vp09"
"""Name of the codec, and its mark in a file."""
_FFMPEG = ("-c:v", "libvpx-vp9", "-deadline", "realtime", "-cpu-used", "5", "-crf", "18", "-b:v", "0")
"""Constant quality, as near to the pictures as OpenCV's (measured by benchmarks/video_export.py)."""
_KEY_FRAMES_S = 2
"""Seconds between key frames, from which players seek."""


class _Ffmpeg:
    """The program `ffmpeg`, which reads pictures (height, width, 3) BGR from its input."""

    def __init__(self, program: str, part: Path, fps: float, width_px: int, height_px: int) -> None:
        form = ["-f", "rawvideo", "-pix_fmt", "bgr24", "-s", f"{width_px}x{height_px}", "-r", f"{fps:g}", "-i", "-"]
        out = [*_FFMPEG, "-pix_fmt", "yuv420p", "-g", str(max(round(_KEY_FRAMES_S * fps), 1)), "-tag:v", TAG]
        self._shape = (height_px, width_px, 3)
        # In a session of its own, so that Ctrl-C ends the export, which then ends it.
        self._process = subprocess.Popen(
            [program, "-loglevel", "quiet", "-y", *form, *out, str(part)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def write(self, frame: NDArray[np.uint8]) -> bool:
        """Encode a picture; False if that is impossible."""
        assert self._process.stdin is not None
        if frame.shape != self._shape:
            return False
        try:
            self._process.stdin.write(frame.data)
        except OSError:
            return False
        return True

    def release(self) -> bool:
        """Complete the file; False if that was impossible."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.close()
        return self._process.wait() == 0


class _OpenCv:
    """The encoder of OpenCV."""

    def __init__(self, part: Path, fps: float, width_px: int, height_px: int) -> None:
        """Raises `OSError` if there is no encoder."""
        mark = cv2.VideoWriter.fourcc(*TAG)
        self._writer = cv2.VideoWriter(str(part), cv2.CAP_FFMPEG, mark, fps, (width_px, height_px))
        if not self._writer.isOpened():
            raise OSError("OpenCV has no encoder")

    def write(self, frame: NDArray[np.uint8]) -> bool:
        """Encode a picture; False if that is impossible."""
        return self._writer.write(frame)

    def release(self) -> bool:
        """Complete the file."""
        self._writer.release()
        return True


def ffmpeg_program() -> str | None:
    """The program `ffmpeg` with an encoder of VP9; None if this machine has none."""
    program = shutil.which("ffmpeg")
    if program is None:
        return None
    listed = subprocess.run([program, "-hide_banner", "-encoders"], capture_output=True, text=True, check=False)
    return program if "libvpx-vp9" in listed.stdout else None


class VideoFile:
    """A video file that gets its final name when it is complete. A context manager; an exception removes the file.

    A thread encodes each picture while the caller makes the next one.
    """

    def __init__(self, path: Path, fps: float, width_px: int, height_px: int, *, ffmpeg: str | None = None) -> None:
        """Open the file; the codec requires an even width and height.

        `ffmpeg` is the program that encodes, from `ffmpeg_program`; None: OpenCV. Raises `MachineError` if there is no
        encoder.
        """
        assert width_px % 2 == 0, "the caller has made it even"
        assert height_px % 2 == 0, "the caller has made it even"
        self.frames = 0
        self._path = path
        self._part = path.with_name(f".{path.stem}.part{path.suffix}")  # the ending chooses the container
        try:
            self._part.touch()
            self._writer = (
                _OpenCv(self._part, fps, width_px, height_px)
                if ffmpeg is None
                else _Ffmpeg(ffmpeg, self._part, fps, width_px, height_px)
            )
        except OSError as error:
            self._part.unlink(missing_ok=True)
            raise MachineError(
                f"{path} cannot be written: no encoder of {CODEC.upper()}, or no permission or space; use "
                "the wheel of opencv-python-headless, and a folder you may write to"
            ) from error
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
        complete = self._end()
        self._check_written()
        if not complete:
            self._part.unlink(missing_ok=True)
            raise self._broken()
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
            raise self._broken()

    def _broken(self) -> MachineError:
        return MachineError(f"{self._path} could not be written to its end: free space on the disk, and export again")

    def _end(self) -> bool:
        self._thread.shutdown(wait=True)
        return self._writer.release()
