"""`dlokit track --camera`: follow a DLO in the pictures of a camera, in the viewer, without a robot."""

import asyncio
import csv
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil

from dlokit.app.data.cloud_track import NODE_COLUMNS, TrackSettings, node_rows
from dlokit.app.library.tracker import Nodes, Tracker
from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import end_tasks
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.transport import Transport
from dlokit.description.scene import Fixture
from dlokit.errors import HardwareError, InputError, NoMorePictures, SkillFailure
from dlokit.functional.cameras.base import Camera
from dlokit.geometry.camera import camera_matrix, in_camera
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.perception import api as perception
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.config import BoxConfig, CloudConfig, PerceptionConfig, TableConfig, from_spec
from dlokit.skills.perception.pipeline import observe, without_points
from dlokit.system.build import Wiring, assemble, build_viewer, segmentation_tools
from dlokit.system.config import RunConfig
from dlokit.system.table import trackers_of_run
from dlokit.types.dlo import DloState
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, StereoImages
from dlokit.types.observation import Observation
from dlokit.types.system import StrategyChosen, StrategySpec

ANYWHERE = BoxConfig(lower_world=(-100.0, -100.0, -100.0), upper_world=(100.0, 100.0, 100.0))
"""The box where none is given: the whole world."""
TIMEOUT_S = 2.0
"""A camera that gives no picture for this long is lost [s]."""
_REPORT_S = 1.0
"""Interval of the lines on the terminal [s]."""
_IN_FRONT_M = 0.02
"""Something hides a node if it is nearer to the camera by more than this [m]: the DLO's own surface and its noise are
in front of its centre line, too."""
_KEPT = 3000
"""Frames whose times are kept for the summary; the memory must not grow."""


@dataclass(frozen=True, kw_only=True)
class LiveSettings(TrackSettings):
    """How the pictures of a camera are tracked."""

    segmentation: SegmentationConfig


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """What was found in the pictures of one moment."""

    observation: Observation
    nodes: Nodes | None
    """None while the DLO has not been found yet."""
    why: str
    """Why there are none; empty where there are."""
    seconds: float
    """Time from the pictures to the nodes [s]."""


def perception_alone(
    segmentation: SegmentationConfig, box: BoxConfig | None = None, voxel_m: float = CloudConfig.voxel_m
) -> PerceptionConfig:
    """Perception without a robot: the world is where the camera's calibration puts it, and no table is assumed in it.

    `box` None: the whole world.
    """
    return PerceptionConfig(
        segmentation=segmentation,
        box=box or ANYWHERE,
        table=TableConfig(supports=False, correct_pose=False),
        cloud=CloudConfig(voxel_m=voxel_m),
    )


class LiveTracker:
    """From the pictures of a camera to nodes: the pipeline of perception, without a robot, and a `Tracker`."""

    def __init__(self, settings: LiveSettings, fixtures: Sequence[Fixture] = ()) -> None:
        """`fixtures` are believed to stand around the DLO."""
        self._settings, self._fixtures = settings, fixtures
        self.perception = perception_alone(settings.segmentation, settings.box, settings.voxel_m)
        self.segmentation: SegmentationConfig = settings.segmentation
        """Used from the next pictures on."""
        self._seen_radius_m = settings.radius_m or BelievedDlo.radius_m
        self._tracker: Tracker | None = None

    def update(self, pictures: CameraPictures) -> Frame:
        """The DLO in the next pictures."""
        begin = time.perf_counter()
        why = ""
        try:
            seen = observe(
                pictures,
                (),
                self.perception,
                self.segmentation,
                self._seen_radius_m,
                fixtures=self._fixtures,
            )
        except SkillFailure as failure:
            seen, why = without_points(pictures), failure.detail
        camera = seen.calibration
        assert camera is not None, "perception names the camera of each observation"
        if self._tracker is None:
            self._tracker = self._made(camera)
        # What a depth camera sees in front of a node hides it: a hand, or a tool.
        hiding_m = None
        if isinstance(pictures, DepthImage):
            hiding_m = np.where(pictures.depth_m > 0.0, pictures.depth_m + _IN_FRONT_M, 0.0)
        nodes = None
        try:
            nodes = self._tracker.update(
                in_camera(seen.points_world, camera),
                stamp_ns=pictures.stamp_ns,
                T_world_camera=camera.T_world_camera,
                depth=hiding_m,
            )
        except InputError as error:
            why = why or str(error)
        return Frame(observation=seen, nodes=nodes, why=why, seconds=time.perf_counter() - begin)

    def _made(self, camera: CameraCalibration) -> Tracker:
        return Tracker(
            length_m=self._settings.length_m,
            radius_m=self._settings.radius_m,
            nodes=self._settings.nodes,
            observer=self._settings.observer,
            camera_matrix=camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px),
            voxel_m=0.0,  # perception has thinned the cloud
        )


class TrackedSegmentation(Component):
    """Changes the segmentation of a `LiveTracker`, which is not a component, by the skill of perception."""

    name = "perception"
    publishes = (topics.SEGMENTATION,)

    def __init__(self, tracker: LiveTracker) -> None:
        self._tracker = tracker

    @implements(perception.SET_SEGMENTATION)
    async def set_segmentation(self, spec: StrategySpec) -> None:
        """Change the strategy that finds the DLO's pixels."""
        self._tracker.segmentation = from_spec(spec)
        self.port.publish(topics.SEGMENTATION, StrategyChosen(stamp_ns=self.port.clock.now_ns(), spec=spec))


@dataclass(kw_only=True)
class LiveSummary:
    """What happened until now; its size does not grow with the number of frames."""

    frames: int = 0
    """Pictures taken."""
    followed: int = 0
    """Frames in which the observer trusted its nodes."""
    losses: int = 0
    """Times that the camera did not answer."""
    first_mib: float = 0.0
    """Memory of the process [MiB] when enough frames had been seen that everything was loaded."""
    last_mib: float = 0.0
    """Memory of the process [MiB] now."""
    seconds: deque[float] = field(default_factory=lambda: deque[float](maxlen=_KEPT))
    """Times of the last frames, from pictures to nodes [s]."""
    periods_s: deque[float] = field(default_factory=lambda: deque[float](maxlen=_KEPT))
    """Intervals of the stamps of the last frames [s]."""
    last_stamp_ns: int | None = None

    def add(self, frame: Frame) -> None:
        """Count a frame."""
        self.frames += 1
        self.followed += frame.nodes is not None and frame.nodes.distrust is None
        self.seconds.append(frame.seconds)
        stamp_ns = frame.observation.stamp_ns
        if self.last_stamp_ns is not None:
            self.periods_s.append((stamp_ns - self.last_stamp_ns) / 1e9)
        self.last_stamp_ns = stamp_ns
        if self.frames % 100 == 0:  # asking costs more than counting
            self.last_mib = psutil.Process().memory_info().rss / 2**20
            self.first_mib = self.first_mib or self.last_mib

    def lines(self) -> Iterator[str]:
        """What to print at the end."""
        yield f"{self.followed} of {self.frames} frames followed; the camera was lost {self.losses} times"
        if self.frames:
            of_ms = np.percentile(np.array(self.seconds) * 1e3, (50, 95))
            yield f"pictures to nodes: {of_ms[0]:.1f} ms (median), {of_ms[1]:.1f} ms (95 %)"
        if self.periods_s:
            yield f"pictures: every {np.median(np.array(self.periods_s)) * 1e3:.1f} ms (median)"
        if self.first_mib:
            yield f"memory: {self.first_mib:.0f} MiB after 100 frames, {self.last_mib:.0f} MiB now"


@dataclass(frozen=True, kw_only=True)
class FollowPace:
    """How fast and how long a camera is followed."""

    rate_hz: float
    """Pictures per second, at most."""
    duration_s: float | None = None
    """None: until the pictures end."""
    again_s: float = 1.0
    """Wait before a lost camera is asked again [s]."""


Show = Callable[[CameraPictures, Frame], None]
Say = Callable[[str], None]


async def follow(
    camera: Camera,
    tracker: LiveTracker,
    show: Show,
    say: Say,
    summary: LiveSummary,
    *,
    pace: FollowPace,
) -> None:
    """Follow the DLO until the pictures or the time end.

    The next pictures are taken while the DLO is found in these. A lost camera is asked again until it answers. Raises
    `HardwareError` when it is not there at the beginning.
    """
    clock = LoopClock()
    begin_ns = reported_ns = clock.now_ns()
    period_ns = round(1e9 / pace.rate_hz)
    due_ns = begin_ns - period_ns

    async def taken() -> CameraPictures:
        nonlocal due_ns
        # A late picture is made up for by the next one, and no more than one.
        due_ns = max(due_ns + period_ns, clock.now_ns() - period_ns)
        await clock.sleep_until(due_ns)
        return await camera.capture(TIMEOUT_S)

    with camera:
        coming = asyncio.create_task(taken())
        try:
            while pace.duration_s is None or clock.now_ns() - begin_ns < pace.duration_s * 1e9:
                try:
                    pictures = await coming
                except NoMorePictures as end:
                    say(str(end))
                    return
                except HardwareError as error:
                    summary.losses += 1
                    say(f"the camera is lost: {error}; it is asked again, Ctrl-C ends")
                    await clock.sleep(pace.again_s)
                    coming = asyncio.create_task(taken())
                    continue
                coming = asyncio.create_task(taken())
                frame = await asyncio.to_thread(tracker.update, pictures)
                summary.add(frame)
                show(pictures, frame)
                if clock.now_ns() - reported_ns >= _REPORT_S * 1e9 or summary.frames == 1:
                    reported_ns = clock.now_ns()
                    say(_line(summary, frame))
        finally:
            await end_tasks(coming)


def _line(summary: LiveSummary, frame: Frame) -> str:
    begin = f"frame {summary.frames}: {len(frame.observation.points_world)} points"
    if frame.nodes is None:
        return f"{begin}; the DLO is not found yet: {frame.why}"
    nodes = frame.nodes
    distrust = (
        ""
        if nodes.distrust is None
        else f", not trusted: {nodes.distrust.value}{f' ({frame.why})' if frame.why else ''}"
    )
    shown = f"{np.count_nonzero(nodes.visible)} of {len(nodes.visible)} nodes visible"
    return f"{begin}, {shown}, health {nodes.health:.2f}{distrust}, {frame.seconds * 1e3:.0f} ms"


@contextmanager
def nodes_file(path: Path | None) -> Generator[Callable[[Frame], None]]:
    """Yield a function that writes the nodes of a frame to a .csv file at once; None writes nothing."""
    if path is None:
        yield lambda frame: None
        return
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("stamp_ns", *NODE_COLUMNS))

        def write(frame: Frame) -> None:
            if frame.nodes is not None:
                writer.writerows(node_rows(frame.nodes, frame.nodes.stamp_ns))

        yield write


async def follow_in_system(
    camera: Camera,
    tracker: LiveTracker,
    write: Callable[[Frame], None],
    say: Say,
    summary: LiveSummary,
    *,
    run: RunConfig,
    pace: FollowPace,
    transport: Transport,
) -> None:
    """As `follow`, beside the viewer and the components that track with it, which get what is found on `transport`.

    The page in the browser stays after the last picture until it is cancelled; a `run` that is headless has none. `run`
    also has the nodes, and the installation that the page draws.
    """
    tools = segmentation_tools(tracker.perception, look=False, group="segmentation", has_file=False)
    viewer = None if run.headless else build_viewer(run, operated=False, segmentation=tools)
    names = [row.name for row in trackers_of_run(run)]
    host = assemble(names, run, Wiring(transport=transport))
    if viewer is not None:
        host.add(viewer)
        host.add(TrackedSegmentation(tracker))

    def show(pictures: CameraPictures, frame: Frame) -> None:
        write(frame)
        if host.components:
            _publish(transport, pictures, frame)

    async with host, host.guarded():
        if viewer is not None:
            await viewer.opened.wait()
            say(f"viewer: {viewer.url}")
        await follow(camera, tracker, show, say, summary, pace=pace)
        if viewer is not None and pace.duration_s is None:
            say("The page stays open; Ctrl-C closes it.")
            await host.wait_failed()


def _publish(transport: Transport, pictures: CameraPictures, frame: Frame) -> None:
    match pictures:
        case StereoImages():
            transport.publish(topics.STEREO_IMAGES, pictures)
        case DepthImage():
            transport.publish(topics.DEPTH_IMAGES, pictures)
    transport.publish(topics.OBSERVATION, frame.observation)
    if frame.nodes is not None:
        state = DloState(
            stamp_ns=frame.nodes.stamp_ns,
            nodes_world=frame.nodes.positions_world,
            topology=frame.nodes.topology,
            visible=frame.nodes.visible,
            observed_stamp_ns=frame.nodes.stamp_ns,
            health=frame.nodes.health,
        )
        transport.publish(topics.STATE, state)
