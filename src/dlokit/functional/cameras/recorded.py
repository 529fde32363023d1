"""A camera that plays recorded pictures: from a folder of PNG files, or from the recording of a run."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Protocol, Self

import msgspec
import numpy as np

from dlokit.communication.topics import DEPTH_IMAGES, STEREO_IMAGES
from dlokit.errors import ConfigError, HardwareError, InputError, NoMorePictures
from dlokit.functional.cameras.base import Caller, Camera
from dlokit.functional.cameras.calibration_file import read_calibration
from dlokit.recording.channels import FILE_NAME
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, StereoImages

_PERIOD_S = 0.1
"""Interval of the stamps of pictures in a folder [s]: files have none."""


class RecordedCamera:
    """A `Camera` that gives recorded pictures in their order, each at once.

    A folder holds ``calibration.toml`` and stereo pairs ``left_*.png``, ``right_*.png``, or images ``colour_*.png``
    with depths ``depth_*.png`` (16 bits, millimetres, 0 where unknown), in the order of their names; stamps start at 0
    and advance by `period_s`. A recording is the ``recording.mcap`` of a run, which keeps two looks per second.
    """

    def __init__(self, path: Path, *, period_s: float = _PERIOD_S, repeat: bool = False) -> None:
        """`repeat` starts over after the last pictures. Raises `ConfigError` when something is missing."""
        self._path = path
        self._source: _Source = _Run(path) if path.suffix == ".mcap" else _Folder(path, round(period_s * 1e9))
        self._repeat = repeat
        self._pictures = self._played()
        self._open = True

    @property
    def calibration(self) -> CameraCalibration:
        """The calibration of the folder, or of the first recorded pictures."""
        return self._source.calibration

    async def capture(self, timeout_s: float) -> CameraPictures:
        """The next pictures, at once. Raises `HardwareError` after the last ones."""
        if not self._open:
            raise HardwareError("the recorded camera was closed; enter it again before capturing")
        pictures = next(self._pictures, None)
        if pictures is None:
            raise NoMorePictures(f"all pictures of {self._path} have been played; set repeat to start over")
        return pictures

    def __enter__(self) -> Self:
        """Open it; playing goes on where it was."""
        self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self._open = False

    def _played(self) -> Iterator[CameraPictures]:
        """All pictures, again and again if they repeat, each stamped later than the one before."""
        shift_ns = last_ns = 0
        for turn in count():
            for pictures in self._source.pictures():
                if turn > 0 and pictures.stamp_ns + shift_ns <= last_ns:
                    shift_ns = last_ns + self._source.period_ns - pictures.stamp_ns
                last_ns = pictures.stamp_ns + shift_ns
                yield msgspec.structs.replace(pictures, stamp_ns=last_ns)
            if not self._repeat:
                return


class _Source(Protocol):
    """Recorded pictures, which can be read more than once."""

    calibration: CameraCalibration
    period_ns: int

    def pictures(self) -> Iterator[CameraPictures]:
        """All pictures in their order."""
        ...


class _Run:
    """The pictures in the recording of a run."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.period_ns = round(_PERIOD_S * 1e9)
        try:
            first = next(self.pictures(), None)
        except InputError as error:
            raise ConfigError(f"{path} cannot be played: {error}") from error
        if first is None:
            raise ConfigError(f"{path} holds no pictures: the camera of that run was never asked for any")
        self.calibration = first.calibration

    def pictures(self) -> Iterator[CameraPictures]:
        from dlokit.recording.reader import read_recording  # here, because every process loads the settings below

        for one in read_recording(self._path, {STEREO_IMAGES.name, DEPTH_IMAGES.name}):
            assert isinstance(one.message, StereoImages | DepthImage)
            yield one.message


class _Folder:
    """The pictures in the files of a folder."""

    def __init__(self, folder: Path, period_ns: int) -> None:
        self.calibration = read_calibration(folder / "calibration.toml")
        self.period_ns = period_ns
        self._files, self._of_depth = _files(folder)

    def pictures(self) -> Iterator[CameraPictures]:
        import cv2

        from dlokit.recording.views import depth_m_of

        for number, (first, second) in enumerate(self._files):
            stamp_ns = number * self.period_ns
            if self._of_depth:
                depth_m = depth_m_of(self._fitting(second, cv2.imread(str(second), cv2.IMREAD_UNCHANGED), np.uint16))
                yield DepthImage(
                    stamp_ns=stamp_ns, pixels=self._colour(first), depth_m=depth_m, calibration=self.calibration
                )
            else:
                yield StereoImages(
                    stamp_ns=stamp_ns,
                    left=self._colour(first),
                    right=self._colour(second),
                    calibration=self.calibration,
                )

    def _colour(self, path: Path) -> UInt8Array:
        import cv2

        return self._fitting(path, cv2.imread(str(path), cv2.IMREAD_COLOR_RGB), np.uint8)

    def _fitting(self, path: Path, picture: Any, dtype: type[np.unsignedinteger[Any]]) -> Any:
        if picture is None or picture.dtype != dtype:
            raise HardwareError(
                f"{path} is not a picture of {np.dtype(dtype).itemsize * 8} bits that can be read; PNG is expected: "
                "record it again"
            )
        wanted = (self.calibration.height_px, self.calibration.width_px)
        if picture.shape[:2] != wanted:
            raise HardwareError(
                f"{path} is {picture.shape[1]} by {picture.shape[0]} px, its calibration says {wanted[1]} by "
                f"{wanted[0]} px; give the calibration of this recording"
            )
        return picture


def _files(folder: Path) -> tuple[list[tuple[Path, Path]], bool]:
    """The files of each look, and whether they are of a depth camera."""
    of_depth = any(folder.glob("colour_*.png"))
    first, second = ("colour", "depth") if of_depth else ("left", "right")
    begun = sorted(folder.glob(f"{first}_*.png"))
    files = [(path, folder / path.name.replace(f"{first}_", f"{second}_", 1)) for path in begun]
    lonely = [path.name for path, other in files if not other.exists()]
    if not files or lonely:
        found = f"no {second} picture for {', '.join(lonely)}" if lonely else "no left_*.png and no colour_*.png"
        raise ConfigError(
            f"{folder} has {found}; each left_NAME.png needs a right_NAME.png beside it, and each colour_NAME.png a "
            "depth_NAME.png"
        )
    return files, of_depth


@dataclass(frozen=True, kw_only=True)
class RecordedCameraConfig:
    """Recorded pictures, of a folder or of a run, once and in their order."""

    name: ClassVar[str] = "recorded"
    sees_cell: ClassVar[bool] = False
    path: str = ""
    """Folder with left_*.png and right_*.png, or colour_*.png and depth_*.png, and calibration.toml; or the folder or
    recording.mcap of a run."""
    repeat: bool = False
    """Start over after the last pictures."""

    def build(self, caller: Caller) -> Camera:
        """The camera. Raises `ConfigError` when there are no pictures."""
        if not self.path:
            raise ConfigError("camera recorded plays pictures, and none are given; name them with --camera.path PATH")
        path = Path(self.path)
        return RecordedCamera(path / FILE_NAME if (path / FILE_NAME).exists() else path, repeat=self.repeat)
