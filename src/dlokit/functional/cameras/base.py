"""What a camera is."""

from types import TracebackType
from typing import Protocol, Self

from dlokit.types.image import CameraCalibration, DepthImage, StereoImages


class Camera(Protocol):
    """A device that takes stamped pictures. A context manager: entering connects, leaving disconnects.

    Example: ``with camera: pair = await camera.capture(timeout_s=2.0)``
    """

    @property
    def calibration(self) -> CameraCalibration:
        """Intrinsics, baseline if any, and T_world_camera as it is believed to be.

        Raises `HardwareError` while it is not known, before the device has been asked.
        """
        ...

    async def capture(self, timeout_s: float) -> StereoImages | DepthImage:
        """Pictures exposed after the call, with the stamp of their exposure.

        Raises `HardwareError` when there are none within `timeout_s`, or when the device is gone.
        """
        ...

    def __enter__(self) -> Self:
        """Connect. Raises `HardwareError` when the device is not there."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnect; no pictures after this."""
        ...
