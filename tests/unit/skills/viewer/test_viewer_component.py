import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
import viser
from unheard_page import open_unheard_page

from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.scene import Fixture, Post, Scene
from dlokit.errors import MachineError
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.component import ViewerComponent
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.skills.viewer.goal.editor import RodOutline
from dlokit.skills.viewer.serving.address import RunFiles
from dlokit.skills.viewer.serving.page import OpenPage
from dlokit.types.flow import RunPhase, RunStatus
from dlokit.types.observation import DistrustReason, ObserverEvent, ObserverEventKind

LIMIT_S = 20.0  # of virtual time


def _viewer(opens: OpenPage, scene: Scene | None = None) -> ViewerComponent:
    return ViewerComponent(
        ViewerConfig(port=8080),
        flow=(("look", "seen", "done"),),
        rod=RodOutline(nodes=31, length_m=0.5, radius_m=0.004),
        scene=scene or Scene(),
        threshold_m=0.012,
        key="the-key",
        opens=opens,
    )


def _hosted(
    viewer: ViewerComponent,
    scenario: Callable[[Container], Coroutine[None, None, None]],
    bus: MemoryTransport | None = None,
) -> None:
    async def run() -> None:
        host = Container(bus or MemoryTransport(), LoopClock())
        host.add(viewer)
        async with asyncio.timeout(LIMIT_S), host:
            await scenario(host)

    virtual_time.run(run())


def test_the_page_is_announced_and_open_until_the_viewer_is_cancelled() -> None:
    opened: list[viser.ViserServer] = []

    def opens(host: str, port: int, key: str, files: RunFiles | None) -> viser.ViserServer:
        opened.append(open_unheard_page(host, port, key, files))
        return opened[0]

    viewer, bus = _viewer(opens), MemoryTransport()

    async def scenario(_: Container) -> None:
        page = await anext(aiter(bus.stream(topics.VIEWER_PAGE, with_last=True)))
        assert page.url == viewer.url == "http://127.0.0.1:8080/the-key"
        assert viewer.opened.is_set()
        assert _serves(opened[0])

    _hosted(viewer, scenario, bus)
    assert not viewer.opened.is_set()
    assert not _serves(opened[0])


def _serves(page: viser.ViserServer) -> bool:
    return vars(vars(page)["_websock_server"])["_server_thread"].is_alive()


def test_a_page_that_cannot_be_opened_ends_the_viewer_with_an_error_that_the_host_reports(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def opens(host: str, port: int, key: str, files: RunFiles | None) -> viser.ViserServer:
        raise MachineError(f"another program has port {port}")

    async def scenario(host: Container) -> None:
        with pytest.raises(MachineError, match="has port 8080"):
            await host.wait_failed()

    _hosted(_viewer(opens), scenario)


@pytest.mark.parametrize("fixtures", [(), (Post(name="A", position_m=(0.45, 0.1, 0.0)),)])
def test_a_page_with_fixtures_has_a_switch_for_them(
    fixtures: tuple[Fixture, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    switches: list[str] = []
    add = viser.GuiApi.add_checkbox

    def noted(self: viser.GuiApi, label: str, *args: Any, **kwargs: Any) -> Any:
        switches.append(label)
        return add(self, label, *args, **kwargs)

    monkeypatch.setattr(viser.GuiApi, "add_checkbox", noted)
    viewer = _viewer(open_unheard_page, Scene(fixtures=fixtures))

    async def scenario(host: Container) -> None:
        await viewer.opened.wait()

    _hosted(viewer, scenario)
    assert palette.ROBOT.title in switches
    assert (palette.FIXTURES.title in switches) == bool(fixtures)


def test_a_browser_gets_buttons_in_the_state_of_a_run_that_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    buttons: dict[str, viser.GuiButtonHandle] = {}
    texts: list[viser.GuiHtmlHandle] = []
    add_button, add_html = viser.GuiApi.add_button, viser.GuiApi.add_html

    def noted_button(self: viser.GuiApi, label: str, *args: Any, **kwargs: Any) -> Any:
        buttons[label] = add_button(self, label, *args, **kwargs)
        return buttons[label]

    def noted_html(self: viser.GuiApi, *args: Any, **kwargs: Any) -> Any:
        texts.append(add_html(self, *args, **kwargs))
        return texts[-1]

    monkeypatch.setattr(viser.GuiApi, "add_button", noted_button)
    monkeypatch.setattr(viser.GuiApi, "add_html", noted_html)
    viewer = _viewer(open_unheard_page)

    async def scenario(host: Container) -> None:
        await viewer.opened.wait()

    _hosted(viewer, scenario)
    labels = ("STOP", "Shape it", "Pause", "Undo")
    assert {label: buttons[label].disabled for label in labels} == {label: label != "STOP" for label in labels}
    assert any("Wait until the camera has found the DLO" in text.content for text in texts)


def test_what_the_observer_said_in_one_task_is_not_said_in_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    texts: list[viser.GuiHtmlHandle] = []
    add = viser.GuiApi.add_html

    def noted(self: viser.GuiApi, *args: Any, **kwargs: Any) -> Any:
        texts.append(add(self, *args, **kwargs))
        return texts[-1]

    def said() -> list[bool]:
        return [text.visible for text in texts if "another place" in text.content]

    monkeypatch.setattr(viser.GuiApi, "add_html", noted)
    monkeypatch.setattr(viser.ViserServer, "get_clients", lambda self: {0: None})  # the page is drawn
    viewer = _viewer(open_unheard_page)
    elsewhere = ObserverEvent(stamp_ns=1, kind=ObserverEventKind.REFUSED, reason=DistrustReason.ELSEWHERE, health=0.5)

    async def scenario(host: Container) -> None:
        await viewer.opened.wait()
        for task in (1, 2):
            host.transport.publish(topics.RUN, RunStatus(stamp_ns=1, phase=RunPhase.RUNNING, task=task))
            if task == 1:
                host.transport.publish(topics.OBSERVER_EVENT, elsewhere)
            await asyncio.sleep(0.5)
            assert said() == [task == 1]

    _hosted(viewer, scenario)


def test_the_viewer_publishes_commands_and_frames_and_sees_every_layer() -> None:
    assert set(ViewerComponent.publishes) == {topics.COMMAND, topics.GOAL_FRAMES, topics.VIEWER_PAGE}
    assert set(ViewerComponent.subscribes()) == {
        topics.ROBOT_STATE,
        topics.STEREO_IMAGES,
        topics.DEPTH_IMAGES,
        topics.SEGMENTATION,
        topics.OBSERVATION,
        topics.TARGETS,
        topics.OBSERVER_EVENT,
        topics.STATE,
        topics.GOAL,
        topics.CANDIDATES,
        topics.ACTION,
        topics.GOAL_VERDICT,
        topics.FLOW,
        topics.RUN,
    }
