"""A video of a run for people: the cell rendered again, or the recorded pictures, with a caption below.

The goal is drawn into the pictures, and into recorded ones also the believed fixtures. The caption shows the time, the
step of the flow, the actions and the error.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from dlokit import geometry
from dlokit.communication import topics
from dlokit.description.scene import Fixture
from dlokit.errors import InputError
from dlokit.extras.export.frames import known_config
from dlokit.extras.export.pictures import RecordedPictures, resized, scene_of
from dlokit.extras.export.video_file import VideoFile
from dlokit.geometry.camera import camera_alone, camera_matrix, in_camera
from dlokit.recording.reader import read_recording
from dlokit.skills.viewer import palette
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.dlo import GoalShape
from dlokit.types.flow import FlowStatus
from dlokit.types.image import CameraCalibration, DepthImage, StereoImages

WIDTH_PX = 720
"""Usual width of a rendered video [px]; its pictures are 3:2."""
HOLD_S = 2.0
"""Duration of the last picture, with the outcome in the caption [s of the video]."""
_CAPTION_PER_WIDTH = 1 / 15
"""Height of the caption over the width of the video."""
_LETTERS_PER_PX = 0.6 / 64
"""Ratio of the letters' scale to the height of the caption, so that two lines fit."""
_INK, _PAPER, _GOAL = (235, 235, 235), (24, 26, 30), (90, 210, 110)
_NEAREST_M = 0.05
"""Points nearer to the camera than this are not drawn [m]."""


@dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """Settings of the conversion of a run to a video."""

    fps: int = 25
    speed: float = 1.0
    """Seconds of the run per second of the video."""
    width_px: int | None = None
    """Width of the video [px]; None: `WIDTH_PX`, or the width of the camera's pictures."""
    ffmpeg: str | None = None
    """The program that encodes, from `ffmpeg_program`; None: OpenCV, which takes ten times as long."""


@dataclass(frozen=True, kw_only=True)
class VideoSummary:
    """Summary of the written video."""

    duration_s: float
    size_px: tuple[int, int]
    pictures: str
    """Source of the pictures."""


def write_run_video(
    path: Path, video: Path, options: VideoOptions, progress: Callable[[int, int], None]
) -> VideoSummary:
    """Write the video of a recorded run; `progress` gets the number of written pictures and the number of all.

    After an exception there is no file. Raises `InputError` if the recording is not of a task or has no pictures.
    """
    story = _Story(path)
    count = max(round((story.last_ns - story.first_ns) / 1e9 / options.speed * options.fps), 1)
    total = count + round(HOLD_S * options.fps)
    with _view_of(path, options.width_px) as view:
        first = view.picture(story.first_ns)
        height_px, width_px = first.shape[:2]
        caption_px = 2 * round(width_px * _CAPTION_PER_WIDTH / 2)
        with VideoFile(video, options.fps, width_px, height_px + caption_px, ffmpeg=options.ffmpeg) as file:
            shown: UInt8Array = first
            for number in range(total):
                # The last moment is held.
                if number <= count:
                    time_ns = story.first_ns + round(number / count * (story.last_ns - story.first_ns))
                    picture = _with_goal(view.picture(time_ns), story.goal_world(time_ns), view.camera)
                    shown = np.vstack([picture, _caption(story, time_ns, (width_px, caption_px), options.speed)])
                file.add(shown)
                progress(number + 1, total)
        return VideoSummary(
            duration_s=total / options.fps, size_px=(width_px, height_px + caption_px), pictures=view.origin
        )


@dataclass(frozen=True, kw_only=True)
class _View:
    """Pictures of a run at any time, and the camera that took them."""

    picture: Callable[[int], UInt8Array]
    """The picture (height, width, 3), of even size, at a time on the run's clock [ns]."""
    camera: CameraCalibration | None
    """The camera; None if the recording has none."""
    origin: str


@contextmanager
def _view_of(path: Path, width_px: int | None) -> Generator[_View]:
    width = 2 * ((width_px or WIDTH_PX) // 2)
    scene = scene_of(path, view_size_px=(width, 2 * round(width / 3)))
    if isinstance(scene, str):
        yield _recorded_view(path, width_px, scene)
        return
    with closing(scene):
        yield _View(picture=scene.view, camera=scene.viewpoint, origin="rendered again")


def _recorded_view(path: Path, width_px: int | None, why: str) -> _View:
    pictures = RecordedPictures(path, why)
    config = known_config(path, ())
    fixtures = () if config is None else config.installation.fixtures
    taken = next(read_recording(path, {topics.STEREO_IMAGES.name, topics.DEPTH_IMAGES.name}), None)

    def picture(time_ns: int) -> UInt8Array:
        shot = resized(pictures.at(time_ns), width_px)
        return _with_fixtures(next(iter(shot.views.values())), fixtures, camera)

    camera = None
    if taken is not None and isinstance(taken.message, StereoImages | DepthImage):
        camera = camera_alone(taken.message.calibration, 0)
    return _View(picture=picture, camera=camera, origin=pictures.origin)


class _Story:
    """Steps, goals and settings of a run over its clock, for the caption and the drawn goal."""

    def __init__(self, path: Path) -> None:
        """Read the recording. Raises `InputError` if it has no step of a task."""
        self._statuses: list[tuple[int, FlowStatus]] = []
        self._goals: list[tuple[int, GoalShape]] = []
        last_ns = 0
        for one in read_recording(path, {topics.FLOW.name, topics.GOAL.name, topics.ROBOT_STATE.name}):
            last_ns = one.log_ns
            if isinstance(one.message, FlowStatus):
                self._statuses.append((one.log_ns, one.message))
            elif isinstance(one.message, GoalShape):
                self._goals.append((one.log_ns, one.message))
        if not self._statuses:
            raise InputError(f"{path} contains no step of a task; give the recording of a run of dlokit shape.")
        self.first_ns, self.last_ns = self._statuses[0][0], last_ns
        config = known_config(path, ("task",))
        self.threshold_m = None if config is None else config.task.threshold_m
        """The error [m] below which the run counted as converged; None if its settings cannot be read."""

    def status(self, time_ns: int) -> FlowStatus:
        """The step at a time."""
        return next((status for log_ns, status in reversed(self._statuses) if log_ns <= time_ns), self._statuses[0][1])

    def goal_world(self, time_ns: int) -> Float64Array | None:
        """The nodes (M, 3) [m] of the goal at a time; None before the first goal."""
        return next((goal.nodes_world for log_ns, goal in reversed(self._goals) if log_ns <= time_ns), None)


def _with_goal(picture: UInt8Array, goal_world: Float64Array | None, camera: CameraCalibration | None) -> UInt8Array:
    """The picture with the goal's nodes (M, 3) [m] as a dashed line."""
    if goal_world is None or camera is None:
        return picture
    scale = picture.shape[1] / camera.width_px
    places = _seen(geometry.resample(goal_world, 3 * len(goal_world)), camera) * scale
    drawn = picture.copy()
    width_px = max(round(picture.shape[1] / 480), 1)
    for number, (begin, end) in enumerate(pairwise(np.round(places * 8).tolist())):  # in eighths of a pixel
        if number % 4 < 2 and np.isfinite((*begin, *end)).all():
            (u, v), (next_u, next_v) = begin, end
            cv2.line(drawn, (int(u), int(v)), (int(next_u), int(next_v)), _GOAL, width_px, cv2.LINE_AA, shift=3)
    return drawn


def _with_fixtures(picture: UInt8Array, fixtures: Sequence[Fixture], camera: CameraCalibration | None) -> UInt8Array:
    """The picture with the outlines of fixtures."""
    if camera is None:
        return picture
    drawn = picture.copy()
    for fixture in fixtures:
        places = _seen(fixture.rims_world.reshape(-1, 3), camera) * picture.shape[1] / camera.width_px
        places = places[np.isfinite(places).all(axis=1)]
        if len(places):
            outline = cv2.convexHull(np.round(places * 8).astype(np.int32))  # in eighths of a pixel
            cv2.polylines(drawn, [outline], True, palette.FIXTURES.color, 1, cv2.LINE_AA, shift=3)
    return drawn


def _seen(points_world: Float64Array, camera: CameraCalibration) -> Float64Array:
    """Pixels (N, 2) of points (N, 3) [m] through the lens of a camera; NaN for points that are behind it."""
    points = in_camera(points_world, camera)
    K = camera_matrix(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px)
    lens = None if camera.distortion is None else camera.distortion.astype(np.float64)
    pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, lens)
    visible = points[:, 2] > _NEAREST_M
    return np.where(visible[:, None], np.asarray(pixels, dtype=np.float64).reshape(-1, 2), np.nan)


def _caption(story: _Story, time_ns: int, size_px: tuple[int, int], speed: float) -> UInt8Array:
    """The strip (height, width, 3) below the picture."""
    width_px, height_px = size_px
    strip: UInt8Array = np.full((height_px, width_px, 3), _PAPER, dtype=np.uint8)
    time_s = (time_ns - story.first_ns) / 1e9
    for number, text in enumerate(caption_lines(story.status(time_ns), time_s, speed, story.threshold_m)):
        place = (round(0.25 * height_px), round((0.4 + 0.42 * number) * height_px))
        scale, thickness = _LETTERS_PER_PX * height_px, max(round(height_px / 50), 1)
        cv2.putText(strip, text, place, cv2.FONT_HERSHEY_SIMPLEX, scale, _INK, thickness, cv2.LINE_AA)
    return strip


def caption_lines(status: FlowStatus, time_s: float, speed: float, threshold_m: float | None = None) -> tuple[str, str]:
    """The two lines of the caption for a step."""
    faster = "" if speed == 1.0 else f"   {speed:g} times real time"
    if status.outcome is None:
        # Measured before the action: the picture already shows more.
        step, action, error = status.step.replace("_", " "), f"action {status.actions + 1}", "last error"
    else:
        step = f"ended: {status.outcome.value.replace('_', ' ')}"
        action, error = "1 action" if status.actions == 1 else f"{status.actions} actions", "error"
    if status.rmse_m is None:
        return f"{time_s:.1f} s   {step}{faster}", "the error is not known yet"
    goal = "" if threshold_m is None else f", goal below {threshold_m * 1e3:.1f} mm"
    return f"{time_s:.1f} s   {step}{faster}", f"{action}   {error} {status.rmse_m * 1e3:.1f} mm{goal}"
