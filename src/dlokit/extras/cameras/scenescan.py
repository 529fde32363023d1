"""SceneScan stereo cameras of Nerian, as in the paper: disparities that the camera computes, through `visiontransfer`.

The driver follows the library's documentation and was tested on arrays in its format; it has never run on the device.
"""

import asyncio
import importlib
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dlokit.errors import BadValue, HardwareError
from dlokit.functional.cameras.base import Caller, Camera, CameraContext
from dlokit.functional.cameras.calibration_file import OVER_THE_TABLE, pose_from
from dlokit.functional.cameras.device_clock import ClockOffset, DeviceClock
from dlokit.types.arrays import Float32Array, UInt8Array
from dlokit.types.image import CameraCalibration, DepthImage
from dlokit.types.pose import Pose

if TYPE_CHECKING:
    from dlokit.app.doctor.machine import DoctorRow

log = logging.getLogger(__name__)

UNKNOWN_DISPARITY = 0xFFF
"""A pixel without a match has this disparity, the largest of 12 bits; 0 would be at infinity."""
LEAST_LATENCY_NS = 20_000_000
"""Least time from the middle of an exposure to the arrival of its pictures [ns]: half of a usual exposure,
readout, matching, and a megapixel with its disparities over 1 Gbit/s."""
LOST_S = 1.5
"""A camera without pictures for this long is lost, and the driver connects to it again [s]."""
_POLL_S = 0.002
"""Polling interval [s]: a blocking call of visiontransfer would stop all threads of Python."""
INSTALL = "install it from the camera's maker, https://nerian.com/support/software/ (no registry of Python has it)"


def visiontransfer() -> Any:
    """The module visiontransfer. Raises `HardwareError` if it cannot be imported."""
    try:
        return importlib.import_module("visiontransfer")
    except ImportError as error:
        raise HardwareError(f"SceneScan cameras need visiontransfer ({error}): {INSTALL}") from error


class SceneScanCamera(CameraContext):
    """A `Camera` of visiontransfer: the rectified left picture with its depths, which the camera computes.

    Stamps are on the host's monotonic clock. The next capture connects to a lost camera again.
    """

    def __init__(
        self,
        *,
        address: str = "",
        T_world_camera: Pose = OVER_THE_TABLE,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """`address` is the network address or serial, empty: the only one; `clock_ns` the host's monotonic clock."""
        super().__init__()
        self._address = address
        self._T_world_camera = T_world_camera
        self._clock_ns = clock_ns
        self._transfer: Any = None
        self._serial = ""
        self._calibration: CameraCalibration | None = None
        self._clock = DeviceClock(LEAST_LATENCY_NS)
        self._last_ns = 0
        self.clock_offset: ClockOffset | None = None
        """Offset of the camera's clock to the host's; None before the first picture."""

    @property
    def calibration(self) -> CameraCalibration:
        """The last picture's calibration, because the camera rectifies. Raises `HardwareError` before the first."""
        if self._calibration is None:
            raise HardwareError("the SceneScan camera's calibration comes with its pictures; capture once before")
        return self._calibration

    async def capture(self, timeout_s: float) -> DepthImage:
        """The next picture exposed after the call, with its depths.

        Raises `HardwareError` if there is none within `timeout_s`, or for 1.5 s.
        """
        if not self._open:
            raise HardwareError("the SceneScan camera was closed; enter it again before capturing")
        return await asyncio.to_thread(self._captured, self._clock_ns(), timeout_s)

    def _captured(self, asked_ns: int, timeout_s: float) -> DepthImage:
        wait_s = min(timeout_s, LOST_S)
        end_ns = asked_ns + round(wait_s * 1e9)
        incomplete = False
        with self._lock:
            self._connect()
            heard, over = False, False
            while not over:
                over = self._clock_ns() >= end_ns  # before asking: a host that was busy still takes what has arrived
                images = self._received()
                if images is None:
                    time.sleep(_POLL_S)
                    continue
                heard = True
                stamp_ns = self._stamped(images)
                if stamp_ns < asked_ns:
                    continue  # waited in a buffer since before the call
                if not _complete(images):
                    incomplete = True
                    continue
                return self._image(images, stamp_ns)
            if not heard and wait_s >= LOST_S:
                self._disconnect()  # the next capture connects again
        if incomplete:
            raise HardwareError(
                "the SceneScan camera sends no left picture with a disparity map; set its operation mode to stereo "
                "matching and its output to the left image and the disparity map, on its web page"
            )
        raise HardwareError(
            f"the SceneScan camera {self._name()} gave no picture within {wait_s:g} s; are its cable and its power in, "
            "and does no other program receive from it? The next capture connects again"
        )

    def _received(self) -> Any:
        """The next image set; None if there is none yet."""
        try:
            return self._transfer.collect_received_image_set(timeout=0)
        except RuntimeError as error:  # what visiontransfer raises for everything
            log.warning("the SceneScan camera %s: %s", self._name(), error)
            return None

    def _stamped(self, images: Any) -> int:
        """Middle of the exposure [ns] on the host's clock; it increases from picture to picture."""
        seconds, micros = images.get_timestamp()
        device_ns = seconds * 1_000_000_000 + micros * 1000 + images.get_exposure_time() * 500
        self.clock_offset = self._clock.arrived(device_ns, self._clock_ns())
        self._last_ns = max(device_ns + self.clock_offset.offset_ns, self._last_ns + 1)
        return self._last_ns

    def _image(self, images: Any, stamp_ns: int) -> DepthImage:
        kinds = visiontransfer().ImageType
        pixels: UInt8Array = np.asarray(images.get_pixel_data(kinds.IMAGE_LEFT, force8bit=True), dtype=np.uint8)
        Q = np.array(images.get_qmatrix(), dtype=np.float64)
        steps = np.asarray(images.get_pixel_data(kinds.IMAGE_DISPARITY), dtype=np.uint16)
        try:
            self._calibration = CameraCalibration(
                width_px=images.get_width(),
                height_px=images.get_height(),
                fx_px=float(Q[2, 3]),
                fy_px=float(Q[2, 3]),
                cx_px=float(-Q[0, 3]),
                cy_px=float(-Q[1, 3]),
                T_world_camera=self._T_world_camera,
                serial=self._serial,
            )
            if not 0.1 <= Q[3, 2] <= 1000.0:
                raise BadValue(f"1 / baseline is {Q[3, 2]:g} per metre; it must be 0.1 to 1000")
        except BadValue as error:
            raise HardwareError(
                f"the SceneScan camera {self._name()} has a wrong calibration: {error}; calibrate it on its web page"
            ) from error
        return DepthImage(
            stamp_ns=stamp_ns,
            frame="camera",
            pixels=pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=2),
            depth_m=depth_of(steps, Q, images.get_subpixel_factor()),
            calibration=self._calibration,
        )

    def _connect(self) -> None:
        if self._transfer is not None:
            return
        module = visiontransfer()
        try:
            devices = list(module.DeviceEnumeration().discover_devices())
            names = [(str(one.get_ip_address()), str(one.get_serial_number())) for one in devices]
            fitting = [number for number, known in enumerate(names) if not self._address or self._address in known]
            if len(fitting) != 1:
                found = ", ".join(f"{serial} at {address}" for address, serial in names) or "none"
                raise HardwareError(
                    f"the SceneScan camera {self._name()} is not the one camera that answers ({found}); plug it in, or "
                    "name one of these with --camera.address"
                )
            self._transfer = module.AsyncTransfer(devices[fitting[0]])
        except RuntimeError as error:
            raise HardwareError(
                f"the SceneScan camera {self._name()} cannot be connected to: {error}; end other programs that use it"
            ) from error
        self._serial = names[fitting[0]][1]
        self._clock = DeviceClock(LEAST_LATENCY_NS)

    def _disconnect(self) -> None:
        transfer, self._transfer = self._transfer, None
        if transfer is None:
            return
        try:
            transfer.disconnect()
        except RuntimeError as error:
            log.info("the SceneScan camera %s had disconnected already: %s", self._name(), error)

    def _name(self) -> str:
        return self._address or self._serial or "(any)"


def depth_of(steps: NDArray[np.uint16], Q: NDArray[np.float64], subpixels: int) -> Float32Array:
    """Depths (height, width) [m] of disparities in fractions of a pixel: ``z = f / (Q32 d + Q33)``; 0 where unknown.

    `Q` is the matrix (4, 4) of OpenCV's ``reprojectImageTo3D`` with lengths in metres: Q32 is 1 / baseline.
    """
    known = (steps > 0) & (steps < UNKNOWN_DISPARITY)
    over = steps.astype(np.float32) * np.float32(Q[3, 2] / subpixels) + np.float32(Q[3, 3])
    known &= over > 0.0
    depth_m = np.zeros(steps.shape, dtype=np.float32)
    np.divide(np.float32(Q[2, 3]), over, out=depth_m, where=known)
    return depth_m


def _complete(images: Any) -> bool:
    kinds = visiontransfer().ImageType
    return images.has_image_type(kinds.IMAGE_LEFT) and images.has_image_type(kinds.IMAGE_DISPARITY)


def connected_cameras() -> tuple[str, ...] | None:
    """The cameras that answer; None if visiontransfer is not installed. Raises `HardwareError` if it fails."""
    if find_spec("visiontransfer") is None:
        return None
    try:
        return tuple(str(device) for device in visiontransfer().DeviceEnumeration().discover_devices())
    except RuntimeError as error:  # what visiontransfer raises for everything
        raise HardwareError(f"visiontransfer cannot list the cameras: {error}") from error


@dataclass(frozen=True, kw_only=True)
class SceneScanConfig:
    """A SceneScan stereo camera of Nerian, the paper's camera; needs visiontransfer. Never run on the device yet."""

    name: ClassVar[str] = "scenescan"
    sees_cell: ClassVar[bool] = False
    address: str = ""
    """Network address or serial number of the camera; needed where several are connected."""
    calibration: str = ""
    """File with the camera's pose T_world_camera, as calibration.toml of recorded pictures. Without it the camera
    counts as 1 m over the table at x = 0.5 m, looking down."""

    def build(self, caller: Caller) -> Camera:
        """The camera. Raises `ConfigError` when the calibration cannot be read, or has no pose."""
        return SceneScanCamera(address=self.address, T_world_camera=pose_from(self.calibration))

    @classmethod
    def findings(cls) -> "tuple[DoctorRow, ...]":
        """Rows of `dlokit doctor` for visiontransfer and the cameras that answer."""
        from dlokit.extras.cameras.findings import camera_finding

        return (camera_finding("SceneScan", "visiontransfer", connected_cameras, INSTALL),)
