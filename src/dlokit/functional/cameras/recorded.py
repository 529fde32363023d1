"""Cameras that return recorded pictures: from a folder of PNG files, a recording, a bag of ROS, or a replayed run."""

import asyncio
import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import msgspec
import numpy as np

from dlokit.communication.strategies import from_packages
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.topics import DEPTH_IMAGES, STEREO_IMAGES
from dlokit.errors import ConfigError, HardwareError, InputError, NoMorePictures
from dlokit.functional.cameras.base import Caller, Camera, CameraContext
from dlokit.functional.cameras.calibration_file import read_calibration
from dlokit.functional.cameras.picture_topics import PictureTopics
from dlokit.recording.channels import FILE_NAME, in_order
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, StereoImages

log = logging.getLogger(__name__)

_NEAREST_MM = 20
"""No depth camera measures smaller depths; a file with smaller values is in metres or centimetres."""
_PERIOD_NS = 100_000_000
"""Interval of the stamps of pictures in a folder, which have none, and before a recording repeats [ns]."""


RECORDINGS = "dlokit.recordings"
"""Group of entry points through which other packages add formats of recordings; each names a `RecordingFormat`."""


class PictureSeries(Protocol):
    """The pictures of a recording."""

    @property
    def calibration(self) -> CameraCalibration:
        """The calibration of the first pictures."""
        ...

    @property
    def left_out(self) -> Mapping[str, str]:
        """Pictures that could not be used so far, and why."""
        ...

    def pictures(self) -> Iterator[CameraPictures]:
        """All pictures in their order, from the first one on."""
        ...


@runtime_checkable
class RecordingFormat(Protocol):
    """A format of recordings that another package reads."""

    def reads(self, path: Path) -> bool:
        """Whether a file or folder looks like a recording of this format."""
        ...

    def opened(self, path: Path, settings: "RecordedCameraConfig") -> PictureSeries:
        """The pictures of a recording. Raises `ConfigError` when there are none that can be used."""
        ...


class RecordedCamera(CameraContext):
    """A `Camera` that returns recorded pictures in their order, without waiting.

    A folder holds ``calibration.toml`` and stereo pairs ``left_*.png``, ``right_*.png``, or images ``colour_*.png``
    with depths ``depth_*.png`` (16 bits, millimetres, 0 where unknown), in the order of the numbers in their names;
    stamps start at 0 and advance by 0.1 s. Pictures that are damaged or do not fit the calibration are left out,
    and named at the end. A recording is the ``recording.mcap`` of a run, which keeps two looks per second.
    """

    def __init__(self, path: Path, *, repeat: bool = False, source: PictureSeries | None = None) -> None:
        """`repeat` starts over after the last pictures; `source` are the pictures at `path` in another format.

        Raises `ConfigError` when there are no usable pictures.
        """
        super().__init__(is_open=True)  # a camera that is entered again continues with the next pictures
        self._path = path
        self._source = source or (_Run(path) if path.suffix == ".mcap" else _Folder(path))
        self._repeat = repeat
        self._pictures = self._played()

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
            left_out = self._source.left_out
            but = f" but for {len(left_out)} that cannot be used ({', '.join(left_out)})" if left_out else ""
            raise NoMorePictures(f"all pictures of {self._path} have been played{but}; set repeat to start over")
        return pictures

    def _played(self) -> Iterator[CameraPictures]:
        """All pictures, again and again if they repeat, each stamped later than the one before."""
        shift_ns = last_ns = 0
        for turn in count():
            empty = True
            for pictures in self._source.pictures():
                empty = False
                if turn > 0 and pictures.stamp_ns + shift_ns <= last_ns:
                    shift_ns = last_ns + _PERIOD_NS - pictures.stamp_ns
                last_ns = pictures.stamp_ns + shift_ns
                yield msgspec.structs.replace(pictures, stamp_ns=last_ns)
            if empty or not self._repeat:
                return


class _Run:
    """The pictures in the recording of a run."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.left_out: dict[str, str] = {}
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

    def __init__(self, folder: Path) -> None:
        self.calibration = read_calibration(folder / "calibration.toml")
        self.left_out: dict[str, str] = {}
        """Files that cannot be used, and why."""
        self._files, self._of_depth = _files(folder)
        if next(self.pictures(), None) is None:
            raise ConfigError(f"{folder} has no look that can be used: {next(iter(self.left_out.values()))}")

    def pictures(self) -> Iterator[CameraPictures]:
        for number, files in enumerate(self._files):
            try:
                look = self._look(number * _PERIOD_NS, *files)
            except _Unusable as error:
                file, why = error.args
                log.warning("left out: %s %s", file, why)
                self.left_out[file.name] = f"{file} {why}"
                continue
            yield look

    def _look(self, stamp_ns: int, first: Path, second: Path) -> CameraPictures:
        import cv2

        from dlokit.recording.views import depth_m_of

        pixels = self._colour(first)
        if not self._of_depth:
            right = self._colour(second)
            return StereoImages(stamp_ns=stamp_ns, left=pixels, right=right, calibration=self.calibration)
        steps = self._fitting(second, cv2.imread(str(second), cv2.IMREAD_UNCHANGED), np.uint16, 1)
        if 0 < (most := int(steps.max())) < _NEAREST_MM:
            raise _Unusable(second, f"has depths up to {most}; they must be in whole millimetres, 0 where unknown")
        return DepthImage(stamp_ns=stamp_ns, pixels=pixels, depth_m=depth_m_of(steps), calibration=self.calibration)

    def _colour(self, path: Path) -> UInt8Array:
        import cv2

        return self._fitting(path, cv2.imread(str(path), cv2.IMREAD_COLOR_RGB), np.uint8, 3)

    def _fitting(self, path: Path, picture: Any, dtype: type[np.unsignedinteger[Any]], channels: int) -> Any:
        if picture is None:
            raise _Unusable(path, "cannot be read as a picture: it is damaged or no PNG; record or copy it again")
        height_px, width_px, found = (*picture.shape, 1)[:3]
        if (picture.dtype, found) != (dtype, channels):
            bits, wanted_bits = (8 * np.dtype(kind).itemsize for kind in (picture.dtype, dtype))
            raise _Unusable(path, f"has {found} channels of {bits} bits; needed are {channels} of {wanted_bits} bits")
        wanted = self.calibration.width_px, self.calibration.height_px
        if (width_px, height_px) != wanted:
            size = f"is {width_px} by {height_px} px, its calibration says {wanted[0]} by {wanted[1]} px"
            raise _Unusable(path, f"{size}; give the calibration of this recording")
        return picture


class _Unusable(Exception):
    """A file that cannot be used, and why."""


def _files(folder: Path) -> tuple[list[tuple[Path, Path]], bool]:
    """The files of each look, and whether they are of a depth camera."""
    of_depth = any(folder.glob("colour_*.png"))
    first, second = ("colour", "depth") if of_depth else ("left", "right")
    firsts, seconds = (in_order(folder.glob(f"{kind}_*.png")) for kind in (first, second))
    files = [(path, folder / path.name.replace(f"{first}_", f"{second}_", 1)) for path in firsts]
    there, wanted = set(seconds), {other for _, other in files}
    lonely = [path.name for path, other in files if other not in there]
    lonely += [path.name for path in seconds if path not in wanted]
    if not files or lonely:
        found = f"{', '.join(lonely)} alone" if lonely else "no left_*.png and no colour_*.png"
        raise ConfigError(
            f"{folder} has {found}; each left_NAME.png needs a right_NAME.png beside it, and each colour_NAME.png a "
            "depth_NAME.png"
        )
    return files, of_depth


@dataclass(frozen=True, kw_only=True)
class RecordedCameraConfig(PictureTopics):
    """Recorded pictures, of a folder, a run, or a bag of ROS 2 or ROS 1, once and in their order.

    The topics and `calibration` are of a bag.
    """

    name: ClassVar[str] = "recorded"
    sees_cell: ClassVar[bool] = False
    path: str = ""
    """Folder with left_*.png and right_*.png, or colour_*.png and depth_*.png, and calibration.toml; the folder or
    recording.mcap of a run; or a bag of ROS 2 (rosbag2) or ROS 1 (.bag)."""
    repeat: bool = False
    """Start over after the last pictures."""
    frame: str = "base_link"
    """Frame of TF in a bag that counts as the world."""

    def build(self, caller: Caller) -> Camera:
        """The camera. Raises `ConfigError` when there are no pictures."""
        if not self.path:
            raise ConfigError("camera recorded plays pictures, and none are given; name them with --camera.path PATH")
        path = Path(self.path)
        if not path.exists():
            raise ConfigError(f"--camera.path {path} does not exist; name a folder of pictures, a run, or a bag of ROS")
        if (path / FILE_NAME).exists():
            path /= FILE_NAME
        for found in from_packages(RECORDINGS, _flaw, "an object with the methods reads and opened"):
            if found.value.reads(path):
                return RecordedCamera(path, repeat=self.repeat, source=found.value.opened(path, self))
        if self.named or self.calibration:
            settings = (*self.named, "calibration") if self.calibration else (*self.named,)
            raise ConfigError(
                f"{path} is no bag of ROS, and --camera.{settings[0]} is for one; omit it, or name a folder with "
                "metadata.yaml, a .mcap, a .db3 or a .bag file"
            )
        return RecordedCamera(path, repeat=self.repeat)


def _flaw(value: Any) -> str | None:
    return None if isinstance(value, RecordingFormat) else "is no format of recordings"


@dataclass(frozen=True, kw_only=True)
class RecordedLook:
    """The pictures of one look, and the time of their arrival."""

    log_ns: int
    images: CameraPictures


class PlayedCamera(CameraContext):
    """A `Camera` for a run that is replayed: each call returns the pictures of the next look.

    Recordings limit the rate of pictures; a look without its own gets the previous ones, with its own stamp.
    """

    def __init__(self, pictures: Iterator[RecordedLook], looks: Sequence[tuple[int, int]]) -> None:
        """`pictures` in order, read when they are needed; `looks`: the stamp and the end of each look [ns]."""
        super().__init__(is_open=True)
        self._pictures = pictures
        self._looks = iter(looks)
        self._last: RecordedLook | None = None
        self._next = next(pictures, None)
        self.left_out: set[int] = set()
        """Stamps of the looks whose own pictures were not recorded."""

    @property
    def empty(self) -> bool:
        """Whether the recording has no pictures."""
        return self._last is None and self._next is None

    @property
    def calibration(self) -> CameraCalibration:
        """The calibration of the first pictures. Raises `HardwareError` when no pictures were recorded."""
        first = self._last or self._next
        if first is None:
            raise HardwareError("the recording holds no pictures; a run records them unless its camera was never asked")
        return first.images.calibration

    async def capture(self, timeout_s: float) -> CameraPictures:
        """The pictures of the next look; after the last look, wait until the caller's time-out ends the call."""
        clock = LoopClock()
        look = next(self._looks, None)
        if look is None:
            await asyncio.get_running_loop().create_future()
            raise HardwareError("no look was recorded after this one")
        stamp_ns, over_ns = look
        while self._next is not None and self._next.images.stamp_ns <= stamp_ns:
            self._last, self._next = self._next, next(self._pictures, None)
        if self._last is None:
            raise HardwareError("no pictures were recorded of the first look; replay a recording from its beginning")
        if self._last.images.stamp_ns == stamp_ns:
            await clock.sleep_until(self._last.log_ns)
            return self._last.images
        self.left_out.add(stamp_ns)
        await clock.sleep_until(over_ns)
        return msgspec.structs.replace(self._last.images, stamp_ns=stamp_ns)
