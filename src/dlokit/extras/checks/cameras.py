"""`check_camera`: whether a camera, simulated, recorded or a real device, keeps to its protocol."""

import asyncio
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from dlokit.errors import HardwareError
from dlokit.extras.checks.checks import Unmet, require_none
from dlokit.extras.checks.device_report import CheckedDevice, spread
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.calibration_file import has_pose
from dlokit.types.arrays import UInt8Array
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, StereoImages

LONGEST_FOCAL_LENGTH = 10.0
"""Focal length over the width of the picture, at most: a lens that sees 6°."""
FARTHEST_M = 20.0
"""Largest median depth of a picture [m]; beyond it, depths are probably in millimetres."""
LEAST_CONTRAST = 2.0
"""Least standard deviation of a picture's brightness, 0 to 255; a picture below it shows nothing."""
GRACE_S = 0.5
"""Time by which a capture may exceed its time-out [s]."""

WANTED = {
    "opens": "entering connects, and the first capture has a picture within the time-out",
    "calibration": "fx, fy > 0 [px], the principal point in the picture, and the same at every capture; a baseline "
    "above 0 for a stereo pair",
    "pictures": "uint8 pictures (height, width, 3) of the calibrated size, left and right alike",
    "contrast": "pictures that show something: lens cap off, light on, exposure set",
    "depth": "float32 depths (height, width) in metres, 0 where unknown, none negative or infinite",
    "stamps": "each capture has a later stamp, in nanoseconds",
    "exposed after the call": "pictures that were exposed after capture was called, stamped on the given clock",
    "time-out": "a capture ends within its time-out, with a picture or with HardwareError",
    "closes": "after leaving, capture raises HardwareError, and entering again gives pictures",
}
"""The requirement of each check."""


@dataclass(frozen=True, kw_only=True)
class CameraCheckReport:
    """Result for a camera that passed every check; attach it to a bug report."""

    kind: str
    """``StereoImages`` or ``DepthImage``."""
    serial: str
    size_px: tuple[int, int]
    """Width and height."""
    captures: int
    capture_p50_s: float
    """Half of the captures took less time [s]."""
    capture_max_s: float
    stamp_interval_p50_s: float
    """Median interval of the stamps [s]."""
    known_depth: float | None
    """Fraction of the pixels with a depth; None for a stereo pair."""
    passed: tuple[str, ...] = field(default=tuple(WANTED))
    """Names of the checks."""

    def __str__(self) -> str:
        depth = "" if self.known_depth is None else f", depth at {self.known_depth:.0%} of the pixels"
        width, height = self.size_px
        return (
            f"{self.kind} {width} x {height}, serial {self.serial or 'unknown'}: {len(self.passed)} checks passed; a "
            f"capture takes {self.capture_p50_s * 1e3:.0f} ms (p50), at most {self.capture_max_s * 1e3:.0f} ms of "
            f"{self.captures}; stamps are {self.stamp_interval_p50_s * 1e3:.0f} ms apart{depth}"
        )


@dataclass
class _Taken:
    """The captures, with the findings."""

    pictures: list[CameraPictures] = field(default_factory=list[CameraPictures])
    seconds: list[float] = field(default_factory=list[float])
    calibrations: list[CameraCalibration] = field(default_factory=list[CameraCalibration])
    found: list[Unmet] = field(default_factory=list[Unmet])
    late_s: list[float] = field(default_factory=list[float])
    """Time from the stamp of each picture to its arrival [s]; empty without a clock."""
    opened_s: float = 0.0
    """Time until the camera was open [s]."""
    short_s: float = 0.0
    """Time of the capture with the short time-out [s]."""

    def wrong(self, check: str, text: str) -> None:
        """Note a violated requirement."""
        self.found.append(Unmet(check=check, wrong=text, wanted=WANTED[check]))


def check_camera(
    camera: Camera, *, captures: int = 10, timeout_s: float = 2.0, clock_ns: Callable[[], int] | None = None
) -> CameraCheckReport:
    """Try every requirement of the camera protocol on a camera that is not open yet.

    Point it at something with contrast. `clock_ns` is the clock of its stamps, e.g. ``time.monotonic_ns`` for a real
    device; None does not compare them. Raises `CheckFailed`, which lists all findings.
    """
    return asyncio.run(checked_camera(camera, captures=captures, timeout_s=timeout_s, clock_ns=clock_ns))


async def checked_camera(
    camera: Camera, *, captures: int = 10, timeout_s: float = 2.0, clock_ns: Callable[[], int] | None = None
) -> CameraCheckReport:
    """As `check_camera`, for a camera that needs a running event loop."""
    taken = await _tried(camera, captures, timeout_s, clock_ns)
    require_none(_name_of(camera), taken.found)
    return _report(taken)


async def examined_camera(
    camera: Camera, *, captures: int = 10, timeout_s: float = 2.0, clock_ns: Callable[[], int] | None = None
) -> CheckedDevice:
    """As `checked_camera`, with all data for a report, whether the camera passes or not."""
    taken = await _tried(camera, captures, timeout_s, clock_ns)
    failed = {finding.check for finding in taken.found}
    untried = () if taken.pictures else tuple(name for name in WANTED if name not in failed)
    if clock_ns is None:
        untried = (*untried, "exposed after the call")
    sound = taken.pictures and not failed & {"pictures", "depth"}
    return CheckedDevice(
        what=_name_of(camera),
        wanted=WANTED,
        found=taken.found,
        untried=untried,
        facts=_facts(taken),
        timing=_timing(taken),
        pictures=taken.pictures[-1] if sound else None,
    )


def _name_of(camera: Camera) -> str:
    return f"camera {type(camera).__module__}:{type(camera).__qualname__}"


async def _tried(camera: Camera, captures: int, timeout_s: float, clock_ns: Callable[[], int] | None) -> "_Taken":
    taken = _Taken()
    await _open_and_capture(camera, taken, captures, timeout_s, clock_ns)
    if taken.pictures:
        _check_calibration(taken)
        _check_pictures(taken)
        _check_stamps(taken)
        await _check_time_out(camera, taken)
        await _check_closing(camera, taken, timeout_s)
    return taken


async def _open_and_capture(
    camera: Camera, taken: _Taken, captures: int, timeout_s: float, clock_ns: Callable[[], int] | None
) -> None:
    begin_s = time.perf_counter()
    try:
        with camera:
            taken.opened_s = time.perf_counter() - begin_s
            for _ in range(captures):
                asked_ns = 0 if clock_ns is None else clock_ns()
                begin_s = time.perf_counter()
                pictures = await camera.capture(timeout_s)
                taken.seconds.append(time.perf_counter() - begin_s)
                taken.pictures.append(pictures)
                taken.calibrations.append(camera.calibration)
                if clock_ns is not None:
                    _note_stamp(taken, pictures.stamp_ns, asked_ns, clock_ns())
    except Exception as error:  # a driver may raise anything
        taken.wrong("opens", f"after {len(taken.pictures)} captures: {type(error).__name__}: {error}")


def _note_stamp(taken: _Taken, stamp_ns: int, asked_ns: int, now_ns: int) -> None:
    taken.late_s.append((now_ns - stamp_ns) / 1e9)
    if not asked_ns <= stamp_ns <= now_ns:
        early_ms = (asked_ns - stamp_ns) / 1e6
        taken.wrong("exposed after the call", f"stamp {stamp_ns} is {early_ms:.1f} ms before the call")


def _check_calibration(taken: _Taken) -> None:
    first = taken.calibrations[0]
    width, height = first.width_px, first.height_px
    if not (0.0 < first.fx_px < LONGEST_FOCAL_LENGTH * width and 0.0 < first.fy_px < LONGEST_FOCAL_LENGTH * width):
        taken.wrong("calibration", f"the focal lengths are {first.fx_px} and {first.fy_px} px, {width} px wide")
    if not (0.0 <= first.cx_px < width and 0.0 <= first.cy_px < height):
        taken.wrong("calibration", f"the principal point is ({first.cx_px}, {first.cy_px}) px of {width} x {height}")
    if isinstance(taken.pictures[0], StereoImages) and not (first.baseline_m or 0.0) > 0.0:
        taken.wrong("calibration", f"the baseline of the pair is {first.baseline_m}")
    if any(known.fx_px != first.fx_px or known.serial != first.serial for known in taken.calibrations):
        taken.wrong("calibration", "it changes from capture to capture")


def _check_pictures(taken: _Taken) -> None:
    for pictures in taken.pictures:
        known = pictures.calibration
        wanted = (known.height_px, known.width_px, 3)
        for name, pixels in _named(pictures):
            if pixels.shape != wanted or pixels.dtype != np.uint8:
                taken.wrong("pictures", f"{name} is {pixels.shape} {pixels.dtype} where {wanted} uint8 is wanted")
                return
            if float(pixels.std()) < LEAST_CONTRAST:
                taken.wrong("contrast", f"{name} is uniform, of brightness {pixels.mean():.0f}")
                return
        if isinstance(pictures, DepthImage) and (flaw := _depth_flaw(pictures)) is not None:
            taken.wrong("depth", flaw)
            return


def _named(pictures: CameraPictures) -> Sequence[tuple[str, UInt8Array]]:
    if isinstance(pictures, StereoImages):
        return (("left", pictures.left), ("right", pictures.right))
    return (("pixels", pictures.pixels),)


def _depth_flaw(picture: DepthImage) -> str | None:
    depth_m, shape = picture.depth_m, picture.pixels.shape[:2]
    if depth_m.shape != shape or depth_m.dtype != np.float32:
        return f"depth_m is {depth_m.shape} {depth_m.dtype} where {shape} float32 is wanted"
    if not np.isfinite(depth_m).all() or float(depth_m.min()) < 0.0:
        return "some depths are negative, NaN or infinite"
    known = depth_m[depth_m > 0.0]
    if not len(known):
        return "no pixel has a depth"
    if float(np.median(known)) > FARTHEST_M:
        return f"the median depth is {np.median(known):.0f} m; are these millimetres?"
    return None


def _check_stamps(taken: _Taken) -> None:
    stamps_ns = [pictures.stamp_ns for pictures in taken.pictures]
    if any(later <= earlier for earlier, later in pairwise(stamps_ns)):
        taken.wrong("stamps", f"stamps are {stamps_ns[:5]}")


async def _check_time_out(camera: Camera, taken: _Taken) -> None:
    short_s, now_s = 0.001, asyncio.get_running_loop().time
    with camera:
        begin_s = now_s()
        try:
            await camera.capture(short_s)
        except HardwareError:
            pass
        except Exception as error:  # a driver may raise anything
            taken.wrong("time-out", f"with a time-out of 1 ms it raises {type(error).__name__}: {error}")
        took_s = taken.short_s = now_s() - begin_s
    if took_s > short_s + GRACE_S:
        taken.wrong("time-out", f"with a time-out of 1 ms it took {took_s:.1f} s")


async def _check_closing(camera: Camera, taken: _Taken, timeout_s: float) -> None:
    try:
        await camera.capture(timeout_s)
    except HardwareError:
        pass
    except Exception as error:  # a driver may raise anything
        taken.wrong("closes", f"closed, it raises {type(error).__name__}: {error}")
    else:
        taken.wrong("closes", "closed, it still gives pictures")
    try:
        with camera:
            await camera.capture(timeout_s)
    except Exception as error:  # a driver may raise anything
        taken.wrong("closes", f"opened again, it raises {type(error).__name__}: {error}")


def _facts(taken: _Taken) -> dict[str, str]:
    """The camera's description, and statistics of its last pictures."""
    if not taken.pictures:
        return {}
    last = taken.pictures[-1]
    known = last.calibration
    pose = "none: it counts as 1 m over the table" if not has_pose(known) else str(known.T_world_camera.position_m)
    facts = {
        "pictures": f"{type(last).__name__}, {known.width_px} x {known.height_px} px",
        "serial": known.serial or "unknown",
        "fx, fy, cx, cy [px]": f"{known.fx_px:.2f}, {known.fy_px:.2f}, {known.cx_px:.2f}, {known.cy_px:.2f}",
        "baseline [m]": str(known.baseline_m),
        "place in the world [m]": pose,
        "calibrated": known.date or "date unknown",
        "stamps corrected by [s]": str(known.stamps_late_s),
    }
    for name, pixels in _named(last):
        facts[f"brightness of {name}, 0 to 255"] = f"mean {pixels.mean():.0f}, standard deviation {pixels.std():.0f}"
    if isinstance(last, DepthImage):
        seen_m = last.depth_m[last.depth_m > 0.0]
        facts["depth"] = f"at {np.mean(last.depth_m > 0.0):.0%} of the pixels" + (
            f", median {np.median(seen_m):.3f} m, from {seen_m.min():.3f} to {seen_m.max():.3f} m"
            if len(seen_m)
            else ""
        )
    return facts


def _timing(taken: _Taken) -> dict[str, str]:
    if not taken.seconds:
        return {}
    stamps_s = np.array([pictures.stamp_ns for pictures in taken.pictures]) / 1e9
    timing = {"opening": f"{taken.opened_s:.2f} s", "a capture": spread(taken.seconds)}
    if len(stamps_s) > 1:
        timing["between stamps"] = spread(np.diff(stamps_s).tolist())
    if taken.late_s:
        timing["from the stamp to the arrival"] = spread(taken.late_s)
    timing["a capture with a time-out of 1 ms"] = f"{taken.short_s * 1e3:.1f} ms"
    return timing


def _report(taken: _Taken) -> CameraCheckReport:
    last = taken.pictures[-1]
    stamps_s = np.array([pictures.stamp_ns for pictures in taken.pictures]) / 1e9
    return CameraCheckReport(
        kind=type(last).__name__,
        serial=last.calibration.serial,
        size_px=(last.calibration.width_px, last.calibration.height_px),
        captures=len(taken.pictures),
        capture_p50_s=float(np.median(taken.seconds)),
        capture_max_s=max(taken.seconds),
        stamp_interval_p50_s=float(np.median(np.diff(stamps_s))) if len(stamps_s) > 1 else 0.0,
        known_depth=float(np.mean(last.depth_m > 0.0)) if isinstance(last, DepthImage) else None,
    )
