"""The viewer's page and its controls, used over the network by clients other than browsers."""

import asyncio
import itertools
import socket
import threading
from collections import Counter
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from typing import Any
from urllib.parse import SplitResult, urlsplit

import msgspec
import pytest
import viser
import zstandard
from live_systems import HANGS_S
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin, Subprotocol

from dlokit.communication import topics
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.scene import Scene
from dlokit.errors import MachineError
from dlokit.skills.viewer.component import ViewerComponent
from dlokit.skills.viewer.config import ViewerConfig
from dlokit.skills.viewer.goal.editor import RodOutline
from dlokit.skills.viewer.serving.address import RunFiles, check_port, lasting_port, new_key
from dlokit.skills.viewer.serving.page import OpenPage, close_page, open_page
from dlokit.types.flow import Command, GoalFrames, OperatorCommand
from dlokit.types.message import Message

KEY = "the-key"
VISITORS = 3
VISER = Subprotocol(f"viser-v{viser.__version__}")
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 0.0, 1.0),
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 600,
    "image_width": 1000,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class Served:
    """A running viewer, and its published messages."""

    def __init__(self, viewer: ViewerComponent, bus: MemoryTransport, published: list[Message]) -> None:
        self.viewer = viewer
        self.at: SplitResult = urlsplit(viewer.url)
        self.watch_at: SplitResult = urlsplit(viewer.watch_url)
        self.commands = bus.stream(topics.COMMAND)
        self.pages = bus.stream(topics.VIEWER_PAGE, with_last=True)
        self.published = published

    def client(self, path: str, *, host: str | None = None, origin: str | None = None) -> connect:
        """A client that claims to be a page of `origin` on `host`; None: the viewer's own."""
        netloc = self.at.netloc if host is None else host
        return connect(
            f"ws://{netloc}{path}",
            host="127.0.0.1",
            port=self.at.port,
            origin=Origin(f"http://{netloc}" if origin is None else origin),
            subprotocols=[VISER],
            proxy=None,
            open_timeout=HANGS_S,
        )

    def operated(self) -> list[Message]:
        """What was published for those who operated."""
        return [each for each in self.published if isinstance(each, OperatorCommand | GoalFrames)]

    async def nobody_else_operates(self) -> None:
        """Press a button as a person with the key: what others sent to the server before had no effect."""
        async with self.client(self.at.path) as client:
            button = await _stop_button(client)
            assert self.operated() == []
            await _press(client, button)
            assert (await anext(self.commands)).command is Command.STOP
            assert len(self.operated()) == 1


def _viewer(port: int = 0, opens: OpenPage = open_page) -> ViewerComponent:
    return ViewerComponent(
        ViewerConfig(port=port),
        flow=(("look", "seen", "done"),),
        rod=RodOutline(nodes=31, length_m=0.5, radius_m=0.004),
        scene=Scene(),
        threshold_m=0.012,
        key=KEY,
        opens=opens,
    )


def _served(
    scenario: Callable[[Served], Coroutine[None, None, None]], viewer: ViewerComponent | None = None
) -> ViewerComponent:
    viewer = viewer or _viewer()
    published: list[Message] = []

    async def run() -> None:
        bus = MemoryTransport(lambda topic, message: published.append(message))
        host = Container(bus, LoopClock())
        host.add(viewer)
        async with asyncio.timeout(HANGS_S), host:
            opened = asyncio.create_task(viewer.opened.wait())
            failed = asyncio.create_task(host.wait_failed())
            await asyncio.wait({opened, failed}, return_when=asyncio.FIRST_COMPLETED)
            if failed.done():
                failed.result()
            failed.cancel()
            await scenario(Served(viewer, bus, published))

    asyncio.run(run())
    return viewer


async def _received(client: ClientConnection) -> AsyncIterator[dict[str, Any]]:
    """The messages that a browser would get."""
    async for data in client:
        assert isinstance(data, bytes)
        size, packed = (int.from_bytes(data[at : at + 8], "little") for at in (0, 8))
        inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=size)
        for message in msgspec.msgpack.decode(inner)["messages"]:
            yield message


async def _stop_button(client: ClientConnection) -> str:
    """Open the page as a browser does, and find a button among its elements."""
    await client.send(msgspec.msgpack.encode(CAMERA))
    async for message in _received(client):
        if message["type"] == "GuiButtonMessage" and message["props"]["label"] == "STOP":
            return message["uuid"]
    raise AssertionError("the page has no such button")


async def _press(client: ClientConnection, button: str) -> None:
    pressed = {"type": "GuiUpdateMessage", "uuid": button, "updates": {"value": True}}
    await client.send(msgspec.msgpack.encode(pressed))


async def _press_stop(client: ClientConnection) -> None:
    await _press(client, await _stop_button(client))


def test_a_page_with_the_key_can_operate() -> None:
    async def scenario(served: Served) -> None:
        async with served.client(served.at.path) as client:
            await _press_stop(client)
            assert (await anext(served.commands)).command is Command.STOP

    _served(scenario)


@pytest.mark.parametrize("names", ["localhost", "127.0.0.1"])
def test_the_page_may_be_opened_under_the_names_of_this_machine(names: str) -> None:
    async def scenario(served: Served) -> None:
        async with served.client(served.at.path, host=f"{names}:{served.at.port}") as client:
            assert client.subprotocol == VISER

    _served(scenario)


def _refused(served: Served, port: int) -> dict[str, tuple[str, str | None, str | None]]:  # path, host, origin
    path, own = served.at.path, served.at.netloc
    return {
        "no key": ("", None, None),
        "a wrong key": (f"/{'x' * len(KEY)}", None, None),
        "part of the key": (path[:-1], None, None),
        "the key in the query": (f"/?key={KEY}", None, None),
        "the key behind another": (f"/x{path}", None, None),
        "a foreign page": (path, None, "http://evil.example"),
        "a page of another port": (path, None, f"http://127.0.0.1:{port + 1}"),
        "a page of a file": (path, None, "null"),
        "the own page by another scheme": (path, None, f"https://{own}"),
        "another host": (path, f"evil.example:{port}", None),
        "another host with the own page": (path, f"evil.example:{port}", f"http://{own}"),
        "another port": (path, f"127.0.0.1:{port + 1}", None),
        "no port": (path, "127.0.0.1", None),
    }


def test_hostile_clients_are_refused_in_the_handshake_and_nothing_is_published() -> None:
    async def scenario(served: Served) -> None:
        assert served.at.port is not None
        for name, (path, host, origin) in _refused(served, served.at.port).items():
            with pytest.raises(InvalidStatus) as refused:
                async with served.client(path, host=host, origin=origin):
                    pytest.fail(f"{name} was admitted")
            assert refused.value.response.status_code == 403, name
            assert KEY.encode() not in (refused.value.response.body or b""), name
        await served.nobody_else_operates()

    _served(scenario)


def test_a_watcher_sees_the_scene_and_cannot_operate() -> None:
    async def scenario(served: Served) -> None:
        async with served.client(served.watch_at.path) as client:
            await _press_stop(client)
            drag = {"name": "/goal_frames/0", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.5, 0.0, 0.0), "owner": ""}
            await client.send(msgspec.msgpack.encode({"type": "TransformControlsUpdateMessage", **drag}))
            await client.send(b"\xc1")  # no message at all
            await (await client.ping())  # the server has what was sent
            await served.nobody_else_operates()

    _served(scenario)


def test_no_client_can_publish_the_page_on_the_internet(monkeypatch: pytest.MonkeyPatch) -> None:
    tunnels: list[object] = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *arguments: tunnels.append(arguments))

    opened: list[viser.ViserServer] = []

    def opens(host: str, port: int, key: str, files: RunFiles | None) -> viser.ViserServer:
        opened.append(open_page(host, port, key, files))
        return opened[0]

    async def scenario(served: Served) -> None:
        async with served.client(served.at.path) as client:
            await client.send(msgspec.msgpack.encode(CAMERA))
            for name in ("ShareUrlRequest", "ShareUrlDisconnect"):
                await client.send(msgspec.msgpack.encode({"type": name}))
            await _press_stop(client)  # messages are processed in order
            assert (await anext(served.commands)).command is Command.STOP

    _served(scenario, _viewer(opens=opens))
    vars(opened[0])["_thread_executor"].shutdown()  # waits for the threads that would open them
    assert tunnels == []


def test_the_page_is_served_at_its_url_until_the_viewer_is_cancelled() -> None:
    async def scenario(served: Served) -> None:
        assert (await anext(served.pages)).url == served.viewer.url
        at = served.at
        reader, writer = await asyncio.open_connection(at.hostname, at.port)
        writer.write(f"GET {at.path} HTTP/1.1\r\nHost: {at.netloc}\r\nConnection: close\r\n\r\n".encode())
        assert b"200 OK" in await reader.readline()
        writer.close()
        await writer.wait_closed()

    viewer = _served(scenario)
    assert not viewer.opened.is_set()
    check_port("127.0.0.1", urlsplit(viewer.url).port or 0)


@pytest.fixture
def taken() -> Iterator[int]:
    """A port on which another program listens."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


def test_a_port_in_use_ends_the_viewer_with_an_error_that_the_host_reports(
    taken: int, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario(_: Served) -> None:
        pytest.fail("it is served")

    with pytest.raises(MachineError, match=r"--port"):
        _served(scenario, _viewer(taken))


def test_a_port_in_use_is_one_error_with_a_remedy(taken: int) -> None:
    with pytest.raises(MachineError, match=rf"port {taken} .*--port"):
        check_port("127.0.0.1", taken)
    with pytest.raises(MachineError, match=rf"port {taken} "):
        open_page("127.0.0.1", taken, "key")


def test_an_address_of_another_machine_is_an_error_and_not_a_wait() -> None:
    with pytest.raises(MachineError, match=r"192\.0\.2\.1"):  # reserved for documentation: nobody has it
        check_port("192.0.2.1", 0)


def test_a_key_has_a_port_of_its_own_unless_another_program_has_it() -> None:
    key = new_key()  # no other test may take its port
    port = lasting_port("127.0.0.1", key)
    assert port == lasting_port("127.0.0.1", key) > 0
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", port))
        taken.listen()
        assert lasting_port("127.0.0.1", key) == 0


def test_a_closed_page_releases_its_port_and_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    server = open_page("127.0.0.1", 0, new_key())  # the port follows from the key: no other test may take it
    port = server.get_port()
    with pytest.raises(MachineError):
        check_port("127.0.0.1", port)
    close_page(server)
    check_port("127.0.0.1", port)
    assert capsys.readouterr().out == ""


async def _visit(port: int, drawing: asyncio.Barrier, drawn: asyncio.Event, received: Counter[int], who: int) -> None:
    """Open the page, let the drawing begin, and count what is `received`, until it is `drawn`."""
    async with connect(
        f"ws://127.0.0.1:{port}/key/",
        origin=Origin(f"http://127.0.0.1:{port}"),
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
        proxy=None,
    ) as client:
        await client.recv()
        await drawing.wait()
        while not drawn.is_set():
            await client.recv()
            received[who] += 1


def test_pages_are_woken_on_the_servers_thread_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Waking them where the scene is drawn raised there: with eight visitors 9 times in 500 drawings."""
    woken_on: set[str] = set()
    wake = asyncio.Event.set
    server = open_page("127.0.0.1", 0, "key")
    messages = vars(vars(server)["_websock_server"])["_broadcast_buffer"].message_event

    def recorded(event: asyncio.Event) -> None:
        if event is messages:
            woken_on.add(threading.current_thread().name)
        wake(event)

    async def scenario() -> None:
        drawing, drawn, received = asyncio.Barrier(VISITORS + 1), asyncio.Event(), Counter[int]()
        port = server.get_port()
        visits = [asyncio.create_task(_visit(port, drawing, drawn, received, who)) for who in range(VISITORS)]
        await drawing.wait()
        frame = server.scene.add_frame("/drawn")
        for place in itertools.count():
            with server.atomic():
                frame.position = (place, 0.0, 0.0)
            await asyncio.sleep(0.02)
            if place > 20 and all(received[who] > 1 for who in range(VISITORS)):
                break
        drawn.set()
        frame.position = (0.0, 0.0, 1.0)
        await asyncio.gather(*visits)

    monkeypatch.setattr(asyncio.Event, "set", recorded)
    try:
        asyncio.run(asyncio.wait_for(scenario(), HANGS_S))
    finally:
        close_page(server)
    assert len(woken_on) == 1
    assert threading.current_thread().name not in woken_on
