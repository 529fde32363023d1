"""What the page changes of the segmentation reaches perception, and what perception uses is on the page."""

import asyncio
import dataclasses
from collections.abc import Callable, Coroutine
from typing import ClassVar

import numpy as np
import pytest

from dlokit.app.commands import parse
from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.scene import Scene
from dlokit.errors import SkillFailure, SkillRejected
from dlokit.geometry import pose
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.perception import api as perception
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig
from dlokit.skills.perception.config import SEGMENTATIONS, from_spec, to_spec
from dlokit.skills.viewer.panel.health import ComponentHealth, WatchedComponent
from dlokit.skills.viewer.panel.segmentation import masked, picture_html, said_html, step_of
from dlokit.skills.viewer.segmentation import SegmentationTools, SegmentationTuner, flags, table
from dlokit.skills.viewer.state import Received
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import from_toml
from dlokit.types.flow import RunPhase, RunStatus
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, SegmentedPicture
from dlokit.types.observation import LookResult
from dlokit.types.system import StrategyChosen, StrategyProposal, StrategySpec

BLUE = ColourConfig(lowest_hue_deg=200.0, highest_hue_deg=240.0, least_saturation=90)
CAMERA = CameraCalibration(
    width_px=40, height_px=30, fx_px=50.0, fy_px=50.0, cx_px=20.0, cy_px=15.0, T_world_camera=pose((0.0, 0.0, 1.0))
)


def pictures() -> DepthImage:
    return DepthImage(
        stamp_ns=1,
        pixels=np.zeros((30, 40, 3), dtype=np.uint8),
        depth_m=np.ones((30, 40), dtype=np.float32),
        calibration=CAMERA,
    )


class Eye(Component):
    """Perception that takes a while to answer."""

    name = "perception"
    publishes = (topics.SEGMENTATION,)

    def __init__(self) -> None:
        self.had: list[SegmentationConfig] = []
        self.looks = 0
        self.holds = False

    @implements(perception.SET_SEGMENTATION)
    async def set_segmentation(self, spec: StrategySpec) -> None:
        await self.port.clock.sleep(0.02)
        if self.holds:
            raise SkillRejected("dlo_held", "the gripper of first holds the DLO")
        self.had.append(from_spec(spec))
        self.port.publish(topics.SEGMENTATION, StrategyChosen(stamp_ns=1, spec=spec))

    @implements(perception.LOOK)
    async def look(self) -> LookResult:
        self.looks += 1
        raise SkillFailure("no_points", "by the test")


class TunedPage(Component):
    name = "viewer"

    def __init__(self) -> None:
        self.seen = Received(())
        self.previews: list[SegmentationConfig] = []
        tools = SegmentationTools(
            kind=SEGMENTATIONS,
            configured=BrightnessConfig(lowest=100),
            set_segmentation=perception.SET_SEGMENTATION,
            look=perception.LOOK,
            preview=self._preview,
            propose=self._propose,
        )
        self.tuner = SegmentationTuner(tools, self.seen, Scene(), lambda: self.port)

    @on(topics.SEGMENTATION)
    async def on_segmentation(self, chosen: StrategyChosen) -> None:
        self.seen.segmentation.put(chosen)

    async def drawn(self, seconds: float = 1.0) -> None:
        """Draw the page for a while, as the viewer does."""
        for _ in range(round(seconds * 30)):
            self.tuner.show()
            await asyncio.sleep(1 / 30)

    def _preview(
        self, images: CameraPictures, robots: tuple[PosedArm, ...], settings: SegmentationConfig, width_px: int
    ) -> SegmentedPicture:
        self.previews.append(settings)
        return shown()

    def _propose(self, images: CameraPictures, at: tuple[int, int], settings: SegmentationConfig) -> StrategyProposal:
        if at == (39, 29):
            return StrategyProposal(spec=None, text="Nothing is proposed: by the test.")
        if at[0] >= 40:
            raise ValueError("pixel 40, 0 is outside the picture")
        return StrategyProposal(spec=to_spec(BLUE), text="Proposed.")


def shown(problem: str = "") -> SegmentedPicture:
    pixels, nothing = np.zeros((2, 2, 3), dtype=np.uint8), np.zeros((2, 2), dtype=np.uint8)
    used, dropped = nothing.copy(), nothing.copy()
    used[0, 0] = dropped[1, 1] = 255
    return SegmentedPicture(pixels=pixels, used=used, dropped=dropped, fraction=0.25, problem=problem)


def _tuning(body: Callable[[TunedPage, Eye], Coroutine[None, None, None]]) -> None:
    async def main() -> None:
        host = Container(MemoryTransport(), LoopClock())
        page, eye = TunedPage(), Eye()
        host.add(page)
        host.add(eye)
        async with host:
            await body(page, eye)
            await page.tuner.close()

    virtual_time.run(main())


def test_a_dragged_slider_ends_with_its_last_value_in_few_calls() -> None:
    async def body(page: TunedPage, eye: Eye) -> None:
        for lowest in range(100, 160):
            page.tuner.change({"lowest": lowest})
            await asyncio.sleep(0.03)
        await asyncio.sleep(1.0)
        assert eye.had[-1] == BrightnessConfig(lowest=159)
        assert 5 <= len(eye.had) <= 15  # in 1.8 s, one in 0.17 s

    _tuning(body)


def test_the_mask_follows_the_sliders_and_the_pictures() -> None:
    async def body(page: TunedPage, eye: Eye) -> None:
        await page.drawn()
        assert page.tuner.picture is None
        page.seen.pictures.put(pictures())
        await page.drawn()
        assert page.previews == [BrightnessConfig(lowest=100)]
        page.tuner.change({"lowest": 120})
        await page.drawn()
        page.seen.pictures.put(pictures())
        await page.drawn()
        assert [each.lowest for each in page.previews if isinstance(each, BrightnessConfig)] == [100, 120, 120]
        assert page.tuner.size_px == (40, 30)

    _tuning(body)


def test_values_that_do_not_fit_together_are_named_and_not_sent() -> None:
    async def body(page: TunedPage, eye: Eye) -> None:
        page.tuner.change({"lowest": 200, "highest": 150})
        await asyncio.sleep(1.0)
        assert "it must be at most highest (150)" in page.tuner.notice
        assert eye.had == []
        page.tuner.change({"lowest": 200, "highest": 210})
        await asyncio.sleep(1.0)
        assert page.tuner.notice == ""
        assert eye.had == [BrightnessConfig(lowest=200, highest=210)]

    _tuning(body)


@dataclasses.dataclass(frozen=True)
class OddConfig:
    """Settings of another package, which checks them as it likes."""

    name: ClassVar[str] = "odd"
    level: int = 1

    def __post_init__(self) -> None:
        if self.level % 2 == 0:
            raise ValueError(f"level is {self.level}; it must be odd")


def test_values_that_another_packages_settings_refuse_are_not_used_and_the_reason_is_shown() -> None:
    async def body(page: TunedPage, eye: Eye) -> None:
        page.tuner.settings = OddConfig()
        page.tuner.change({"level": 4})
        await asyncio.sleep(1.0)
        assert page.tuner.notice == "level is 4; it must be odd"
        assert page.tuner.settings == OddConfig()
        assert eye.had == []

    _tuning(body)


def test_settings_that_perception_refuses_are_taken_back_and_the_reason_is_shown() -> None:
    async def body(page: TunedPage, eye: Eye) -> None:
        eye.holds, moved = True, page.tuner.moved
        page.tuner.change({"lowest": 130})
        await asyncio.sleep(1.0)
        assert page.tuner.settings == BrightnessConfig(lowest=100)
        assert page.tuner.notice == "The segmentation was not changed: the gripper of first holds the DLO."
        assert page.tuner.moved > moved  # so that the sliders go back

    _tuning(body)


def test_a_click_takes_what_is_proposed_even_while_a_mask_is_computed() -> None:
    async def body(page: TunedPage, eye: Eye) -> None:
        page.seen.pictures.put(pictures())
        await page.drawn()
        page.seen.pictures.put(pictures())
        page.tuner.show()  # begins the next mask
        page.tuner.click((3, 4))
        await page.drawn()
        assert eye.had == [BLUE]
        assert (page.tuner.settings, page.tuner.notice) == (BLUE, "Proposed.")
        page.tuner.change({"least_value": 99})  # a click proposes once
        await page.drawn()
        assert page.tuner.settings == dataclasses.replace(BLUE, least_value=99)

    _tuning(body)


@pytest.mark.parametrize(("pixel", "says"), [((39, 29), "by the test"), ((40, 0), "outside the picture")])
def test_a_click_that_proposes_nothing_changes_nothing_and_says_why(pixel: tuple[int, int], says: str) -> None:
    async def body(page: TunedPage, eye: Eye) -> None:
        page.seen.pictures.put(pictures())
        await page.drawn()
        page.tuner.click(pixel)
        await page.drawn()
        assert eye.had == []
        assert says in page.tuner.notice

    _tuning(body)


@pytest.mark.parametrize(("phase", "looks"), [(RunPhase.WAITING, 1), (RunPhase.RUNNING, 0)])
def test_a_run_that_waits_looks_again_after_a_change(phase: RunPhase, looks: int) -> None:
    async def body(page: TunedPage, eye: Eye) -> None:
        page.seen.record_run(RunStatus(stamp_ns=1, phase=phase))
        page.tuner.choose("colour")
        await asyncio.sleep(1.0)
        assert eye.had == [ColourConfig()]
        assert eye.looks == looks

    _tuning(body)


def test_the_page_follows_another_programs_call_and_returns_to_the_start() -> None:
    async def body(page: TunedPage, eye: Eye) -> None:
        await page.port.call(perception.SET_SEGMENTATION, to_spec(BLUE))
        await page.drawn()
        assert page.tuner.settings == BLUE
        page.tuner.reset()
        await page.drawn()
        assert eye.had[-1] == BrightnessConfig(lowest=100)

    _tuning(body)


def test_a_restarted_perception_gets_the_settings_again() -> None:
    def health(restarts: int) -> list[ComponentHealth]:
        watched = WatchedComponent(name="perception", process="camera")
        return [ComponentHealth(component=watched, alive=True, restarts=restarts)]

    async def body(page: TunedPage, eye: Eye) -> None:
        page.tuner.on_health(health(0))
        page.tuner.change({"lowest": 130})
        await asyncio.sleep(1.0)
        for restarts in (1, 1):
            page.tuner.on_health(health(restarts))
            await asyncio.sleep(1.0)
        assert eye.had == [BrightnessConfig(lowest=130)] * 2

    _tuning(body)


def test_the_shown_lines_begin_a_run_with_the_settings() -> None:
    group = "perception.segmentation"
    options = flags(BLUE, group)
    assert options == (
        "--segmentation colour --perception.segmentation.lowest-hue-deg 200 "
        "--perception.segmentation.highest-hue-deg 240 --perception.segmentation.least-saturation 90"
    )
    assert parse(["shape", *options.split()]).run.perception.segmentation == BLUE
    assert from_toml(table(BLUE, group), RunConfig, "the page").perception.segmentation == BLUE
    assert parse(["track", "--camera", "recorded", *flags(BLUE, "segmentation").split()]).segmentation_settings == BLUE


def test_the_mask_covers_the_picture_in_two_colours() -> None:
    drawn = masked(shown())
    assert len({tuple(map(int, pixel)) for pixel in drawn.reshape(-1, 3)}) == 3
    assert (drawn[0, 1] == 0).all()


def test_the_picture_knows_the_pixels_that_a_click_means() -> None:
    html = picture_html(shown(), (1024, 896))
    assert 'data-width="1024" data-height="896"' in html
    assert "25.0% of the picture" in html


def test_what_is_said_is_escaped_and_a_sentence() -> None:
    assert ">The &lt;mask&gt; is empty.</div>" in said_html("the <mask> is empty")


@pytest.mark.parametrize(
    ("least", "most", "whole", "step"), [(0, 255, True, 1), (0.0, 360.0, False, 1.0), (0.0, 1.0, False, 0.001)]
)
def test_a_slider_has_steps_fine_enough(least: float, most: float, whole: bool, step: float) -> None:
    assert step_of(least, most, whole=whole) == pytest.approx(step)
