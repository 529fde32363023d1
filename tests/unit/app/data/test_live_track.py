"""`dlokit track --camera`: a DLO in the pictures of a camera, without a robot."""

import asyncio
import csv
import threading
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import msgspec
import numpy as np
import pytest
from cable_pictures import CAMERA, bow, picture
from scipy.spatial import KDTree

from dlokit.app.commands import execute
from dlokit.app.data.live_track import (
    FollowPace,
    Frame,
    LiveSettings,
    LiveSummary,
    LiveTracker,
    TrackedSegmentation,
    follow,
    follow_in_system,
)
from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.errors import ConfigError, HardwareError, InputError, NoMorePictures
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.perception import api as perception
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig
from dlokit.skills.perception.config import from_spec, to_spec
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.system.config import RunConfig
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage
from dlokit.types.observation import DistrustReason
from dlokit.types.outcome import Succeeded

SHIFTS_M = [0.002 * number for number in range(10)]
FAST = FollowPace(rate_hz=1000.0, again_s=0.01)
SETTINGS = LiveSettings(
    observer=ObserverConfig().strategy, segmentation=BrightnessConfig(), nodes=31, length_m=None, box=None
)


class Scripted:
    """A camera that gives pictures, raises errors, and then has no more."""

    def __init__(self, *given: DepthImage | HardwareError) -> None:
        self.given = list(given)

    @property
    def calibration(self) -> CameraCalibration:
        return CAMERA

    async def capture(self, timeout_s: float) -> DepthImage:
        if not self.given:
            raise NoMorePictures("all have been played")
        one = self.given.pop(0)
        if isinstance(one, HardwareError):
            raise one
        return one

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass


def pictures() -> list[DepthImage]:
    return [picture(shift, 33_000_000 * (number + 1)) for number, shift in enumerate(SHIFTS_M)]


def followed(*given: DepthImage | HardwareError) -> tuple[list[Frame], LiveSummary, list[str]]:
    frames: list[Frame] = []
    said: list[str] = []
    summary = LiveSummary()
    camera = Scripted(*given)
    asyncio.run(
        follow(camera, LiveTracker(SETTINGS), lambda _, frame: frames.append(frame), said.append, summary, pace=FAST)
    )
    return frames, summary, said


def write_folder(folder: Path) -> None:
    write_calibration(folder / "calibration.toml", CAMERA)
    for number, image in enumerate(pictures()):
        cv2.imwrite(str(folder / f"colour_{number:03}.png"), image.pixels[..., ::-1])
        cv2.imwrite(str(folder / f"depth_{number:03}.png"), np.round(image.depth_m * 1000).astype(np.uint16))


def test_every_picture_is_followed_and_the_nodes_lie_on_the_cable():
    frames, summary, _ = followed(*pictures())
    assert (summary.frames, summary.followed, summary.losses) == (10, 10, 0)
    for frame, shift in zip(frames, SHIFTS_M, strict=True):
        assert frame.nodes is not None
        # The noise of the depth, 1 mm, and pixels of 1.3 mm; a node moves by 2 mm from picture to picture.
        assert np.max(KDTree(bow(shift)).query(frame.nodes.positions_world)[0]) < 0.005


def test_the_next_picture_is_taken_while_the_dlo_is_found_in_this_one():
    asked_again = threading.Event()

    class Counting(Scripted):
        async def capture(self, timeout_s: float) -> DepthImage:
            if len(self.given) < 2:
                asked_again.set()
            return await super().capture(timeout_s)

    class Waiting(LiveTracker):
        def update(self, pictures: CameraPictures) -> Frame:
            assert asked_again.wait(20.0), "the second picture is asked for after the first was processed"
            return super().update(pictures)

    summary = LiveSummary()
    asyncio.run(
        follow(Counting(*pictures()[:2]), Waiting(SETTINGS), lambda *_: None, lambda _: None, summary, pace=FAST)
    )
    assert summary.frames == 2


def test_what_is_in_front_of_the_cable_hides_its_nodes():
    hand = picture(SHIFTS_M[2], 99_000_000)
    hand.pixels[60:140] = 30
    hand.depth_m[60:140] = 0.6
    frames, summary, _ = followed(*pictures()[:2], hand)
    nodes = frames[-1].nodes
    assert nodes is not None
    assert 3 <= np.count_nonzero(~nodes.visible) <= 12
    assert summary.followed == 3


def test_a_lost_camera_is_asked_again_and_an_unseen_cable_is_waited_for():
    empty = picture(0.0, 1)
    empty.pixels[:] = 30
    frames, summary, said = followed(empty, HardwareError("the cable is out"), *pictures()[:2])
    assert frames[0].nodes is None
    assert summary.losses == 1
    assert summary.followed == 2
    assert any("the cable is out" in line for line in said)
    assert "not found yet" in said[0]
    assert "2 of 3 frames followed" in next(summary.lines())


def test_a_picture_of_which_the_segmentation_takes_too_much_is_named_and_tracking_goes_on():
    first, light, *rest = pictures()
    light = msgspec.structs.replace(light, pixels=np.full_like(light.pixels, 215))
    frames, summary, said = followed(msgspec.structs.replace(light, stamp_ns=1), first, light, *rest)
    assert "the segmentation brightness takes 100% of the picture" in frames[0].why
    assert frames[2].nodes is not None
    assert frames[2].nodes.distrust is DistrustReason.NO_POINTS
    assert "100% of the picture" in frames[2].why
    assert summary.followed == len(frames) - 2
    assert "takes 100% of the picture" in said[0]


def test_one_command_follows_recorded_pictures_and_writes_the_nodes(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    write_folder(tmp_path)
    out = tmp_path / "out"
    arguments = ["track", "--camera", "recorded", "--camera.path", str(tmp_path), "--headless", "--out", str(out)]
    assert execute([*arguments, "--rate-hz", "1000"]) == 0
    assert "10 of 10 frames followed" in capsys.readouterr().out
    with (out / "nodes.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 10 * 31
    assert set(rows[0]) == {"stamp_ns", "node", "x_m", "y_m", "z_m", "visible", "distrust"}


@pytest.mark.live
def test_the_page_shows_the_camera_and_stays_after_the_last_picture():
    said: list[str] = []

    async def main() -> None:
        ended = asyncio.Event()

        def say(text: str) -> None:
            said.append(text)
            if "stays open" in text:
                ended.set()

        page = follow_in_system(
            Scripted(*pictures()[:3]),
            LiveTracker(SETTINGS),
            lambda frame: None,
            say,
            LiveSummary(),
            run=replace(RunConfig(), viewer=ViewerConfig(port=0)),
            pace=FAST,
            transport=MemoryTransport(),
        )
        showing = asyncio.create_task(page)
        async with asyncio.timeout(60.0):
            await ended.wait()
        assert not showing.done()
        showing.cancel()
        await asyncio.wait({showing})

    asyncio.run(main())
    assert said[0].startswith("viewer: http://127.0.0.1:")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--camera", "simulated"], "sees the simulated cell.*takes recorded, genicam"),
        (["--camera", "recorded"], r"--camera\.path"),
        (["--camera", "webcam"], "'webcam' is not known"),
        (["a.pcd", "--camera", "recorded", "--camera.path", "x"], "omit the clouds"),
        (["--camera", "recorded", "--camera.path", "x", "--rate-hz", "0"], "above 0"),
        ([], "no cloud is given.*--camera"),
    ],
)
def test_what_cannot_work_is_named(arguments: list[str], says: str):
    with pytest.raises((InputError, ConfigError), match=says):
        execute(["track", *arguments])


def test_the_radius_of_the_settings_is_the_trackers():
    with pytest.raises(InputError, match=r"radius_m is 2\.0"):
        LiveTracker(replace(SETTINGS, radius_m=2.0)).update(picture(0.0, 1))


def test_the_page_changes_the_segmentation_of_the_next_pictures() -> None:
    tracker, bus = LiveTracker(SETTINGS), MemoryTransport()
    none = ColourConfig(lowest_hue_deg=90.0, highest_hue_deg=91.0)

    async def main() -> None:
        host = Container(bus, LoopClock())
        host.add(TrackedSegmentation(tracker))
        async with host:
            assert isinstance(await bus.call(perception.SET_SEGMENTATION, to_spec(none)), Succeeded)
            chosen = bus.latest(topics.SEGMENTATION).value
            assert chosen is not None
            assert from_spec(chosen.spec) == none

    assert len(tracker.update(picture(0.0, 1)).observation.points_world) > 0
    virtual_time.run(main())
    assert len(tracker.update(picture(0.0, 2)).observation.points_world) == 0
