"""The pictures of the cell's simulated D435, as a camera of a ROS lab publishes them: the cell itself knows no ROS."""

import asyncio
import time
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from live_systems import background
from ros_lab import LabProgram

from dlokit.description.default_cameras import d435_calibration
from dlokit.errors import DlokitError, InputError
from dlokit.functional.cell.api import CAPTURE_DEPTH
from dlokit.system.processes.bus import JoinedBus, join_bus
from dlokit.system.processes.running import RunningSystem, still_runs, the_running_system
from dlokit.types.image import CameraCalibration, DepthImage
from dlokit.types.outcome import Succeeded

LOOK_S = 0.05
"""Pause between looks for a system that starts [s]."""
STANDS_S = 2.0
"""A cell whose clock stands for so long may have ended, which is looked at then [s]."""
IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"


@dataclass(frozen=True, kw_only=True)
class LabCamera:
    """How a camera of the lab publishes; as realsense-ros does, unless said otherwise."""

    colour: str = "/camera/camera/color/image_raw"
    depth: str = "/camera/camera/aligned_depth_to_color/image_raw"
    frame: str = "camera_color_optical_frame"
    base: str = "base_link"
    encoding: str = "rgb8"
    """rgb8 or bgr8."""
    depth_encoding: str = "16UC1"
    """16UC1 [mm], 0 where unknown, or 32FC1 [m], NaN where unknown."""
    reliable: bool = True
    transforms: bool = True
    """Whether its pose is in /tf_static; needs tf2_msgs in the environment."""

    @property
    def info(self) -> str:
        """Topic of the calibration, beside the colour pictures."""
        return f"{self.colour.rpartition('/')[0]}/camera_info"

    def announce(self, program: LabProgram) -> None:
        """Make the publishers."""
        for topic, kind in ((self.colour, IMAGE), (self.depth, IMAGE), (self.info, INFO)):
            program.order("topic", topic=topic, type=kind, reliable=self.reliable)

    def place(self, program: LabProgram, calibration: CameraCalibration) -> None:
        """Publish the calibrated pose T_world_camera as that of its frame in `base`."""
        if self.transforms:
            pose = calibration.T_world_camera
            program.order(
                "transform",
                parent=self.base,
                child=self.frame,
                position_m=pose.position_m.tolist(),
                xyzw=np.roll(pose.wxyz, -1).tolist(),
                stamp_ns=time.time_ns(),
                static=True,
            )

    def publish(self, program: LabProgram, pictures: DepthImage, stamp_ns: int) -> None:
        """Publish a picture with its depths and calibration, stamped in ROS time [ns]."""
        camera = pictures.calibration
        height, width = pictures.depth_m.shape
        every = {"stamp_ns": stamp_ns, "frame": self.frame, "width": width, "height": height}
        pixels = pictures.pixels if self.encoding == "rgb8" else pictures.pixels[..., ::-1]
        k = [camera.fx_px, 0.0, camera.cx_px, 0.0, camera.fy_px, camera.cy_px, 0.0, 0.0, 1.0]
        program.order(
            "image", pixels.tobytes(), topic=self.colour, encoding=self.encoding, step=pixels[0].nbytes, **every
        )
        depth = self.encoded(pictures)
        program.order(
            "image", depth.tobytes(), topic=self.depth, encoding=self.depth_encoding, step=depth[0].nbytes, **every
        )
        program.order("info", topic=self.info, model="plumb_bob", d=[0.0] * 5, k=k, **every)

    def encoded(self, pictures: DepthImage) -> "np.ndarray[tuple[int, int], np.dtype[np.uint16 | np.float32]]":
        """The depths (height, width) as they are published."""
        if self.depth_encoding == "16UC1":
            return np.rint(pictures.depth_m * 1e3).astype(np.uint16)
        return np.where(pictures.depth_m > 0.0, pictures.depth_m, np.float32(np.nan)).astype(np.float32)


class Feeder:
    """Publishes the pictures of each system that runs, one after the other, and grey ones while none does.

    A run looks at the topics of its camera before its cell starts: grey pictures have the calibration, and no DLO.
    """

    def __init__(self, program: LabProgram, camera: LabCamera, rate_hz: float, run: Path | None) -> None:
        self.shift_ns = 0
        """Added to all stamps; a test may change it, as a jump of the camera's clock."""
        self.quiet = False
        """Whether no pictures are published; a test may change it."""
        self.published = 0
        """Pictures of cells that were published."""
        self._program, self._camera, self._rate_hz, self._run = program, camera, rate_hz, run
        calibration = d435_calibration()
        size = calibration.height_px, calibration.width_px
        self._grey = DepthImage(
            stamp_ns=0,
            seq=0,
            pixels=np.full((*size, 3), 128, np.uint8),
            depth_m=np.ones(size, np.float32),
            calibration=calibration,
        )

    async def feed(self) -> None:
        """Publish until cancelled."""
        self._camera.announce(self._program)
        self._camera.place(self._program, self._grey.calibration)
        while True:
            system = await self._system()
            # It may end, or not yet serve its bus.
            with suppress(DlokitError):
                async with join_bus(system.bus, system.time_base) as bus:
                    await bus.first_tick()
                    await self._follow(system, bus)

    async def _system(self) -> RunningSystem:
        """The next system that runs or starts; until then grey pictures."""
        due_s = time.monotonic()
        while True:
            with suppress(InputError):
                return the_running_system(self._run, starting=True)
            if time.monotonic() >= due_s:
                self._publish(self._grey, time.time_ns())
                due_s = max(due_s + 1.0 / self._rate_hz, time.monotonic())
            await asyncio.sleep(min(LOOK_S, max(0.0, due_s - time.monotonic())))

    async def _follow(self, system: RunningSystem, bus: JoinedBus) -> None:
        """Publish the pictures of a cell until it ends, at the rate on its clock.

        Stamps are the cell's plus an offset that is measured once, so that they tell the time between two pictures on
        the cell's clock, which may be slower than the machine's.
        """
        offset_ns = time.time_ns() - bus.clock.now_ns()
        due_ns = 0
        while still_runs(system):
            outcome = await bus.transport.call(CAPTURE_DEPTH)
            if not isinstance(outcome, Succeeded):
                await asyncio.sleep(LOOK_S)
                continue
            if not due_ns:
                self._camera.place(self._program, outcome.result.calibration)
            self._publish(outcome.result, outcome.result.stamp_ns + offset_ns)
            self.published += not self.quiet
            due_ns = max(due_ns + round(1e9 / self._rate_hz), bus.clock.now_ns())
            with suppress(TimeoutError):
                async with asyncio.timeout(STANDS_S):
                    await bus.clock.sleep_until(due_ns)

    def _publish(self, pictures: DepthImage, stamp_ns: int) -> None:
        if not self.quiet:
            self._camera.publish(self._program, pictures, stamp_ns + self.shift_ns)


@asynccontextmanager
async def _running(feeder: Feeder) -> AsyncGenerator[None]:
    task = asyncio.create_task(feeder.feed())
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


@contextmanager
def feeding(
    program: LabProgram, camera: LabCamera, *, rate_hz: float = 10.0, run: Path | None = None
) -> Generator[Feeder]:
    """Feed a `camera.py` within the context; `run`: the folder of the run, where several systems run."""
    feeder = Feeder(program, camera, rate_hz, run)
    with background() as loop, loop.entered(_running(feeder)):
        yield feeder
