"""Access to the viewer's page and its controls, tested by clients other than browsers."""

import asyncio
import importlib
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from types import SimpleNamespace
from typing import Any
from urllib.parse import SplitResult, urlsplit

import msgspec
import pytest
import viser
import zstandard
from websockets.asyncio.client import ClientConnection, connect
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request
from websockets.typing import Origin, Subprotocol

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
from dlokit.skills.viewer.serving.address import check_port, new_key, watch_key
from dlokit.skills.viewer.serving.page import PageGate, open_page
from dlokit.types.flow import Command

KEY = "the-key"
LIMIT_S = 20.0
QUIET_S = 0.5
"""A message that the viewer accepts is on the bus within milliseconds."""
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

    def __init__(self, viewer: ViewerComponent, bus: MemoryTransport) -> None:
        self.at: SplitResult = urlsplit(viewer.url)
        self.watch_at: SplitResult = urlsplit(viewer.watch_url)
        self.commands, self.frames = bus.stream(topics.COMMAND), bus.stream(topics.GOAL_FRAMES)

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
            open_timeout=LIMIT_S,
        )

    async def is_quiet(self) -> None:
        """Raise if any message was published."""
        for stream in (self.commands, self.frames):
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(anext(stream), QUIET_S)


def _served(scenario: Callable[[Served], Coroutine[None, None, None]]) -> None:
    async def run() -> None:
        bus = MemoryTransport()
        host = Container(bus, LoopClock())
        viewer = ViewerComponent(
            ViewerConfig(port=0),
            flow=(("look", "seen", "done"),),
            rod=RodOutline(nodes=31, length_m=0.5, radius_m=0.004),
            table=Table(),
            arms=FIRST_ALONE,
            threshold_m=0.012,
            key=KEY,
        )
        host.add(viewer)
        async with asyncio.timeout(LIMIT_S), host:
            await viewer.opened.wait()
            await scenario(Served(viewer, bus))

    asyncio.run(run())


async def _received(client: ClientConnection) -> AsyncIterator[dict[str, Any]]:
    """The messages that a browser would get."""
    async for data in client:
        assert isinstance(data, bytes)
        size, packed = (int.from_bytes(data[at : at + 8], "little") for at in (0, 8))
        inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=size)
        for message in msgspec.msgpack.decode(inner)["messages"]:
            yield message


async def _press_stop(client: ClientConnection) -> None:
    """Press a button as a browser does: find it among the page's elements, and send the event."""
    await client.send(msgspec.msgpack.encode(CAMERA))
    async for message in _received(client):
        if message["type"] == "GuiButtonMessage" and message["props"]["label"] == "STOP":
            pressed = {"type": "GuiUpdateMessage", "uuid": message["uuid"], "updates": {"value": True}}
            await client.send(msgspec.msgpack.encode(pressed))
            return


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
        await served.is_quiet()

    _served(scenario)


def test_a_watcher_sees_the_scene_and_cannot_operate() -> None:
    async def scenario(served: Served) -> None:
        async with served.client(served.watch_at.path) as client:
            await _press_stop(client)
            drag = {"name": "/goal_frames/0", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.5, 0.0, 0.0), "owner": ""}
            await client.send(msgspec.msgpack.encode({"type": "TransformControlsUpdateMessage", **drag}))
            await client.send(b"\xc1")  # no message at all
            await served.is_quiet()

    _served(scenario)


def test_no_client_can_publish_the_page_on_the_internet(monkeypatch: pytest.MonkeyPatch) -> None:
    tunnels: list[object] = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *arguments: tunnels.append(arguments))

    async def scenario(served: Served) -> None:
        async with served.client(served.at.path) as client:
            await client.send(msgspec.msgpack.encode(CAMERA))
            for name in ("ShareUrlRequest", "ShareUrlDisconnect"):
                await client.send(msgspec.msgpack.encode({"type": name}))
            await _press_stop(client)  # messages are processed in order
            assert (await anext(served.commands)).command is Command.STOP
            await asyncio.sleep(QUIET_S)

    _served(scenario)
    assert tunnels == []


def _request(path: str, *headers: tuple[str, str]) -> Request:
    return Request(path, Headers(headers))


@pytest.mark.parametrize("path", [f"/{KEY}", f"/{KEY}/", f"/{KEY}?websocket=ws://x", f"/{watch_key(KEY)}/index.html"])
def test_the_key_is_the_first_part_of_the_path(path: str) -> None:
    assert PageGate("127.0.0.1", KEY).refusal(_request(path, ("Host", "localhost:80")), ("127.0.0.1", 80)) is not None
    assert PageGate("127.0.0.1", KEY).refusal(_request(path, ("Host", "localhost")), ("127.0.0.1", 80)) is None


@pytest.mark.parametrize("path", ["", "/", "//", f"/{KEY}x", f"//{KEY}", f"/%74{KEY[1:]}", "/sch\udcfcssel"])
def test_another_path_is_refused(path: str) -> None:
    reason = PageGate("127.0.0.1", KEY).refusal(_request(path, ("Host", "[::1]:8080")), ("::1", 8080))
    assert reason is not None
    assert "address that dlokit printed" in reason


def test_a_page_for_all_addresses_is_served_for_the_one_at_which_a_request_arrives() -> None:
    gate, local = PageGate("0.0.0.0", KEY), ("10.0.0.5", 8080)
    assert gate.refusal(_request(f"/{KEY}", ("Host", "10.0.0.5:8080")), local) is None
    assert gate.refusal(_request(f"/{KEY}", ("Host", "10.0.0.6:8080")), local) is not None
    assert gate.refusal(_request(f"/{KEY}", ("Host", "0.0.0.0:8080")), local) is not None


@pytest.mark.parametrize("hosts", [(), ("localhost:8080", "localhost:8080")])
def test_a_request_for_no_host_or_for_two_is_refused(hosts: tuple[str, ...]) -> None:
    request = _request(f"/{KEY}", *(("Host", host) for host in hosts))
    assert PageGate("127.0.0.1", KEY).refusal(request, ("127.0.0.1", 8080)) is not None


def _refuses_to_start(reason: str) -> None:
    with pytest.raises(MachineError, match=rf"viser {viser.__version__}.*{reason}"):
        open_page("127.0.0.1", 0, new_key())  # the port follows from the key: no other test may take it


def test_an_incompatible_viser_serves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    starts = importlib.import_module("viser.infra._infra")
    monkeypatch.setattr(starts, "websockets", SimpleNamespace(**vars(vars(starts)["websockets"])))
    _refuses_to_start("serve")


def test_a_viser_whose_pages_cannot_be_woken_serves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "dlokit.skills.viewer.serving.wakeups", None)  # its import fails
    _refuses_to_start("wakeups")


def test_a_server_that_does_not_require_the_key_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[viser.ViserServer] = []
    monkeypatch.setattr(PageGate, "_gated", lambda _, serve: serve)
    monkeypatch.setattr("dlokit.skills.viewer.serving.page.remove_sharing", started.append)
    ended: list[viser.ViserServer] = []
    monkeypatch.setattr(viser.ViserServer, "stop", _then(viser.ViserServer.stop, ended.append))
    _refuses_to_start("without the check")
    assert (len(started), len(ended)) == (0, 1)
    check_port("127.0.0.1", ended[0].get_port())


def _then(first: Callable[[Any], object], second: Callable[[Any], object]) -> Callable[[Any], None]:
    def both(argument: Any) -> None:
        first(argument)
        second(argument)

    return both


@pytest.mark.parametrize("name", ["ShareUrlRequest", "ShareUrlDisconnect", "ViewerCameraMessage"])
def test_a_viser_without_a_known_message_is_refused(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(f"viser._messages.{name}")
    _refuses_to_start(name)


def test_no_handler_for_sharing_is_left() -> None:
    server = open_page("127.0.0.1", 0, KEY)
    try:
        names = {kind.__name__ for kind in vars(vars(server)["_websock_server"])["_incoming_handlers"]}
    finally:
        server.stop()
    assert "GuiUpdateMessage" in names
    assert {name for name in names if "Share" in name or "Tunnel" in name} == set()
