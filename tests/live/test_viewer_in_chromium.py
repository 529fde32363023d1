"""The viewer in a real browser, used with a real mouse."""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from chromium import LONG_S, NEEDS_CHROMIUM, TEST_S, collect_errors, drawn, launched, new_page, pixel
from made_states import ARM_AT_REST
from msgspec import structs
from playwright.async_api import Browser, Page, async_playwright

from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.franka import PANDA
from dlokit.description.point_files import points_of_csv
from dlokit.description.scene import Post, Scene
from dlokit.description.shapes import builtin_shape
from dlokit.geometry import downward, pose, tangents
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.model import api as model
from dlokit.skills.perception import api as perception
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig
from dlokit.skills.perception.config import SEGMENTATIONS, PerceptionConfig, from_spec
from dlokit.skills.perception.pipeline import segmentation_preview
from dlokit.skills.perception.proposal import proposed
from dlokit.skills.planning import api as planning
from dlokit.skills.robot import api as robot
from dlokit.skills.viewer.component import ViewerComponent
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.skills.viewer.goal.editor import GoalSkills, RodOutline
from dlokit.skills.viewer.goal.frames import HEIGHT_M, SCALE_M
from dlokit.skills.viewer.operator_input import ArmButtons
from dlokit.skills.viewer.panel.health import WatchedComponent
from dlokit.skills.viewer.segmentation import SegmentationTools
from dlokit.skills.viewer.serving.address import RunFiles
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import (
    Command,
    FlowStatus,
    GoalFrame,
    GoalFrames,
    RunOutcome,
    RunPhase,
    RunStatus,
    TaskEnd,
)
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, SegmentedPicture
from dlokit.types.passing import SideWish
from dlokit.types.system import StrategyChosen, StrategySpec

FLOW = (
    ("look", "seen", "compare"),
    ("compare", "far", "move"),
    ("compare", "close", "converged"),
    ("move", "done", "look"),
)
ROD = RodOutline(nodes=31, length_m=0.5, radius_m=0.004)
STRAIGHT = builtin_shape("I", ROD.length_m, ROD.nodes, radius_m=ROD.radius_m)
"""Goal rod before an operator has set a goal, (31, 3) [m]."""
SCENE = Scene(fixtures=(Post(name="A", position_m=(0.452, -0.22, 0.0)), Post(name="B", position_m=(0.567, 0.02, 0.0))))
ABOVE = downward([0.5, 0.0, 1.0], 0.0)
"""Pose of the camera."""
pytestmark = NEEDS_CHROMIUM


class Visit:
    """The page of a running viewer, and what it is connected to."""

    def __init__(
        self, browser: Browser, page: Page, bus: MemoryTransport, url: str, requests: list[str], arm: "Arm"
    ) -> None:
        self.browser, self.page, self.bus, self.url, self.requests, self.arm = browser, page, bus, url, requests, arm
        self._markers = count(100)

    async def scene_picture(self) -> UInt8Array:
        """The scene in the browser, (H, W, 3) BGR, without the panel next to it."""
        png = await self.page.locator("canvas").first.screenshot()
        picture = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        return np.asarray(picture, dtype=np.uint8)

    async def drawn(self) -> None:
        """Wait until the page has drawn all that the viewer has sent: messages arrive in their order."""
        error_mm = next(self._markers)
        self.bus.publish(topics.FLOW, _status("look", error_mm / 1000.0))
        await self.page.get_by_text(f"RMSE {error_mm}.0 mm").wait_for()
        await drawn(self.page)

    async def pixel(self, point_world: Float64Array) -> Float64Array:
        """Position of a point (3,) [m] on the page [px]."""
        return await pixel(self.page, point_world)

    async def drag(self, start_px: Float64Array, end_px: Float64Array) -> None:
        """Press, move in steps, release."""
        await self.page.mouse.move(*start_px)
        await drawn(self.page)  # the gizmo answers only after the browser has drawn it as hovered
        await self.page.mouse.down()
        await self.page.mouse.move(*end_px, steps=4)
        await self.page.mouse.up()


class Model(Component):
    """Publishes each goal that the page sets; a drag ends on the straight rod."""

    name = "model"
    publishes = (topics.GOAL,)

    @implements(model.SET_GOAL)
    async def set_goal(
        self,
        nodes_world: Float64Array,
        name: str = "goal",
        ends_interchangeable: bool = False,
        beside: tuple[SideWish, ...] | None = None,
    ) -> GoalShape:
        goal = GoalShape(stamp_ns=1, nodes_world=nodes_world, name=name)
        self.port.publish(topics.GOAL, goal)
        return goal

    @implements(model.BUILD_GOAL)
    async def build_goal(self, frames: tuple[GoalFrame, ...]) -> GoalShape:
        return await self.set_goal(STRAIGHT, "frames")


class Planning(Component):
    """Finds that straight goals hold and others spring back."""

    name = "planning"
    publishes = (topics.GOAL_VERDICT,)

    @implements(planning.JUDGE_GOAL)
    async def judge_goal(self, goal: GoalShape, threshold_m: float) -> GoalVerdict:
        straight = np.ptp(goal.nodes_world[:, 0]) < 0.01
        verdict = GoalVerdict(
            stamp_ns=1,
            standing=Standing.HOLDS if straight else Standing.DOUBTFUL,
            threshold_m=threshold_m,
            goal_world=goal.nodes_world,
        )
        self.port.publish(topics.GOAL_VERDICT, verdict)
        return verdict


class Arm(Component):
    """Records the commands of a person's buttons, and publishes whether it is stopped."""

    name = "robot"
    publishes = (topics.ROBOT_STATE,)

    def __init__(self) -> None:
        super().__init__()
        self.asked = asyncio.Queue[str]()

    @implements(robot.STOP)
    async def stop(self) -> None:
        self.asked.put_nowait("stop")
        self._say(latched=True)

    @implements(robot.ENABLE)
    async def enable(self) -> None:
        self.asked.put_nowait("enable")
        self._say(latched=False)

    def _say(self, *, latched: bool) -> None:
        state = structs.replace(
            ARM_AT_REST,
            stamp_ns=1,
            q_rad=PANDA.home_q_rad,
            T_world_tcp=downward([0.5, 0.0, 0.3], 0.0),
            finger_width_m=0.08,
            stop_latched=latched,
        )
        self.port.publish(topics.ROBOT_STATE, state)


class Eye(Component):
    """Publishes each segmentation that the page sets."""

    name = "perception"
    publishes = (topics.DEPTH_IMAGES, topics.SEGMENTATION)

    @implements(perception.SET_SEGMENTATION)
    async def set_segmentation(self, spec: StrategySpec) -> None:
        self.port.publish(topics.SEGMENTATION, StrategyChosen(stamp_ns=1, spec=spec))


def _preview(
    images: CameraPictures, robots: tuple[PosedArm, ...], settings: SegmentationConfig, width_px: int
) -> SegmentedPicture:
    return segmentation_preview(images, robots, settings, PerceptionConfig(), width_px)


def _blue_dlo() -> DepthImage:
    """A blue DLO on a light table, from the left to the right of the picture, a third from its top."""
    picture = np.full((240, 320, 3), (180, 150, 110), dtype=np.uint8)
    picture[78:83, 20:300] = (20, 50, 160)
    calibration = CameraCalibration(
        width_px=320, height_px=240, fx_px=300.0, fy_px=300.0, cx_px=160.0, cy_px=120.0, T_world_camera=ABOVE
    )
    return DepthImage(
        stamp_ns=1, pixels=picture, depth_m=np.ones((240, 320), dtype=np.float32), calibration=calibration
    )


@asynccontextmanager
async def _served(
    *, operated: bool = True, files: RunFiles | None = None
) -> AsyncGenerator[tuple[ViewerComponent, MemoryTransport, Arm]]:
    """A viewer that serves its page, its bus, and the arm on it."""
    bus = MemoryTransport()
    host = Container(bus, LoopClock())
    viewer = ViewerComponent(
        ViewerConfig(port=0),
        flow=FLOW,
        rod=ROD,
        scene=SCENE,
        threshold_m=0.012,
        operated=operated,
        buttons=(ArmButtons(stop=robot.STOP, enable=robot.ENABLE),),
        goals=GoalSkills(set_goal=model.SET_GOAL, build_goal=model.BUILD_GOAL, judge_goal=planning.JUDGE_GOAL),
        watched=(WatchedComponent(name="robot", process="robot"), WatchedComponent(name="model", process="simulation")),
        files=files,
        segmentation=SegmentationTools(
            kind=SEGMENTATIONS,
            configured=BrightnessConfig(),
            set_segmentation=perception.SET_SEGMENTATION,
            look=None,
            preview=_preview,
            propose=proposed,
        ),
    )
    arm = Arm()
    for component in (viewer, arm, Model(), Planning(), Eye()):
        host.add(component)
    async with host:
        await asyncio.wait_for(viewer.opened.wait(), LONG_S)
        bus.publish(topics.FLOW, _status("look", 0.050))
        bus.publish(topics.RUN, _run(RunPhase.WAITING))
        yield viewer, bus, arm


@asynccontextmanager
async def _page(browser: Browser, width_px: int, height_px: int, refused: str = "") -> AsyncGenerator[Page]:
    """An empty page, which has no errors but those that contain `refused`."""
    page = await new_page(browser, width_px, height_px)
    errors: list[str] = []
    collect_errors(page, errors)
    try:
        yield page
    finally:
        await page.close()
    assert [error for error in errors if not refused or refused not in error] == []


@asynccontextmanager
async def _visit(files: RunFiles) -> AsyncGenerator[Visit]:
    async with _served(files=files) as (viewer, bus, arm), async_playwright() as playwright:
        browser = await launched(playwright)
        try:
            async with _page(browser, 1000, 600) as page:
                requests: list[str] = []
                page.on("request", lambda request: requests.append(request.url))
                page.on("websocket", lambda socket: requests.append(socket.url.replace("ws://", "http://")))
                await _goes_to(page, viewer.url)
                yield Visit(browser, page, bus, viewer.url, requests, arm)
        finally:
            await browser.close()


async def _goes_to(page: Page, url: str) -> None:
    await page.goto(url)
    await page.get_by_text("RMSE").first.wait_for()  # after the fixed part


@pytest.fixture(scope="module")
def runner() -> Iterator[asyncio.Runner]:
    """One event loop for all tests: opening a page in software rendering takes longest."""
    with asyncio.Runner() as runner:
        yield runner


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the run, whose files are served."""
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def visit(runner: asyncio.Runner, folder: Path) -> Iterator[Visit]:
    """One page for all tests, each of which leaves it as the next can use it."""
    context = _visit(RunFiles(folder))
    visit = runner.run(context.__aenter__())
    yield visit
    runner.run(context.__aexit__(None, None, None))


def _status(step: str, rmse_m: float) -> FlowStatus:
    return FlowStatus(stamp_ns=1, flow="shape", step=step, actions=1, rmse_m=rmse_m)


def _run(phase: RunPhase, **fields: Any) -> RunStatus:
    return RunStatus(stamp_ns=1, phase=phase, stays=True, task=1, **fields)


def _position(frames: GoalFrames, index: int) -> Float64Array:
    return np.array([frames.frames[index].x_m, frames.frames[index].y_m])


async def _frames_on_the_rod(visit: Visit) -> AsyncIterator[GoalFrames]:
    """The frames' messages from now on, after the frames were put back on the straight goal."""
    commands = visit.bus.stream(topics.COMMAND)
    visit.bus.publish(topics.RUN, _run(RunPhase.WAITING))
    visit.bus.publish(topics.GOAL, GoalShape(stamp_ns=1, nodes_world=STRAIGHT, name="I"))
    await visit.page.get_by_role("tab", name="Goal").click()
    for button in ("Reset frames", "Shape it"):  # only the second one's effect is a message
        await visit.page.get_by_role("button", name=button, exact=True).click()
    assert (await anext(commands)).command is Command.START
    await visit.drawn()
    return visit.bus.stream(topics.GOAL_FRAMES)


def test_a_late_visitor_sees_earlier_messages(runner: asyncio.Runner, visit: Visit) -> None:
    runner.run(visit.page.get_by_text("RMSE 50.0 mm").wait_for())


def test_a_page_for_watching_has_no_controls(runner: asyncio.Runner, visit: Visit) -> None:
    async def buttons(page: Page) -> list[int]:
        return [await page.get_by_role("button", name=name).count() for name in ("Shape it", "Reset frames", "STOP")]

    async def scenario() -> None:
        assert await buttons(visit.page) == [1, 1, 1]
        async with _served(operated=False) as (viewer, _, _), _page(visit.browser, 800, 400) as watching:
            await _goes_to(watching, viewer.url)
            assert await buttons(watching) == [0, 0, 0]

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_another_page_of_the_browser_cannot_connect_even_with_the_key(runner: asyncio.Runner, visit: Visit) -> None:
    connects = """url => new Promise(done => {
        const socket = new WebSocket(url);
        socket.onopen = () => done(true);
        socket.onerror = () => done(false);
    })"""

    async def scenario() -> None:
        url = visit.url.replace("http://", "ws://")
        assert await visit.page.evaluate(connects, url)
        async with _page(visit.browser, 800, 400, refused="WebSocket") as page:
            assert not await page.evaluate(connects, url)

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_the_page_shows_the_robot_without_external_requests(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        # The first pictures are blank.
        while len(np.unique((before := await visit.scene_picture())[::4, ::4].reshape(-1, 3), axis=0)) < 200:
            pass
        visit.bus.publish(
            topics.ROBOT_STATE,
            structs.replace(
                ARM_AT_REST,
                stamp_ns=1,
                q_rad=PANDA.home_q_rad,
                T_world_tcp=pose((0.3, 0.0, 0.4)),
                finger_width_m=0.08,
            ),
        )
        # The arm covers 4 % of the picture; light and camera do not change meanwhile.
        while np.mean(np.any(np.abs((await visit.scene_picture()).astype(int) - before) > 8, axis=2)) < 0.02:
            pass
        own = (visit.url, "data:", "blob:")
        assert [url for url in visit.requests if not url.startswith(own)] == []
        assert any(url.startswith(visit.url) for url in visit.requests)

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_stop_goes_to_the_arm_itself_and_enable_is_offered_while_it_is_latched(
    runner: asyncio.Runner, visit: Visit
) -> None:
    async def scenario() -> None:
        enable = visit.page.get_by_role("button", name="Enable arms")
        assert await enable.count() == 0
        # There is no decision component: the arm receives the command nevertheless.
        await visit.page.get_by_role("button", name="STOP").click()
        assert await visit.arm.asked.get() == "stop"
        await enable.click()
        assert await visit.arm.asked.get() == "enable"
        await enable.wait_for(state="detached")

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_the_active_step_is_highlighted_in_the_flow_chart(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        visit.bus.publish(topics.FLOW, _status("compare", 0.034))
        await visit.page.get_by_text("RMSE 34.0 mm").wait_for()
        await visit.page.get_by_role("tab", name="Task").click()
        await visit.page.locator("svg[data-step=compare]").wait_for()

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_dragging_a_frame_with_the_mouse_publishes_where_it_was_dropped(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        frames = await _frames_on_the_rod(visit)
        end, along = STRAIGHT[-1, :2], tangents(STRAIGHT)[-1, :2]
        # The square that slides along the table sits between the arrows: a quarter of the gizmo's size from its
        # middle along both, its x axis along the rod.
        grip = np.array([*(end + 0.255 * SCALE_M * (along + np.array([-along[1], along[0]]))), HEIGHT_M])
        way = np.array([0.06, -0.10 * np.sign(end[1]), 0.0])
        await visit.drag(await visit.pixel(grip), await visit.pixel(grip + way))
        dropped = await anext(frames)
        while np.hypot(*(_position(dropped, 2) - end - way[:2])) > 0.01:  # a pixel is 2 mm there
            dropped = await anext(frames)
        assert [frame.node for frame in dropped.frames] == [0, 15, 30]
        np.testing.assert_allclose(_position(dropped, 0), STRAIGHT[0, :2])
        assert [frame.yaw_rad for frame in dropped.frames] == [None, None, None]

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_turning_a_frame_with_the_mouse_publishes_the_direction_of_that_node_alone(
    runner: asyncio.Runner, visit: Visit
) -> None:
    async def scenario() -> None:
        frames = await _frames_on_the_rod(visit)
        middle, along = STRAIGHT[15], tangents(STRAIGHT)[15]
        yaw_rad, turn_rad = float(np.arctan2(along[1], along[0])), 0.4
        # The arc that turns it lies at 0.65 of the gizmo's size, between the arrows.
        start, end = (
            np.array([*(middle[:2] + 0.65 * SCALE_M * np.array([np.cos(a), np.sin(a)])), HEIGHT_M])
            for a in (yaw_rad + np.pi / 4, yaw_rad + np.pi / 4 + turn_rad)
        )
        await visit.drag(await visit.pixel(start), await visit.pixel(end))
        turned = await anext(frames)
        # A pixel is 2 mm there, at a radius of 58 mm: 0.035 rad; twice that for both ends of the drag.
        while abs((turned.frames[1].yaw_rad or yaw_rad) - yaw_rad - turn_rad) > 0.07:
            turned = await anext(frames)
        assert (turned.frames[0].yaw_rad, turned.frames[2].yaw_rad) == (None, None)
        np.testing.assert_allclose(_position(turned, 1), middle[:2], atol=1e-6)  # single precision in the browser

    runner.run(asyncio.wait_for(scenario(), TEST_S))


@pytest.mark.smoke
def test_shape_it_sends_the_goal_that_is_shown_and_each_button_its_command(
    runner: asyncio.Runner, visit: Visit
) -> None:
    async def scenario() -> None:
        commands = visit.bus.stream(topics.COMMAND)
        visit.bus.publish(topics.GOAL, GoalShape(stamp_ns=1, nodes_world=STRAIGHT, name="I"))
        for button, status, command in (
            ("Shape it", _run(RunPhase.WAITING), Command.START),
            ("Pause", _run(RunPhase.RUNNING), Command.PAUSE),
            ("Resume", _run(RunPhase.PAUSED, paused=True), Command.RESUME),
            ("Make this motion", _run(RunPhase.ASKING, asks="carry the DLO", stepwise=True), Command.PROCEED),
            ("STOP", _run(RunPhase.RUNNING), Command.STOP),
        ):
            visit.bus.publish(topics.RUN, status)
            await visit.page.get_by_role("button", name=button, exact=True).click()
            sent = await anext(commands)
            assert sent.command is command
            if command is Command.START:
                assert sent.nodes_world is not None
                np.testing.assert_allclose(sent.nodes_world, STRAIGHT)
        assert await visit.arm.asked.get() == "stop"
        await visit.page.get_by_role("button", name="Enable arms").click()
        assert await visit.arm.asked.get() == "enable"

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_shape_it_while_paused_is_off_and_its_tooltip_says_why_and_what_to_do(
    runner: asyncio.Runner, visit: Visit
) -> None:
    # The button itself takes no mouse while it is off: the tooltip is that of the box around it.
    tooltip = "button => getComputedStyle(button.parentElement, '::after').content"

    async def scenario() -> None:
        visit.bus.publish(topics.RUN, _run(RunPhase.PAUSED, paused=True))
        await visit.page.get_by_text("Press Resume to go on").wait_for()
        shape = visit.page.get_by_role("button", name="Shape it", exact=True)
        assert await shape.is_disabled()
        await visit.page.mouse.move(10, 10)
        await drawn(visit.page)
        assert await shape.evaluate(tooltip) == "none"
        await shape.hover(force=True)
        await drawn(visit.page)
        said = "The task is paused: press Resume to go on with it, or STOP to end it."
        assert await shape.evaluate(tooltip) == f'"{said}"'
        assert await visit.page.get_by_role("button", name="STOP", exact=True).is_enabled()

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_the_goal_tab_has_one_large_button_and_small_ones_beside_one_another(
    runner: asyncio.Runner, visit: Visit
) -> None:
    async def box(name: str) -> Any:
        return await visit.page.get_by_role("button", name=name, exact=True).bounding_box()

    async def scenario() -> None:
        await _frames_on_the_rod(visit)
        large = await box("Draw on the table")
        for row in (
            ("Take what the camera sees", "Undo"),
            ("Reset frames", "More frames", "Fewer frames"),
            ("Load a goal", "Save the goal"),
        ):
            boxes = [await box(name) for name in row]
            assert len({one["y"] for one in boxes}) == 1
            gaps_px = 6.0 * len(boxes)
            assert sum(one["width"] for one in boxes) == pytest.approx(large["width"] - gaps_px, abs=8.0)
            assert boxes[0]["x"] == pytest.approx(large["x"], abs=1.0)

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_the_colours_of_what_is_shown_have_a_key_in_the_scene(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        await _frames_on_the_rod(visit)
        key = visit.page.locator("[data-key]")
        await key.get_by_text("Goal").wait_for()
        assert await key.get_by_text("Candidates").count() == 0
        within, scene = await key.bounding_box(), await visit.page.locator("canvas").first.bounding_box()
        assert within is not None
        assert scene is not None
        assert scene["x"] <= within["x"] < within["x"] + within["width"] <= scene["x"] + scene["width"]
        await visit.page.get_by_role("tab", name="Look").click()
        await visit.page.get_by_label("Goal", exact=True).uncheck()
        await key.get_by_text("Goal").wait_for(state="detached")
        await visit.page.get_by_label("Goal", exact=True).check()
        await key.get_by_text("Goal").wait_for()

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_a_page_whose_viewer_has_ended_says_so(runner: asyncio.Runner, visit: Visit) -> None:
    text = "const text = getComputedStyle(gate, '::before')"
    said = f"{text}; return text.display === 'block' && text.content.includes('Not connected')"

    async def scenario() -> None:
        async with AsyncExitStack() as serving:
            viewer, _, _ = await serving.enter_async_context(_served())
            async with _page(visit.browser, 1000, 600, refused="WebSocket") as page:
                await _goes_to(page, viewer.url)
                shown = f"[...document.querySelectorAll('div')].filter((gate) => {{{said}}}).length"
                assert await page.evaluate(shown) == 0
                await serving.aclose()
                await page.wait_for_function(f"{shown} === 1")

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_a_shape_of_the_gallery_is_judged_and_can_be_taken_back(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        await _frames_on_the_rod(visit)
        goals = visit.bus.stream(topics.GOAL)
        await visit.page.locator("input[value='choose a shape']").first.click()
        await visit.page.get_by_role("option", name="W", exact=True).click()
        goal = await anext(goals)
        assert goal.name == "W"
        np.testing.assert_allclose(goal.nodes_world, builtin_shape("W", ROD.length_m, ROD.nodes, radius_m=ROD.radius_m))
        await visit.page.get_by_text("The goal is doubtful.").wait_for()
        await visit.page.get_by_role("button", name="Undo").click()
        np.testing.assert_allclose((await anext(goals)).nodes_world, STRAIGHT)
        await visit.page.get_by_text("The goal holds.").wait_for()

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_a_goal_is_saved_as_a_file_that_can_be_loaded_again(
    runner: asyncio.Runner, visit: Visit, tmp_path: Path
) -> None:
    async def scenario() -> None:
        await _frames_on_the_rod(visit)
        goals = visit.bus.stream(topics.GOAL)
        await visit.page.get_by_label("Shape", exact=True).click()
        await visit.page.get_by_role("option", name="S", exact=True).click()
        chosen = await anext(goals)
        async with visit.page.expect_download() as download:
            await visit.page.get_by_role("button", name="Save the goal").click()
        saved = tmp_path / "goal.csv"
        await (await download.value).save_as(saved)
        nodes = points_of_csv(saved.read_bytes(), "goal.csv")
        np.testing.assert_allclose(nodes[:, :2], chosen.nodes_world[:, :2], atol=1e-4)
        await visit.page.get_by_label("Shape", exact=True).click()
        await visit.page.get_by_role("option", name="I", exact=True).click()
        await anext(goals)
        async with visit.page.expect_file_chooser() as chooser:
            await visit.page.get_by_role("button", name="Load a goal").click()
        await (await chooser.value).set_files(saved)
        loaded = await anext(goals)
        np.testing.assert_allclose(loaded.nodes_world, chosen.nodes_world, atol=1e-3)

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_a_line_drawn_with_the_mouse_becomes_the_goal(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        await _frames_on_the_rod(visit)
        goals = visit.bus.stream(topics.GOAL)
        await visit.page.get_by_role("button", name="Draw on the table").click()
        await visit.page.get_by_text("Drawing a goal").wait_for()
        await drawn(visit.page)
        # Posts on the line do not catch the mouse, not even where the line begins.
        line = [np.array([0.45 + 0.15 * np.sin(4.0 * y + 1.0) ** 2, y, 0.004]) for y in np.linspace(-0.22, 0.22, 12)]
        for post, at in zip(SCENE.posts, (0, 6), strict=True):
            assert np.linalg.norm(line[at][:2] - post.position_m[:2]) < post.diameter_m / 2.0
        await visit.page.mouse.move(*await visit.pixel(line[0]))
        await visit.page.mouse.down()
        for point in line[1:]:
            await visit.page.mouse.move(*await visit.pixel(point))
            await drawn(visit.page)
        await visit.page.mouse.up()
        goal = await anext(goals)
        assert goal.name == "drawn"
        apart = np.linalg.norm(goal.nodes_world[:, None, :2] - np.array(line)[None, :, :2], axis=2)
        # A pixel is 2 mm, the filter takes 3 mm off the bends, and the points of the line are 45 mm apart.
        assert apart.min(axis=0)[1:-1].max() < 0.02

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_a_drawing_is_left_by_escape_by_a_stop_and_with_its_page(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        await _frames_on_the_rod(visit)
        page = visit.page

        async def draw() -> None:
            await page.get_by_role("button", name="Draw on the table").click()
            await page.get_by_role("button", name="Leave the drawing").wait_for()
            await page.get_by_text("Drawing a goal").wait_for()

        await draw()
        await page.keyboard.press("Escape")
        await page.get_by_text("Waiting for your goal").wait_for()
        await draw()
        await page.get_by_role("button", name="STOP", exact=True).click()
        await page.get_by_text("The arms are stopped").wait_for()
        await page.get_by_role("button", name="Draw on the table").wait_for()
        await page.get_by_role("button", name="Enable arms").click()
        await page.get_by_text("Waiting for your goal").wait_for()
        assert [visit.arm.asked.get_nowait() for _ in range(2)] == ["stop", "enable"]
        await draw()
        await page.reload()
        await page.get_by_role("button", name="Draw on the table").wait_for()
        await page.get_by_text("Waiting for your goal").wait_for()

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_the_end_of_a_task_links_its_report(runner: asyncio.Runner, visit: Visit, folder: Path) -> None:
    (folder / "task-1").mkdir()
    (folder / "task-1" / "report.html").write_text("<h1>the report</h1>", encoding="utf-8")
    end = TaskEnd(
        number=1,
        goal="S",
        outcome=RunOutcome.CONVERGED,
        text="The DLO has reached the goal shape.",
        actions=2,
        rmse_m=0.007,
        threshold_m=0.012,
        files=("task-1/report.html",),
    )

    async def scenario() -> None:
        visit.bus.publish(topics.RUN, _run(RunPhase.WAITING, last=end))
        await visit.page.get_by_text("Task 1, to S: converged").wait_for()
        # The card alone says it: neither the headline nor the status of the task.
        await visit.page.get_by_text("Waiting for your next goal").wait_for()
        assert "converged" not in await visit.page.locator("[data-line]").inner_text()
        assert await visit.page.locator("[data-state=waiting], [data-state=ended]").count() == 0
        async with visit.page.expect_popup() as opened:
            await visit.page.get_by_role("link", name="report.html").click()
        report = await opened.value
        await report.get_by_text("the report").wait_for(timeout=LONG_S * 1000)
        assert report.url.startswith(visit.url)
        await report.close()

    runner.run(asyncio.wait_for(scenario(), TEST_S))


@pytest.fixture(scope="module")
def tablet(runner: asyncio.Runner, visit: Visit) -> Iterator[Page]:
    """A second page, of the size of a tablet."""
    context = _page(visit.browser, 768, 1024, refused="403")
    yield runner.run(context.__aenter__())
    runner.run(context.__aexit__(None, None, None))


def test_the_page_opens_only_with_its_key_also_when_reloaded(
    runner: asyncio.Runner, visit: Visit, tablet: Page
) -> None:
    async def scenario() -> None:
        refused = await tablet.goto(visit.url.rpartition("/")[0])
        assert refused is not None
        assert (refused.status, "address that dlokit printed" in await refused.text()) == (403, True)
        await _goes_to(tablet, visit.url)
        await tablet.reload()
        await tablet.get_by_role("button", name="Shape it").wait_for()

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_on_a_tablet_no_frame_is_hidden_and_two_pages_show_the_same(
    runner: asyncio.Runner, visit: Visit, tablet: Page
) -> None:
    async def scenario() -> None:
        if not tablet.url.startswith(visit.url):  # this test alone
            await _goes_to(tablet, visit.url)
        visit.bus.publish(topics.RUN, _run(RunPhase.PAUSED, paused=True))
        for page in (visit.page, tablet):
            await page.get_by_text("Press Resume to go on").first.wait_for()
        await drawn(tablet)
        box = await tablet.locator("canvas").first.bounding_box()
        panel = await tablet.get_by_role("button", name="STOP", exact=True).bounding_box()
        assert box is not None
        assert panel is not None
        for node in STRAIGHT[[0, 15, 30]]:
            across, down = await pixel(tablet, node)
            assert box["x"] < across < min(box["x"] + box["width"], panel["x"])
            assert box["y"] < down < box["y"] + box["height"]

    runner.run(asyncio.wait_for(scenario(), TEST_S))


def test_a_click_on_the_dlo_in_the_picture_finds_its_thresholds_which_a_slider_changes(
    runner: asyncio.Runner, visit: Visit
) -> None:
    async def scenario() -> None:
        page, chosen = visit.page, visit.bus.stream(topics.SEGMENTATION)
        visit.bus.publish(topics.DEPTH_IMAGES, _blue_dlo())
        await page.get_by_role("tab", name="Mask").click()
        await page.get_by_label("Adjust").click()
        picture = page.get_by_alt_text("the picture with its mask")
        await picture.scroll_into_view_if_needed()
        box = await picture.bounding_box()
        assert box is not None
        await page.mouse.click(box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 3.0)
        found = from_spec((await anext(chosen)).spec)
        assert isinstance(found, ColourConfig)
        assert found.lowest_hue_deg < 227.0 < found.highest_hue_deg  # that of the DLO
        await page.get_by_text(f"--perception.segmentation.least-value {found.least_value}").wait_for()
        # An arm that an earlier test has shown hides a part of the DLO.
        most, used = _preview(_blue_dlo(), (), found, 320).fraction, 0.0
        while not 0.01 < used <= most + 5e-5:
            used = float(await page.locator("[data-used]").get_attribute("data-used") or 0.0)

        # The field beside the slider, for its exact value.
        field = page.locator("label", has_text="least value").locator("xpath=../../..").locator("input").last
        await field.fill("255")
        while (changed := from_spec((await anext(chosen)).spec)) == found:
            pass
        assert changed == replace(found, least_value=255)
        await page.locator('[data-used="0.0000"]').wait_for()
        await page.get_by_text("No pixel is DLO").wait_for()

        await page.get_by_role("button", name="As at the start").click()
        assert from_spec((await anext(chosen)).spec) == BrightnessConfig()
        await page.get_by_label("Adjust").click()

    runner.run(asyncio.wait_for(scenario(), TEST_S))
