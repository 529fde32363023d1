"""The viewer in a real browser, used with a real mouse."""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.async_api import Page, async_playwright

from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.mounts import FIRST_ALONE
from dlokit.description.shapes import builtin_shape
from dlokit.description.table import Table
from dlokit.geometry import downward, pose, tangents
from dlokit.skills.robot import api as robot
from dlokit.skills.viewer.component import ArmButtons, ViewerComponent
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.skills.viewer.frames import HEIGHT_M, SCALE_M
from dlokit.skills.viewer.goal_editor import RodOutline
from dlokit.skills.viewer.scene import VISITOR_FOV_RAD, VISITOR_LOOK_AT_M, VISITOR_POSITION_M
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.flow import Command, FlowStatus, GoalFrames
from dlokit.types.robot import RobotMode, RobotState

CHROMIUM = Path("/usr/bin/chromium")
ARGUMENTS = [
    "--headless=new",
    "--no-sandbox",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
FLOW = (
    ("look", "seen", "compare"),
    ("compare", "far", "move"),
    ("compare", "close", "converged"),
    ("move", "done", "look"),
)
ROD = RodOutline(nodes=31, length_m=0.5, radius_m=0.004)
STRAIGHT = builtin_shape("I", ROD.length_m, ROD.nodes, radius_m=ROD.radius_m)
"""Goal rod before an operator has set a goal, (31, 3) [m]."""
LONG_S = 120.0
"""Software rendering on a loaded machine takes seconds per image; no wait takes that long unless something fails."""

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(not CHROMIUM.exists(), reason=f"{CHROMIUM} is missing; on Debian: apt install chromium"),
]


class Visit:
    """One visitor of a running viewer."""

    def __init__(self, page: Page, bus: MemoryTransport, url: str, requests: list[str], arm: "Arm") -> None:
        self.page, self.bus, self.url, self.requests, self.arm = page, bus, url, requests, arm

    async def scene_picture(self) -> UInt8Array:
        """The scene in the browser, (H, W, 3) BGR, without the panel next to it."""
        png = await self.page.locator("canvas").first.screenshot(timeout=LONG_S * 1000)
        picture = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        return np.asarray(picture, dtype=np.uint8)

    async def pixel(self, point_world: Float64Array) -> Float64Array:
        """Position of a point (3,) [m] on the page [px]."""
        box = await self.page.locator("canvas").first.bounding_box()
        assert box is not None
        right, down, forward = _visitor_axes()
        offset = point_world - np.array(VISITOR_POSITION_M)
        focal_px = box["height"] / 2.0 / np.tan(VISITOR_FOV_RAD / 2.0)
        across = np.array([offset @ right, offset @ down]) / (offset @ forward) * focal_px
        return across + np.array([box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0])

    async def drag(self, start_px: Float64Array, end_px: Float64Array) -> None:
        """Press, move in steps, release."""
        await self.page.mouse.move(*start_px)
        # The gizmo answers only after the browser has drawn it as hovered.
        await self.page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        await self.page.mouse.down()
        await self.page.mouse.move(*end_px, steps=8)
        await self.page.mouse.up()


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
        state = RobotState(
            stamp_ns=1,
            robot="first",
            q_rad=PANDA.home_q_rad,
            dq_rad_s=np.zeros(7),
            tau_nm=np.zeros(7),
            T_world_tcp=downward([0.5, 0.0, 0.3], 0.0),
            finger_width_m=0.08,
            mode=RobotMode.IDLE,
            stop_latched=latched,
        )
        self.port.publish(topics.ROBOT_STATE, state)


def _visitor_axes() -> tuple[Float64Array, Float64Array, Float64Array]:
    forward = np.array(VISITOR_LOOK_AT_M) - np.array(VISITOR_POSITION_M)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return right, np.cross(forward, right), forward


@asynccontextmanager
async def _a_visit(*, operated: bool = True) -> AsyncGenerator[Visit]:
    bus = MemoryTransport()
    host = Container(bus, LoopClock())
    viewer = ViewerComponent(
        ViewerConfig(port=0),
        flow=FLOW,
        rod=ROD,
        table=Table(),
        arms=FIRST_ALONE,
        threshold_m=0.012,
        operated=operated,
        buttons=(ArmButtons(stop=robot.STOP, enable=robot.ENABLE),),
    )
    host.add(viewer)
    arm = Arm()
    host.add(arm)
    async with host, async_playwright() as playwright:
        await asyncio.wait_for(viewer.opened.wait(), LONG_S)
        bus.publish(topics.FLOW, _status("look", 0.050))
        browser = await playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        try:
            page = await browser.new_page(viewport={"width": 1000, "height": 600})
            requests: list[str] = []
            page.on("request", lambda request: requests.append(request.url))
            page.on("websocket", lambda socket: requests.append(socket.url.replace("ws://", "http://")))
            await page.goto(viewer.url, timeout=LONG_S * 1000)
            await page.get_by_text("RMSE 50.0 mm").wait_for(timeout=LONG_S * 1000)  # after the fixed part
            yield Visit(page, bus, viewer.url, requests, arm)
        finally:
            await browser.close()


@pytest.fixture(scope="module")
def runner() -> Iterator[asyncio.Runner]:
    """One event loop for all tests: opening a page in software rendering takes longest."""
    with asyncio.Runner() as runner:
        yield runner


@pytest.fixture(scope="module")
def visit(runner: asyncio.Runner) -> Iterator[Visit]:
    context = _a_visit()
    visit = runner.run(context.__aenter__())
    yield visit
    runner.run(context.__aexit__(None, None, None))


def _status(step: str, rmse_m: float) -> FlowStatus:
    return FlowStatus(stamp_ns=1, flow="shape", step=step, actions=1, rmse_m=rmse_m)


def _position(frames: GoalFrames, index: int) -> Float64Array:
    return np.array([frames.frames[index].x_m, frames.frames[index].y_m])


async def _frames_on_the_rod(visit: Visit) -> AsyncIterator[GoalFrames]:
    """The frames' messages from now on, after an operator has put the frames back on the built-in I."""
    frames = visit.bus.stream(topics.GOAL_FRAMES)
    await visit.page.get_by_role("button", name="Reset frames").click(timeout=LONG_S * 1000)
    # On a busy machine, messages of an earlier drag may still arrive first.
    while not _on_the_rod(await anext(frames)):
        pass
    return frames


def _on_the_rod(frames: GoalFrames) -> bool:
    places = [_position(frames, index) for index in range(3)]
    return np.allclose(places, STRAIGHT[[0, 15, 30], :2]) and all(frame.yaw_rad is None for frame in frames.frames)


def test_a_late_visitor_sees_earlier_messages(runner: asyncio.Runner, visit: Visit) -> None:
    runner.run(visit.page.get_by_text("RMSE 50.0 mm").wait_for(timeout=LONG_S * 1000))


def test_stop_goes_to_the_arm_itself_and_enable_is_offered_while_it_is_latched(runner: asyncio.Runner) -> None:
    async def scenario() -> None:
        async with _a_visit() as visit:  # a separate viewer: the other tests would see the arm that it shows
            await stopped_and_enabled(visit)

    async def stopped_and_enabled(visit: Visit) -> None:
        enable = visit.page.get_by_role("button", name="Enable arms")
        assert await enable.count() == 0
        # There is no decision component: the arm receives the command nevertheless.
        await visit.page.get_by_role("button", name="Stop").click(timeout=LONG_S * 1000)
        assert await asyncio.wait_for(visit.arm.asked.get(), LONG_S) == "stop"
        await enable.click(timeout=LONG_S * 1000)
        assert await asyncio.wait_for(visit.arm.asked.get(), LONG_S) == "enable"
        await enable.wait_for(state="detached", timeout=LONG_S * 1000)

    runner.run(scenario())


def test_a_page_for_watching_has_no_controls(runner: asyncio.Runner, visit: Visit) -> None:
    async def buttons(of: Visit) -> list[int]:
        return [await of.page.get_by_role("button", name=name).count() for name in ("Shape it", "Reset frames", "Stop")]

    async def scenario() -> None:
        assert await buttons(visit) == [1, 1, 1]
        async with _a_visit(operated=False) as watching:
            assert await buttons(watching) == [0, 0, 0]

    runner.run(scenario())


async def _another_page(visit: Visit) -> Page:
    browser = visit.page.context.browser
    assert browser is not None
    return await browser.new_page()


def test_the_page_opens_only_with_its_key_also_when_reloaded(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        page = await _another_page(visit)
        try:
            refused = await page.goto(visit.url.rpartition("/")[0], timeout=LONG_S * 1000)
            assert refused is not None
            assert (refused.status, "address that dlokit printed" in await refused.text()) == (403, True)
            await page.goto(visit.url, timeout=LONG_S * 1000)
            for _ in range(2):
                await page.get_by_role("button", name="Shape it").wait_for(timeout=LONG_S * 1000)
                await page.reload(timeout=LONG_S * 1000)
        finally:
            await page.close()

    runner.run(scenario())


def test_another_page_of_the_browser_cannot_connect_even_with_the_key(runner: asyncio.Runner, visit: Visit) -> None:
    connects = """url => new Promise(done => {
        const socket = new WebSocket(url);
        socket.onopen = () => done(true);
        socket.onerror = () => done(false);
    })"""

    async def scenario() -> None:
        url = visit.url.replace("http://", "ws://")
        assert await visit.page.evaluate(connects, url)
        page = await _another_page(visit)
        try:
            assert not await page.evaluate(connects, url)
        finally:
            await page.close()

    runner.run(asyncio.wait_for(scenario(), LONG_S))


def test_the_page_shows_the_robot_without_external_requests(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        # The first pictures are blank.
        while len(np.unique((before := await visit.scene_picture())[::4, ::4].reshape(-1, 3), axis=0)) < 200:
            pass
        visit.bus.publish(
            topics.ROBOT_STATE,
            RobotState(
                stamp_ns=1,
                robot="first",
                q_rad=PANDA.home_q_rad,
                dq_rad_s=np.zeros(7),
                tau_nm=np.zeros(7),
                T_world_tcp=pose((0.3, 0.0, 0.4)),
                finger_width_m=0.08,
                mode=RobotMode.IDLE,
            ),
        )
        # The arm covers 4 % of the picture; light and camera do not change meanwhile.
        while np.mean(np.any(np.abs((await visit.scene_picture()).astype(int) - before) > 8, axis=2)) < 0.02:
            pass
        own = (visit.url, "data:", "blob:")
        assert [url for url in visit.requests if not url.startswith(own)] == []
        assert any(url.startswith(visit.url) for url in visit.requests)

    runner.run(asyncio.wait_for(scenario(), LONG_S))


def test_the_active_step_is_highlighted_in_the_flow_chart(runner: asyncio.Runner, visit: Visit) -> None:
    async def scenario() -> None:
        visit.bus.publish(topics.FLOW, _status("compare", 0.034))
        await visit.page.get_by_text("RMSE 34.0 mm").wait_for(timeout=LONG_S * 1000)
        await visit.page.locator("svg[data-step=compare]").wait_for(timeout=LONG_S * 1000)

    runner.run(scenario())


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

    runner.run(asyncio.wait_for(scenario(), LONG_S))


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

    runner.run(asyncio.wait_for(scenario(), LONG_S))


def test_the_shape_button_sends_goal_and_start_and_each_button_its_command(
    runner: asyncio.Runner, visit: Visit
) -> None:
    async def scenario() -> None:
        frames, commands = visit.bus.stream(topics.GOAL_FRAMES), visit.bus.stream(topics.COMMAND)
        await visit.page.get_by_role("button", name="Shape it").click(timeout=LONG_S * 1000)
        assert (await anext(commands)).command is Command.START
        assert len((await anext(frames)).frames) == 3
        for button in Command:
            name = button.value.capitalize()
            await visit.page.get_by_role("button", name=name, exact=True).click(timeout=LONG_S * 1000)
            assert (await anext(commands)).command is button

    runner.run(asyncio.wait_for(scenario(), LONG_S))
