"""Intel RealSense depth cameras, and files that librealsense recorded: colour with aligned depth, 640 x 480 px."""

import asyncio
import importlib
import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from dlokit.errors import BadValue, ConfigError, HardwareError, NoMorePictures, install_command
from dlokit.functional.cameras.base import Caller, Camera, CameraContext
from dlokit.functional.cameras.calibration_file import OVER_THE_TABLE, pose_from
from dlokit.functional.cameras.device_clock import ClockOffset, DeviceClock
from dlokit.types.arrays import Float32Array
from dlokit.types.image import CameraCalibration, DepthImage
from dlokit.types.pose import Pose

if TYPE_CHECKING:
    from dlokit.app.doctor.machine import DoctorRow

log = logging.getLogger(__name__)

SIZE_PX = (640, 480)
RATE_HZ = 30
LEAST_LATENCY_NS = 10_000_000
"""Least time from the middle of an exposure to the arrival of its picture [ns]: half of a usual exposure, the
readout of the sensor, and USB."""
LOST_S = 0.5
"""A device without pictures for this long is started again [s]: 15 pictures, more than the delay of a busy USB port."""
_FILE_WAIT_S = 1.0
"""A file that gives no picture for this long is at its end [s]."""
INSTALL = f"{install_command('realsense')}; on Debian and Ubuntu also: sudo apt install libusb-1.0-0"


def librealsense() -> Any:
    """The module pyrealsense2. Raises `HardwareError` if it cannot be imported."""
    try:
        return importlib.import_module("pyrealsense2")
    except ImportError as error:
        raise HardwareError(
            f"RealSense cameras need pyrealsense2, which cannot be imported ({error}): {INSTALL}"
        ) from error


class RealSenseCamera(CameraContext):
    """A `Camera` of librealsense. Stamps are on the host's monotonic clock; a file's stamps start at its opening.

    The next capture restarts a lost camera with a new pipeline: an old pipeline gives no pictures when the device
    returns. A file is played from its beginning when the context is entered again.
    """

    def __init__(
        self,
        *,
        serial: str = "",
        file: Path | None = None,
        T_world_camera: Pose = OVER_THE_TABLE,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """`serial` selects one of several devices; `file` is played instead of a device, every picture once.

        `clock_ns` is the host's monotonic clock.
        """
        super().__init__()
        self._serial = serial
        self._file = file
        self._T_world_camera = T_world_camera
        self._clock_ns = clock_ns
        self._rs: Any = None
        self._pipeline: Any = None
        self._align: Any = None
        self._depth_unit_m = 0.001
        self._calibration: CameraCalibration | None = None
        self._clock = DeviceClock(LEAST_LATENCY_NS)
        self._file_offset_ns: int | None = None
        self._last_ns = self._heard_ns = 0
        self.clock_offset: ClockOffset | None = None
        """Offset of the device's clock to the host's; None before the first picture, and for a file."""

    @property
    def calibration(self) -> CameraCalibration:
        """The colour sensor's calibration, from the device. Raises `HardwareError` before it was opened."""
        if self._calibration is None:
            raise HardwareError("the RealSense camera's calibration comes from the device; enter it before")
        return self._calibration

    async def capture(self, timeout_s: float) -> DepthImage:
        """The next colour image exposed after the call, with its depth; from a file, the next image.

        Raises `HardwareError` if there is none within `timeout_s`, and `NoMorePictures` at the end of a file.
        """
        if not self._open:
            raise HardwareError("the RealSense camera was closed; enter it again before capturing")
        return await asyncio.to_thread(self._captured, self._clock_ns(), timeout_s)

    def _captured(self, asked_ns: int, timeout_s: float) -> DepthImage:
        end_ns = asked_ns + round(timeout_s * 1e9)
        with self._lock:
            if self._pipeline is None:
                self._connect()
            while (left_ns := end_ns - self._clock_ns()) > 0:
                frames = self._waited(left_ns)
                if frames is None:
                    break
                self._heard_ns = self._clock_ns()
                # The first framesets of a start lack one of the pictures.
                if not frames.get_depth_frame() or not frames.get_color_frame():
                    continue
                stamp_ns = self._stamped(frames.get_color_frame())
                if self._file is None and stamp_ns < asked_ns:
                    continue  # waited in a buffer since before the call
                return self._image(self._align.process(frames), stamp_ns)
            if self._file is not None and self._at_end():
                raise NoMorePictures(f"all pictures of {self._file} have been played")
            if self._clock_ns() - self._heard_ns > LOST_S * 1e9:
                self._disconnect()  # the next capture starts it again
        raise HardwareError(
            f"the RealSense camera {self._name()} gave no picture within {timeout_s:g} s; is its cable in, on a port "
            "of USB 3, and does no other program use it? The next capture starts it again"
        )

    def _waited(self, left_ns: int) -> Any:
        """The next frameset; None if it does not arrive in time, or the file has ended."""
        end_ns = self._clock_ns() + left_ns
        try:
            while True:
                wait_ns = left_ns if self._file is None else min(left_ns, round(_FILE_WAIT_S * 1e9))
                arrived, frames = self._pipeline.try_wait_for_frames(max(1, wait_ns // 1_000_000))
                if arrived:
                    return frames
                left_ns = end_ns - self._clock_ns()
                # On a busy machine, librealsense may play a file late.
                if self._file is None or left_ns <= 0 or self._at_end():
                    return None
        except RuntimeError as error:  # what librealsense raises for everything
            log.warning("the RealSense camera %s: %s", self._name(), error)
            return None

    def _stamped(self, frame: Any) -> int:
        """Middle of the exposure [ns] on the host's clock; it increases from picture to picture."""
        device_ns = round(frame.get_timestamp() * 1e6) + _to_mid_exposure_ns(self._rs, frame)
        if self._file is None:
            self.clock_offset = self._clock.arrived(device_ns, self._clock_ns())
            offset_ns = self.clock_offset.offset_ns
        else:
            if self._file_offset_ns is None:
                self._file_offset_ns = max(self._clock_ns(), self._last_ns) - device_ns
            offset_ns = self._file_offset_ns
        self._last_ns = max(device_ns + offset_ns, self._last_ns + 1)
        return self._last_ns

    def _image(self, frames: Any, stamp_ns: int) -> DepthImage:
        colour, depth = frames.get_color_frame(), frames.get_depth_frame()
        # Copies: librealsense has few buffers, and new pictures get none while the caller keeps them.
        return DepthImage(
            stamp_ns=stamp_ns,
            frame="camera",
            pixels=np.array(colour.get_data(), dtype=np.uint8),
            depth_m=_metres(np.asarray(depth.get_data()), self._depth_unit_m),
            calibration=self.calibration,
        )

    def _connect(self) -> None:
        if self._pipeline is not None:
            return
        self._rs = rs = librealsense()
        wanted, pipeline = rs.config(), rs.pipeline()
        if self._file is not None:
            if not self._file.is_file():
                raise HardwareError(f"{self._file} does not exist; name a file that librealsense recorded (.db3, .bag)")
            wanted.enable_device_from_file(str(self._file), False)
        else:
            if self._serial:
                wanted.enable_device(self._serial)
            else:
                _check_alone(connected_cameras() or ())
            wanted.enable_stream(rs.stream.depth, *SIZE_PX, rs.format.z16, RATE_HZ)
            wanted.enable_stream(rs.stream.color, *SIZE_PX, rs.format.rgb8, RATE_HZ)
        try:
            if self._file is not None:
                # Before the start: each picture, from the first one on, waits until it is requested.
                file = wanted.resolve(rs.pipeline_wrapper(pipeline)).get_device().as_playback()
                file.set_real_time(False)
            profile = pipeline.start(wanted)
            self._configured(profile)
        except (RuntimeError, BadValue) as error:
            raise HardwareError(
                f"the RealSense camera {self._name()} cannot be started: {error}; {self._advice()}"
            ) from error
        self._pipeline, self._align = pipeline, rs.align(rs.stream.color)
        self._heard_ns = self._clock_ns()
        self._clock, self._file_offset_ns = DeviceClock(LEAST_LATENCY_NS), None

    def _configured(self, profile: Any) -> None:
        rs, device = self._rs, profile.get_device()
        sensors = [sensor for sensor in device.query_sensors() if sensor.is_depth_sensor()]
        self._depth_unit_m = float(sensors[0].as_depth_sensor().get_depth_scale())
        lens = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
        self._calibration = CameraCalibration(
            width_px=lens.width,
            height_px=lens.height,
            fx_px=lens.fx,
            fy_px=lens.fy,
            cx_px=lens.ppx,
            cy_px=lens.ppy,
            T_world_camera=self._T_world_camera,
            distortion=_distortion(rs, lens),
            serial=_told(device, rs.camera_info.serial_number),
        )

    def _disconnect(self) -> None:
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is None:
            return
        try:
            pipeline.stop()
        except RuntimeError as error:
            log.info("the RealSense camera %s had stopped already: %s", self._name(), error)

    def _at_end(self) -> bool:
        playback = self._pipeline.get_active_profile().get_device().as_playback()
        return playback.current_status() == self._rs.playback_status.stopped

    def _name(self) -> str:
        return str(self._file) if self._file is not None else self._serial or "(any)"

    def _advice(self) -> str:
        if self._file is not None:
            return "name a file that librealsense recorded with colour and depth (.db3, .bag)"
        return (
            "plug it into a port of USB 3, end other programs that use it, and allow access to it (udev rules of "
            "librealsense); `rs-enumerate-devices` or `dlokit doctor` lists what is found"
        )


def _to_mid_exposure_ns(rs: Any, frame: Any) -> int:
    """Time from a frame's timestamp to the middle of its exposure [ns], as far as its metadata contain it."""
    known = rs.frame_metadata_value
    if frame.supports_frame_metadata(known.sensor_timestamp) and frame.supports_frame_metadata(known.frame_timestamp):
        sensor_us = frame.get_frame_metadata(known.sensor_timestamp)  # in the middle of the exposure
        return 1000 * (sensor_us - frame.get_frame_metadata(known.frame_timestamp))
    if frame.supports_frame_metadata(known.actual_exposure):
        return -500 * frame.get_frame_metadata(known.actual_exposure)
    return 0


def _metres(steps: Any, unit_m: float) -> Float32Array:
    """Depths (height, width) [m] of the camera's whole steps."""
    depth_m = steps.astype(np.float32)
    depth_m *= np.float32(unit_m)
    return depth_m


def _distortion(rs: Any, lens: Any) -> Float32Array | None:
    """Coefficients k1 k2 p1 p2 k3 of the lens; None if it has no distortion.

    Coefficients of the inverse model map the picture to the ideal one. With the opposite sign they map back, to first
    order; the second-order error is below half a pixel for lenses of these cameras.
    """
    coefficients = np.array(lens.coeffs, dtype=np.float32)
    if lens.model == rs.distortion.none or not coefficients.any():
        return None
    return -coefficients if lens.model == rs.distortion.inverse_brown_conrady else coefficients


@dataclass(frozen=True, kw_only=True)
class FoundCamera:
    """A connected camera."""

    name: str
    serial: str
    """Empty where it reports none."""
    usb: str
    """Version of USB, e.g. 3.2."""

    def __str__(self) -> str:
        return f"{self.name} {self.serial or 'without a serial number'} on USB {self.usb}"


def connected_cameras() -> tuple[FoundCamera, ...] | None:
    """The connected cameras; None if pyrealsense2 is not installed. Raises `HardwareError` if it cannot load."""
    if find_spec("pyrealsense2") is None:
        return None
    rs = librealsense()

    try:
        devices = list(rs.context().query_devices())
    except RuntimeError as error:  # what librealsense raises for everything
        raise HardwareError(f"librealsense cannot list the cameras: {error}") from error
    return tuple(
        FoundCamera(
            name=_told(device, rs.camera_info.name) or "camera",
            serial=_told(device, rs.camera_info.serial_number),
            usb=_told(device, rs.camera_info.usb_type_descriptor) or "unknown",
        )
        for device in devices
    )


def _told(device: Any, what: Any) -> str:
    """What a device reports of itself; empty where it does not."""
    return device.get_info(what) if device.supports(what) else ""


def _check_alone(cameras: Sequence[FoundCamera]) -> None:
    """Raise `HardwareError` where several cameras are connected and none is chosen: librealsense would take any."""
    if len(cameras) < 2:
        return
    remedy = "name one with --camera.serial" if any(one.serial for one in cameras) else "connect only the one to use"
    raise HardwareError(f"{len(cameras)} RealSense cameras are connected ({', '.join(map(str, cameras))}): {remedy}")


def doctor_row(search: Callable[[], Sequence[FoundCamera] | None]) -> "DoctorRow":
    """Row of `dlokit doctor` for RealSense cameras; `search` as `connected_cameras`."""
    from dlokit.app.doctor.machine import Severity
    from dlokit.extras.cameras.findings import camera_finding

    fix = f"sudo apt install libusb-1.0-0; {install_command('realsense')}"
    none = "no camera is connected, or this user may not access it (udev rules)"
    row = camera_finding("RealSense", "pyrealsense2", search, fix, none=none)
    if row.standing is Severity.READY and "on USB 2" in row.found:
        fix = "plug it into a port of USB 3, with the cable of its maker"
        return replace(row, standing=Severity.ADVICE, found=f"{row.found}: too slow for 30 pictures/s", fix=fix)
    return row


@dataclass(frozen=True, kw_only=True)
class RealSenseConfig:
    """An Intel RealSense depth camera, or a file that librealsense recorded."""

    name: ClassVar[str] = "realsense"
    sees_cell: ClassVar[bool] = False
    serial: str = ""
    """Serial number of the device; needed where several are connected."""
    file: str = ""
    """File that librealsense recorded (.db3, .bag), played instead of a device."""
    calibration: str = ""
    """File with the camera's pose T_world_camera, as calibration.toml of recorded pictures. Without it the camera
    counts as 1 m over the table at x = 0.5 m, looking down."""

    def build(self, caller: Caller) -> Camera:
        """The camera. Raises `ConfigError` when a file does not exist, or the calibration has no pose."""
        if self.file and not Path(self.file).is_file():
            raise ConfigError(f"--camera.file {self.file} does not exist; name a file that librealsense recorded")
        file = Path(self.file) if self.file else None
        return RealSenseCamera(serial=self.serial, file=file, T_world_camera=pose_from(self.calibration))

    @classmethod
    def findings(cls) -> "tuple[DoctorRow, ...]":
        """Rows of `dlokit doctor` for pyrealsense2 and the connected cameras."""
        return (doctor_row(connected_cameras),)

    @classmethod
    def connected_serials(cls) -> list[str] | None:
        """Serial numbers of the connected cameras; None without pyrealsense2. Raises `HardwareError`."""
        found = connected_cameras()
        return None if found is None else [one.serial for one in found]
