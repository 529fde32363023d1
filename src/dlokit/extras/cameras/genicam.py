"""Two GenICam cameras (GigE Vision, USB3 Vision) as a stereo pair, through aravis: triggered by software, in grey."""

import asyncio
import importlib
import importlib.util
import logging
import sys
import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import Future, wait
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from types import ModuleType
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import msgspec
import numpy as np

from dlokit.errors import ConfigError, HardwareError
from dlokit.functional.cameras.base import Caller, Camera, CameraContext
from dlokit.functional.cameras.calibration_file import OVER_THE_TABLE, check_same_camera, has_pose, read_calibration
from dlokit.functional.cameras.device_clock import ClockOffset, DeviceClock
from dlokit.geometry.camera import centred_camera
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import CameraCalibration, StereoImages

if TYPE_CHECKING:
    from dlokit.app.doctor.machine import DoctorRow

log = logging.getLogger(__name__)
T = TypeVar("T")

MOST_SKEW_NS = 10_000_000
"""Largest time between the exposures of a pair [ns]: a DLO that moves at 0.3 m/s moves by 3 mm in this time."""
LOST_S = 1.5
"""A camera without a complete picture for this long is lost [s]; aravis alone would notice only after 5.6 s."""
_TRIGGERS = 3
_AGAIN_S = 0.4
"""A camera is triggered again if its picture has not arrived this long after the exposure [s]. All triggers together
take less than `LOST_S`: a longer wait means that a call of aravis waits for a camera that does not answer."""
_OPEN_S = 10.0
"""Longest time to find and set up both cameras [s]: 2 s for the search, 5 s for a camera that does not answer."""
_CLOSE_S = 2.0
"""Longest time to release a camera that is still connected [s]."""
_BUFFERS = 4
"""Number of pictures that aravis can buffer before the first is read; one at a time is in transfer."""
_LINK_BYTES_S = 125e6
"""Highest rate at which a picture arrives [byte/s]: 1 Gbit/s, also the limit of the readout on faster links."""
_SYSTEM_PACKAGES = Path("/usr/lib/python3/dist-packages")
INSTALL = "sudo apt install gir1.2-aravis-0.8 python3-gi (no registry of Python has it)"


def aravis() -> Any:
    """The module Aravis, made by GObject introspection. Raises `HardwareError` if it cannot be imported."""
    try:
        try:
            gi = importlib.import_module("gi")
        except ImportError:
            gi = _gi_of_the_system()
        gi.require_version("Aravis", "0.8")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ImportWarning)  # gi uses Python's older importer interface
            return importlib.import_module("gi.repository.Aravis")
    except (ImportError, ValueError) as error:  # gi is missing, or aravis
        raise HardwareError(
            f"GenICam cameras need aravis 0.8, which cannot be imported ({error}): {INSTALL}; it must be for this "
            f"Python, {sys.version_info.major}.{sys.version_info.minor}"
        ) from error


def _gi_of_the_system() -> ModuleType:
    """The package gi as Debian installs it, which a virtual environment of the same Python does not see."""
    folder = _SYSTEM_PACKAGES / "gi"
    spec = importlib.util.spec_from_file_location(
        "gi", folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    if spec is None or spec.loader is None or not folder.is_dir():
        raise ImportError("No module named 'gi'")
    sys.modules["gi"] = module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules["gi"]
        raise
    return module


@dataclass(frozen=True, kw_only=True)
class FoundGenicam:
    """A camera that answers aravis's search, with the names that select it."""

    id: str
    address: str
    serial: str
    model: str

    def __str__(self) -> str:
        return f"{self.model} {self.serial or f'{self.id} (without a serial number)'} at {self.address}"


_search = threading.Lock()  # aravis has one list of devices


def found_cameras(aravis: Any, *, again: bool = True) -> list[FoundGenicam]:
    """Search for cameras for 1 s; with `again` False, return a non-empty result of the last search at once."""
    with _search:
        if again or aravis.get_n_devices() == 0:
            aravis.update_device_list()
        return [
            FoundGenicam(
                id=aravis.get_device_id(number),
                address=aravis.get_device_address(number) or "",
                serial=aravis.get_device_serial_nbr(number) or "",
                model=aravis.get_device_model(number) or "camera",
            )
            for number in range(aravis.get_n_devices())
        ]


class GenicamPair(CameraContext):
    """A `Camera` of two GenICam cameras that are triggered together. Stamps are of the left picture's mid-exposure.

    A lost camera is opened again in the background, and again by each later capture; the other one stays open.
    """

    def __init__(
        self,
        left: str,
        right: str,
        calibration: CameraCalibration | None,
        *,
        file: str = "",
        exposure_s: float = 0.01,
        most_skew_ns: int = MOST_SKEW_NS,
    ) -> None:
        """`left` and `right` are serials, addresses or ids; `file` is the calibration's file, named in errors.

        Without a calibration, e.g. before pictures of a board are taken, the optics are a guess. Exposures farther
        apart than `most_skew_ns` do not make a pair.
        """
        super().__init__()
        self._names = {"left": left, "right": right}
        self._calibration = calibration
        self._file = file
        self._exposure_s = exposure_s
        self._most_skew_ns = most_skew_ns
        self._sides: list[_Side] = []
        self._shots: list[Future[_Shot]] = []
        self._triggered_ns = self._last_ns = 0
        self.clock_offsets: tuple[ClockOffset, ...] = ()
        """Offsets of the left and the right camera's clock to the host's; empty before the first pair."""
        self.skew_ns = 0
        """Time from the left to the right exposure of the last pair [ns]."""

    @property
    def calibration(self) -> CameraCalibration:
        """The calibration of the file, with the serials of both cameras once they are open.

        Raises `HardwareError` if there is none and the cameras were never open: their picture size is then unknown.
        """
        if self._calibration is None:
            raise HardwareError("the GenICam cameras are not calibrated, and were not asked for the size of pictures")
        return self._calibration

    async def capture(self, timeout_s: float) -> StereoImages:
        """A pair exposed after the call. Raises `HardwareError` if there is none within `timeout_s`.

        The error for a lost camera comes after 1.5 s, even if `timeout_s` is longer.
        """
        if not self._open:
            raise HardwareError("the GenICam cameras were closed; enter the pair again before capturing")
        return await asyncio.to_thread(self._captured, time.monotonic_ns(), timeout_s)

    def _connect(self) -> None:
        """Connect to both cameras. Raises `HardwareError` if one is missing, or does not match the calibration."""
        module = aravis()
        if not self._sides:
            self._sides = [_Side(module, side, name, self._exposure_s) for side, name in self._names.items()]
        try:
            self._ready(time.monotonic_ns() + round(_OPEN_S * 1e9))
            self._calibration = self._checked()
        except HardwareError:
            self._disconnect()
            raise

    def _captured(self, asked_ns: int, timeout_s: float) -> StereoImages:
        end_ns = asked_ns + round(timeout_s * 1e9)
        with self._lock:
            skewed = 0
            while time.monotonic_ns() < end_ns:
                self._ready(end_ns)
                shots = self._exposed(end_ns)
                if shots is None:
                    break
                if min(shot.triggered_ns for shot in shots) < asked_ns:
                    continue  # left over from a capture that timed out
                starts_ns = self._starts_ns(shots)
                if abs(self.skew_ns) > self._most_skew_ns:
                    skewed += 1
                    log.warning("no pair: the right exposure began %+.1f ms after the left one", self.skew_ns / 1e6)
                    continue
                return self._pair(shots, starts_ns[0])
        refused = f" ({skewed} pairs were exposed more than {self._most_skew_ns / 1e6:g} ms apart)" if skewed else ""
        raise HardwareError(
            f"the GenICam cameras {' and '.join(self._names.values())} gave no pair within {timeout_s:g} s{refused}; "
            "allow more time, give each camera a port of its own, or set a smaller picture in the cameras"
        )

    def _ready(self, end_ns: int) -> None:
        """Wait until both cameras are open. Raises `HardwareError` if one is still closed at `end_ns`."""
        for side in self._sides:
            if side.failed:
                side.open_again()
        wait([side.opened for side in self._sides], timeout=max(0.0, (end_ns - time.monotonic_ns()) / 1e9))
        for side in self._sides:
            if not side.opened.done():
                raise HardwareError(
                    f"the {side} does not answer, or is still being opened; are its cable and its power in? The "
                    "next capture tries again"
                )
            side.opened.result()

    def _exposed(self, end_ns: int) -> "list[_Shot] | None":
        """Both pictures of a trigger; None if they have not arrived by `end_ns`. Raises if a camera is lost."""
        if not self._shots:
            self._triggered_ns = time.monotonic_ns()
            self._shots = [side.shoot() for side in self._sides]
        lost_ns = self._triggered_ns + round((LOST_S + self._exposure_s) * 1e9)
        wait(self._shots, timeout=max(0.0, (min(end_ns, lost_ns) - time.monotonic_ns()) / 1e9))
        done = [shot.done() for shot in self._shots]
        if not all(done) and time.monotonic_ns() < lost_ns:
            return None
        shots, self._shots = self._shots, []
        for side, shot in zip(self._sides, shots, strict=True):
            error = shot.exception() if shot.done() else TimeoutError("it does not answer")
            if error is not None:
                side.open_again()
                raise HardwareError(
                    f"the {side} is lost: {error}; are its cable and its power in? It is opened again when it is back"
                ) from error
        return [shot.result() for shot in shots]

    def _starts_ns(self, shots: "list[_Shot]") -> list[int]:
        """Start times of both exposures [ns] on the host's clock: never before their trigger."""
        self.clock_offsets = tuple(
            side.clock.arrived(shot.device_ns, shot.arrived_ns) for side, shot in zip(self._sides, shots, strict=True)
        )
        starts_ns = [
            max(shot.device_ns + offset.offset_ns, shot.triggered_ns)
            for shot, offset in zip(shots, self.clock_offsets, strict=True)
        ]
        self.skew_ns = starts_ns[1] - starts_ns[0]
        return starts_ns

    def _pair(self, shots: "list[_Shot]", start_ns: int) -> StereoImages:
        self._last_ns = max(start_ns + round(self._exposure_s * 5e8), self._last_ns + 1)
        left, right = (np.repeat(shot.grey[..., None], 3, axis=2) for shot in shots)
        return StereoImages(
            stamp_ns=self._last_ns, frame="camera", left=left, right=right, calibration=self.calibration
        )

    def _checked(self) -> CameraCalibration:
        """The calibration, with the cameras' serials. Raises `HardwareError` if it belongs to other cameras."""
        sizes = [side.size_px for side in self._sides]
        if sizes[0] != sizes[1]:
            said = " and ".join(f"{width} by {height} px" for width, height in sizes)
            raise HardwareError(f"the two cameras take pictures of {said}; set the same size and place in both")
        known = self._calibration or _guessed_optics(*sizes[0])
        serial = "+".join(side.serial for side in self._sides)
        try:
            check_same_camera(self._file, known, msgspec.structs.replace(_guessed_optics(*sizes[0]), serial=serial))
        except ConfigError as error:
            raise HardwareError(str(error)) from error
        return msgspec.structs.replace(known, serial=serial)

    def _disconnect(self) -> None:
        sides, self._sides, self._shots = self._sides, [], []
        wait([side.close() for side in sides], timeout=_CLOSE_S)


def _guessed_optics(width_px: int, height_px: int) -> CameraCalibration:
    """Optics of a pair before its calibration: a lens that sees 53° in width, and no baseline."""
    return centred_camera(width_px, height_px, float(width_px), OVER_THE_TABLE)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shot:
    """A picture of one camera."""

    grey: UInt8Array  # (height, width)
    device_ns: int
    """Start of the exposure [ns] on the camera's clock."""
    triggered_ns: int
    arrived_ns: int


class _Side:
    """One of the two cameras. A dedicated thread makes all calls to it, because each may block for seconds."""

    def __init__(self, aravis: Any, side: str, name: str, exposure_s: float) -> None:
        """`aravis` is the module; opening begins at once."""
        self._aravis = aravis
        self._side, self._name = side, name
        self._exposure_s = exposure_s
        self._camera: Any = None
        self._stream: Any = None
        self._asked = SimpleQueue[Callable[[], None] | None]()
        self.size_px = (0, 0)
        self.serial = ""
        self.clock = DeviceClock(0)
        threading.Thread(target=self._work, name=f"genicam {side}", daemon=True).start()
        self.opened = self._do(lambda: self._opened(again=False))
        """Future that is done when the camera is open or has failed."""

    def __str__(self) -> str:
        return f"{self._side} GenICam camera {self._name}"

    @property
    def failed(self) -> bool:
        """Whether opening the camera failed."""
        return self.opened.done() and self.opened.exception() is not None

    def open_again(self) -> None:
        """Close the camera if it is open, and open it again; `opened` is done when it is open."""
        self.opened = self._do(lambda: self._opened(again=True))

    def shoot(self) -> Future[_Shot]:
        """Trigger the camera: its next complete picture, or a `HardwareError`."""
        return self._do(self._shot)

    def close(self) -> Future[None]:
        """Release the camera and end the thread."""
        closed = self._do(self._closed)
        self._asked.put(None)
        return closed

    def _do(self, call: Callable[[], T]) -> Future[T]:
        answer = Future[T]()

        def run() -> None:
            try:
                answer.set_result(call())
            except RuntimeError as error:  # GObject's only exception
                answer.set_exception(HardwareError(str(error)))
            except Exception as error:
                answer.set_exception(error)

        self._asked.put(run)
        return answer

    def _work(self) -> None:
        while (run := self._asked.get()) is not None:
            run()

    def _opened(self, *, again: bool) -> None:
        self._closed()
        cameras = found_cameras(self._aravis, again=again)
        fitting = [one for one in cameras if self._name in (one.serial, one.address, one.id)]
        if len(fitting) != 1:
            found = ", ".join(map(str, cameras)) or "none"
            raise HardwareError(
                f"the {self} is not among the cameras that answer ({found}); plug it in, give it an address in the "
                "network of this computer, or name one of these"
            )
        try:
            self._camera = self._aravis.Camera.new(fitting[0].id)
            self._configure(self._camera)
            self._start(self._camera)
        except RuntimeError as error:
            self._closed()
            raise HardwareError(
                f"the {self} cannot be set up: {error}; does another program use it, and does it take pictures in "
                "Mono8 by a software trigger?"
            ) from error
        self.serial = fitting[0].serial or fitting[0].id  # of a camera without a serial number

    def _configure(self, camera: Any) -> None:
        camera.stop_acquisition()  # a program that crashed may have left it running
        camera.set_pixel_format_from_string("Mono8")
        if camera.is_exposure_auto_available():
            # Two cameras with different exposures would show two different pictures.
            camera.set_exposure_time_auto(self._aravis.Auto.OFF)
        shortest_us, longest_us = camera.get_exposure_time_bounds()
        if not shortest_us <= self._exposure_s * 1e6 <= longest_us:
            raise HardwareError(
                f"an exposure of {self._exposure_s * 1e3:g} ms is set; the {self} takes {shortest_us / 1e3:g} to "
                f"{longest_us / 1e3:g} ms (--camera.exposure-ms)"
            )
        camera.set_exposure_time(self._exposure_s * 1e6)
        camera.set_acquisition_mode(self._aravis.AcquisitionMode.CONTINUOUS)
        camera.set_trigger("Software")
        if camera.is_gv_device():
            camera.gv_auto_packet_size()
        region = camera.get_region()
        self.size_px = (region.width, region.height)

    def _start(self, camera: Any) -> None:
        bytes_of_picture = camera.get_payload()
        # From the start of the exposure to the arrival: the exposure and the transfer of the picture.
        self.clock = DeviceClock(round((self._exposure_s + bytes_of_picture / _LINK_BYTES_S) * 1e9))
        self._stream = camera.create_stream(None, None)
        for _ in range(_BUFFERS):
            self._stream.push_buffer(self._aravis.Buffer.new_allocate(bytes_of_picture))
        camera.start_acquisition()

    def _shot(self) -> _Shot:
        while (late := self._stream.try_pop_buffer()) is not None:
            self._stream.push_buffer(late)
        for _ in range(_TRIGGERS):
            triggered_ns = time.monotonic_ns()
            self._camera.software_trigger()
            buffer = self._stream.timeout_pop_buffer(round((_AGAIN_S + self._exposure_s) * 1e6))
            arrived_ns = time.monotonic_ns()
            if buffer is None:
                continue
            grey, device_ns = self._pixels(buffer), buffer.get_timestamp()
            self._stream.push_buffer(buffer)
            if grey is not None:
                # A camera without a clock stamps everything with 0.
                return _Shot(
                    grey=grey, device_ns=device_ns or arrived_ns, triggered_ns=triggered_ns, arrived_ns=arrived_ns
                )
        raise HardwareError("it gave no complete picture")

    def _pixels(self, buffer: Any) -> UInt8Array | None:
        """The picture (height, width); None if it is incomplete, as the first one after a start may be."""
        width, height = self.size_px
        status = buffer.get_status()
        pixels = np.frombuffer(buffer.get_data(), dtype=np.uint8)
        if status != self._aravis.BufferStatus.SUCCESS or len(pixels) < width * height:
            log.info("the %s: a picture is incomplete (%s)", self, status)
            return None
        return pixels[: width * height].reshape(height, width)

    def _closed(self) -> None:
        camera, self._camera, self._stream = self._camera, None, None
        if camera is None:
            return
        try:
            camera.stop_acquisition()
            if camera.is_gv_device():
                camera.get_device().leave_control()
        except RuntimeError as error:
            log.info("the %s had stopped already: %s", self, error)


def connected_cameras() -> tuple[FoundGenicam, ...] | None:
    """The cameras that answer within a second; None if aravis is not installed for this Python."""
    try:
        return tuple(found_cameras(aravis()))
    except HardwareError:
        return None


@dataclass(frozen=True, kw_only=True)
class GenicamConfig:
    """Two mono GenICam cameras (GigE Vision, USB3 Vision) side by side, triggered by software; needs aravis."""

    name: ClassVar[str] = "genicam"
    sees_cell: ClassVar[bool] = False
    left: str = ""
    """Left camera: its serial number, address or id, as `dlokit doctor` lists them."""
    right: str = ""
    """Right camera."""
    calibration: str = ""
    """File with the optics of the pair, as `dlokit calibrate stereo` or `handeye` writes it; required. A file without a
    pose counts as 1 m over the table at x = 0.5 m, looking down."""
    exposure_ms: float = 10.0
    """Exposure of both cameras [ms]; longer: brighter pictures, in which motion blurs more."""

    def build(self, caller: Caller) -> Camera:
        """The camera. Raises `ConfigError` when a camera or the calibration is not named."""
        self._check()
        return self._pair(self._optics())

    @classmethod
    def findings(cls) -> "tuple[DoctorRow, ...]":
        """Rows of `dlokit doctor` for aravis and the cameras that answer."""
        from dlokit.extras.cameras.findings import camera_finding

        return (camera_finding("GenICam", "aravis", connected_cameras, INSTALL),)

    @classmethod
    def connected_serials(cls) -> list[str] | None:
        """Serial numbers, addresses and ids of the cameras that answer, as they may be named; None without aravis."""
        found = connected_cameras()
        if found is None:
            return None
        return [name for one in found for name in (one.serial, one.address, one.id) if name]

    def uncalibrated(self) -> Camera:
        """The camera before its calibration, for pictures of a board. Raises `ConfigError`."""
        self._check()
        return self._pair(None)

    def _pair(self, calibration: CameraCalibration | None) -> Camera:
        return GenicamPair(self.left, self.right, calibration, file=self.calibration, exposure_s=self.exposure_ms / 1e3)

    def _check(self) -> None:
        if not self.left or not self.right or self.left == self.right:
            raise ConfigError(
                "camera genicam is a pair of two cameras: name them by serial number, address or id with --camera.left "
                "and --camera.right; `dlokit doctor` lists what is connected"
            )
        if not 0.0 < self.exposure_ms <= 1000.0:
            raise ConfigError(f"--camera.exposure-ms is {self.exposure_ms}; it must be above 0 and at most 1000")

    def _optics(self) -> CameraCalibration:
        if not self.calibration:
            raise ConfigError(
                "camera genicam does not know its optics: give --camera.calibration FILE, as `dlokit calibrate stereo "
                "--from DIR` writes it from pictures of a board, which `dlokit calibrate pictures` takes"
            )
        found = read_calibration(Path(self.calibration))
        if found.baseline_m is None:
            raise ConfigError(
                f"calibration {self.calibration} is of a single camera; calibrate the pair with `dlokit calibrate "
                "stereo --from DIR`, where DIR has right_NAME.png beside each left_NAME.png"
            )
        return found if has_pose(found) else msgspec.structs.replace(found, T_world_camera=OVER_THE_TABLE)
