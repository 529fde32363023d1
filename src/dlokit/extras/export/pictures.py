"""Pictures of a run at any time: rendered again if the run was simulated, else the recorded ones."""

from collections import defaultdict
from collections.abc import Generator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from dlokit.errors import InputError, MachineError
from dlokit.extras.export.recorded_scene import RecordedScene
from dlokit.recording.reader import RawRecording, picture_file
from dlokit.recording.views import from_jpeg, from_png
from dlokit.types.arrays import Float32Array, UInt8Array
from dlokit.types.image import StereoImages

STEREO = {"view/left": "left", "view/right": "right"}
COLOUR = {"view/colour": "colour"}
DEPTH_CHANNEL = "view/depth"
"""Channels of pictures, with the names of the views."""


@dataclass(frozen=True, kw_only=True)
class Shot:
    """The pictures of one exposure."""

    views: dict[str, UInt8Array]
    """Pictures (height, width, 3) RGB by name: left and right, or colour."""
    depth_m: Float32Array | None = None
    """Depths of a depth camera (height, width) [m]; 0 where unknown."""
    age_s: float = 0.0
    """Time since the exposure [s]."""


class RenderedPictures:
    """Renders the pictures of each time."""

    origin = "rendered again, one for each frame"
    first_ns = 0

    def __init__(self, scene: RecordedScene) -> None:
        self._scene = scene

    def at(self, time_ns: int) -> Shot:
        """The pictures of that time, of age 0."""
        taken = self._scene.pictures(time_ns)
        if isinstance(taken, StereoImages):
            return Shot(views={"left": taken.left, "right": taken.right})
        return Shot(views={"colour": taken.pixels}, depth_m=taken.depth_m)


@dataclass
class _Series:
    """The recorded pictures of one view, still encoded."""

    log_ns: list[int] = field(default_factory=list[int])
    stamps_ns: list[int] = field(default_factory=list[int])
    files: list[bytes] = field(default_factory=list[bytes])


class RecordedPictures:
    """The pictures that the recording holds."""

    def __init__(self, path: Path, why: str) -> None:
        """`why` is the reason why none can be rendered. Raises `InputError` if the recording has no pictures."""
        self._series: defaultdict[str, _Series] = defaultdict(_Series)
        for channel, record in RawRecording(path=path):
            if channel in STEREO or channel in COLOUR or channel == DEPTH_CHANNEL:
                one = self._series[channel]
                one.log_ns.append(record.log_time)
                one.stamps_ns.append(record.publish_time)
                one.files.append(picture_file(record.data).data)
        self._views = COLOUR if any(name in COLOUR for name in self._series) else STEREO
        if missing := [name for name in self._views if name not in self._series]:
            raise InputError(
                f"{path} contains no {', '.join(missing)}, and pictures of it cannot be rendered: {why}. Give the "
                "recording of a run that observed the DLO, or omit the pictures of a data set with --no-images."
            )
        self._why = why
        self._last: tuple[int, Shot] | None = None

    @property
    def origin(self) -> str:
        """Their number, their rate, and why they are not rendered."""
        times = self._series[next(iter(self._views))].log_ns
        span_s = (times[-1] - times[0]) / 1e9
        rate = f"{(len(times) - 1) / span_s:.2g} per second" if span_s > 0.0 else "at one time"
        return f"{len(times)} recorded ones, {rate}, each repeated until the next; {self._why}"

    @property
    def first_ns(self) -> int:
        """Arrival of the first pictures."""
        return max(self._series[name].log_ns[0] for name in self._views)

    def at(self, time_ns: int) -> Shot:
        """The last recorded pictures that had arrived by that time, decoded."""
        first = self._series[next(iter(self._views))]
        whole = min(len(one.files) for one in self._series.values())  # the last of a cut recording may be partial
        place = min(max(int(np.searchsorted(first.log_ns, time_ns, side="right")) - 1, 0), whole - 1)
        age_s = max(time_ns - first.stamps_ns[place], 0) / 1e9
        if self._last is None or self._last[0] != place:
            views = {name: from_jpeg(self._series[channel].files[place]) for channel, name in self._views.items()}
            depths = self._series[DEPTH_CHANNEL].files if DEPTH_CHANNEL in self._series else []
            self._last = (place, Shot(views=views, depth_m=from_png(depths[place]) if depths else None))
        shot = self._last[1]
        return Shot(views=shot.views, depth_m=shot.depth_m, age_s=age_s)


RunPictures = RenderedPictures | RecordedPictures
"""The pictures of a run at any time on its clock [ns], the time of the first, and a text on their source."""


@contextmanager
def pictures_of(path: Path) -> Generator[RunPictures]:
    """The pictures of a run. Raises `InputError` when it has none, `MachineError` without OpenGL."""
    scene = scene_of(path)
    if isinstance(scene, str):
        yield RecordedPictures(path, scene)
        return
    with closing(scene):
        yield RenderedPictures(scene)


def scene_of(path: Path, *, view_size_px: tuple[int, int] | None = None) -> RecordedScene | str:
    """The cell of a run, or the reason why there is none. Raises `MachineError` if the model of its arm is missing."""
    try:
        return RecordedScene(path, view_size_px=view_size_px)
    except MachineError:
        raise
    except InputError as error:
        return str(error).rstrip(".")


def resized(shot: Shot, width_px: int | None) -> Shot:
    """The pictures at another width, with even width and height; depths are taken from the nearest pixels."""

    def size(shape: tuple[int, ...]) -> tuple[int, int]:
        width = shape[1] if width_px is None else width_px
        return 2 * (width // 2), 2 * round(shape[0] * width / shape[1] / 2)

    views = {
        name: np.asarray(cv2.resize(view, size(view.shape), interpolation=cv2.INTER_AREA), dtype=np.uint8)
        for name, view in shot.views.items()
    }
    depth = shot.depth_m
    if depth is not None:
        depth = np.asarray(cv2.resize(depth, size(depth.shape), interpolation=cv2.INTER_NEAREST), dtype=np.float32)
    return Shot(views=views, depth_m=depth, age_s=shot.age_s)
