import asyncio
import socket
from collections.abc import Callable, Coroutine
from urllib.parse import urlsplit

import pytest

from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.arm.mounts import FIRST_ALONE
from dlokit.description.table import Table
from dlokit.errors import MachineError
from dlokit.skills.viewer.component import ViewerComponent
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.skills.viewer.goal.editor import RodOutline
from dlokit.skills.viewer.serving.page import check_port

LIMIT_S = 20.0
"""Opening the page takes 0.2 s; a loaded machine gets a hundred times that."""


def _viewer(port: int = 0) -> ViewerComponent:
    return ViewerComponent(
        ViewerConfig(port=port),
        flow=(("look", "seen", "done"),),
        rod=RodOutline(nodes=31, length_m=0.5, radius_m=0.004),
        table=Table(),
        arms=FIRST_ALONE,
        threshold_m=0.012,
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

    asyncio.run(run())


def test_the_page_is_served_at_its_url_until_the_viewer_is_cancelled() -> None:
    viewer, bus = _viewer(), MemoryTransport()

    async def scenario(_: Container) -> None:
        page = await anext(aiter(bus.stream(topics.VIEWER_PAGE, with_last=True)))
        assert page.url == viewer.url
        at = urlsplit(viewer.url)
        reader, writer = await asyncio.open_connection(at.hostname, at.port)
        writer.write(f"GET {at.path} HTTP/1.1\r\nHost: {at.netloc}\r\nConnection: close\r\n\r\n".encode())
        assert b"200 OK" in await reader.readline()
        writer.close()
        await writer.wait_closed()

    _hosted(viewer, scenario, bus)
    assert not viewer.opened.is_set()
    check_port("127.0.0.1", urlsplit(viewer.url).port or 0)


def test_a_port_in_use_ends_the_viewer_with_an_error_that_the_host_reports(caplog: pytest.LogCaptureFixture) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()

        async def scenario(host: Container) -> None:
            with pytest.raises(MachineError, match=r"--port"):
                await host.wait_failed()

        _hosted(_viewer(taken.getsockname()[1]), scenario)


def test_the_viewer_publishes_commands_and_frames_and_sees_every_layer() -> None:
    assert set(ViewerComponent.publishes) == {topics.COMMAND, topics.GOAL_FRAMES, topics.VIEWER_PAGE}
    assert set(ViewerComponent.subscribes()) == {
        topics.ROBOT_STATE,
        topics.STEREO_IMAGES,
        topics.DEPTH_IMAGES,
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
