"""A camera with a calibration of the user's in place of its own."""

from types import TracebackType
from typing import Self

import msgspec

from dlokit.errors import ConfigError, HardwareError
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.calibration_file import check_same_camera
from dlokit.types.image import CameraCalibration, DepthImage, StereoImages


class CalibratedCamera:
    """A `Camera` that gives the pictures of another one with the calibration of a file."""

    def __init__(self, camera: Camera, calibration: CameraCalibration, file: str) -> None:
        """`file` is named in errors."""
        self._camera = camera
        self._calibration = calibration
        self._file = file

    @property
    def calibration(self) -> CameraCalibration:
        """That of the file."""
        return self._calibration

    async def capture(self, timeout_s: float) -> StereoImages | DepthImage:
        """The camera's pictures, their stamps corrected. Raises `HardwareError` where the file is of another camera."""
        images = await self._camera.capture(timeout_s)
        try:
            check_same_camera(self._file, self._calibration, images.calibration)
        except ConfigError as error:
            raise HardwareError(str(error)) from error
        late_ns = round(self._calibration.stamps_late_s * 1e9)
        return msgspec.structs.replace(images, calibration=self._calibration, stamp_ns=images.stamp_ns - late_ns)

    def __enter__(self) -> Self:
        """Open the camera."""
        self._camera.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the camera."""
        self._camera.__exit__(kind, error, trace)
