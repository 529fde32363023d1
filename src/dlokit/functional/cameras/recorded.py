"""A camera that plays recorded stereo pairs from a folder."""

from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from dlokit.errors import ConfigError, HardwareError
from dlokit.functional.cameras.calibration_file import read_calibration
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import CameraCalibration, StereoImages


class RecordedCamera:
    """A `Camera` that gives the pairs ``left_*.png``, ``right_*.png`` of a folder, in the order of their names.

    The folder also holds ``calibration.toml``. Stamps start at 0 and advance by `period_s` a pair.
    """

    def __init__(self, folder: Path, *, period_s: float = 0.1, repeat: bool = False) -> None:
        """`repeat` starts over after the last pair. Raises `ConfigError` when the folder lacks something."""
        self._calibration = read_calibration(folder / "calibration.toml")
        self._pairs = _pairs(folder)
        self._folder = folder
        self._period_ns = round(period_s * 1e9)
        self._repeat = repeat
        self._played = 0
        self._open = True

    @property
    def calibration(self) -> CameraCalibration:
        """The folder's calibration."""
        return self._calibration

    async def capture(self, timeout_s: float) -> StereoImages:
        """The next pair, at once. Raises `HardwareError` after the last one."""
        if not self._open:
            raise HardwareError("the recorded camera was closed; enter it again before capturing")
        if self._played >= len(self._pairs) and not self._repeat:
            raise HardwareError(
                f"all {len(self._pairs)} pairs of {self._folder} have been played; set repeat to start over"
            )
        left, right = self._pairs[self._played % len(self._pairs)]
        stamp_ns = self._played * self._period_ns
        self._played += 1
        return StereoImages(
            stamp_ns=stamp_ns,
            left=self._read(left),
            right=self._read(right),
            calibration=self._calibration,
        )

    def __enter__(self) -> Self:
        """Open it; playing goes on where it was."""
        self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self._open = False

    def _read(self, path: Path) -> UInt8Array:
        picture = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
        if picture is None:
            raise HardwareError(f"{path} is not a picture that can be read; PNG is expected: record it again")
        wanted = (self._calibration.height_px, self._calibration.width_px)
        if picture.shape[:2] != wanted:
            raise HardwareError(
                f"{path} is {picture.shape[1]} by {picture.shape[0]} px, its calibration says {wanted[1]} by "
                f"{wanted[0]} px; give the calibration of this recording"
            )
        return np.asarray(picture, dtype=np.uint8)


def _pairs(folder: Path) -> list[tuple[Path, Path]]:
    lefts = sorted(folder.glob("left_*.png"))
    pairs = [(left, folder / left.name.replace("left_", "right_", 1)) for left in lefts]
    lonely = [left.name for left, right in pairs if not right.exists()]
    if not pairs or lonely:
        found = f"no right picture for {', '.join(lonely)}" if lonely else "no left_*.png"
        raise ConfigError(f"{folder} has {found}; each left_NAME.png needs a right_NAME.png beside it")
    return pairs
