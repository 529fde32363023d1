"""Wrappers that correct a camera's calibration, pose or stamps, when better values than the driver's are available."""

from types import TracebackType
from typing import Self

import msgspec

from dlokit.communication.timing.clock import Clock
from dlokit.errors import ConfigError, HardwareError
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.calibration_file import check_same_camera
from dlokit.types.image import CameraCalibration, CameraPictures
from dlokit.types.pose import Pose


class _Corrected:
    """A `Camera` that returns the pictures of another one, corrected."""

    def __init__(self, camera: Camera) -> None:
        self._camera = camera

    @property
    def calibration(self) -> CameraCalibration:
        """The calibration of its pictures. Raises `HardwareError` while it is unknown."""
        return self._camera.calibration

    async def capture(self, timeout_s: float) -> CameraPictures:
        """The camera's pictures, corrected.

        Raises `HardwareError` when none arrive, or they are from another camera.
        """
        return self._corrected(await self._camera.capture(timeout_s))

    def _corrected(self, images: CameraPictures) -> CameraPictures:
        raise NotImplementedError

    def __enter__(self) -> Self:
        """Open the camera."""
        self._camera.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the camera."""
        self._camera.__exit__(kind, error, trace)


class CalibratedCamera(_Corrected):
    """A `Camera` that returns the pictures of another one with the calibration and the stamp correction of a file."""

    def __init__(self, camera: Camera, calibration: CameraCalibration, file: str) -> None:
        """`file` is named in errors."""
        super().__init__(camera)
        self._calibration = calibration
        self._file = file

    @property
    def calibration(self) -> CameraCalibration:
        """The calibration of the file."""
        return self._calibration

    def _corrected(self, images: CameraPictures) -> CameraPictures:
        try:
            check_same_camera(self._file, self._calibration, images.calibration)
        except ConfigError as error:
            raise HardwareError(str(error)) from error
        late_ns = round((self._calibration.stamps_late_s - images.calibration.stamps_late_s) * 1e9)
        return msgspec.structs.replace(images, calibration=self._calibration, stamp_ns=images.stamp_ns - late_ns)


class PlacedCamera(_Corrected):
    """A `Camera` with a given pose, for a driver that does not report one."""

    def __init__(self, camera: Camera, T_world_camera: Pose) -> None:
        """`T_world_camera` replaces the driver's pose; the rest of its calibration is kept."""
        super().__init__(camera)
        self._T_world_camera = T_world_camera

    @property
    def calibration(self) -> CameraCalibration:
        """The driver's calibration, with the given pose."""
        return msgspec.structs.replace(self._camera.calibration, T_world_camera=self._T_world_camera)

    def _corrected(self, images: CameraPictures) -> CameraPictures:
        placed = msgspec.structs.replace(images.calibration, T_world_camera=self._T_world_camera)
        return msgspec.structs.replace(images, calibration=placed)


class NowPlayedCamera(_Corrected):
    """A recorded camera in a run: its pictures are stamped with the time of the call.

    Their own stamps are from the clock of an earlier run, for which this run has no states of its arms.
    """

    def __init__(self, camera: Camera, clock: Clock) -> None:
        """`clock` is the run's."""
        super().__init__(camera)
        self._clock = clock

    def _corrected(self, images: CameraPictures) -> CameraPictures:
        return msgspec.structs.replace(images, stamp_ns=self._clock.now_ns())
