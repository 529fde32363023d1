"""A camera with what the user knows of it in place of its own: a calibration, or where it stands."""

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self

import msgspec

from dlokit.errors import ConfigError, HardwareError
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.calibration_file import check_same_camera
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.pose import Pose


class _Corrected(ABC):
    """A `Camera` that gives the pictures of another one, with another calibration."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera

    @property
    def calibration(self) -> CameraCalibration:
        """That of its pictures. Raises `HardwareError` while it is not known."""
        return self._corrected(self._camera.calibration)

    async def capture(self, timeout_s: float) -> CameraPictures:
        """The camera's pictures, their stamps corrected.

        Raises `HardwareError` where there are none, or they are of another camera.
        """
        images = await self._camera.capture(timeout_s)
        own, calibration = images.calibration, self._corrected(images.calibration)
        late_ns = round((calibration.stamps_late_s - own.stamps_late_s) * 1e9)
        return msgspec.structs.replace(images, calibration=calibration, stamp_ns=images.stamp_ns - late_ns)

    def __enter__(self) -> Self:
        """Open the camera."""
        self._camera.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the camera."""
        self._camera.__exit__(kind, error, trace)

    @abstractmethod
    def _corrected(self, own: CameraCalibration) -> CameraCalibration:
        """The calibration that replaces the camera's own."""


class CalibratedCamera(_Corrected):
    """A `Camera` that gives the pictures of another one with the calibration of a file."""

    def __init__(self, camera: Camera, calibration: CameraCalibration, file: str) -> None:
        """`file` is named in errors."""
        super().__init__(camera)
        self._calibration = calibration
        self._file = file

    @property
    def calibration(self) -> CameraCalibration:
        """That of the file."""
        return self._calibration

    def _corrected(self, own: CameraCalibration) -> CameraCalibration:
        try:
            check_same_camera(self._file, self._calibration, own)
        except ConfigError as error:
            raise HardwareError(str(error)) from error
        return self._calibration


class PlacedCamera(_Corrected):
    """A `Camera` whose driver does not know where it stands."""

    def __init__(self, camera: Camera, T_world_camera: Pose) -> None:
        """`T_world_camera` replaces the driver's; all else of its calibration stays."""
        super().__init__(camera)
        self._T_world_camera = T_world_camera

    def _corrected(self, own: CameraCalibration) -> CameraCalibration:
        return msgspec.structs.replace(own, T_world_camera=self._T_world_camera)
