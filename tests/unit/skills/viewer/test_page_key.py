"""Access to the viewer's page: what its gate admits. Clients that connect to it are in tests/live."""

import importlib
import re
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from unheard_page import every_port_is_free, open_unheard_page, serve_nobody
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.server import ServerProtocol

from dlokit.communication.timing import virtual_time
from dlokit.errors import MachineError
from dlokit.skills.viewer.serving.address import new_key, watch_key
from dlokit.skills.viewer.serving.page import PageConnection, PageGate, close_page, open_page

KEY = "the-key"
PORT = 8080
OWN = f"127.0.0.1:{PORT}"


def _request(path: str, *headers: tuple[str, str]) -> Request:
    return Request(path, Headers(headers))


class Arrived(SimpleNamespace):
    """Where a connection arrived, as its transport tells."""

    def get_extra_info(self, name: str) -> tuple[str, int]:
        assert name == "sockname"
        return ("127.0.0.1", PORT)


def _answered(request: Request) -> tuple[Response | None, bool]:
    """What the server of a page answers, None where the handshake goes on; and whether its client may operate."""
    options: dict[str, Any] = {}

    def serve(*arguments: Any, **given: Any) -> Any:
        options.update(given)
        return serve_nobody()

    async def scenario() -> tuple[Response | None, bool]:
        connection: ServerConnection = options["create_connection"](ServerProtocol(), None)
        assert isinstance(connection, PageConnection)
        connection.transport = Arrived()  # pyright: ignore[reportAttributeAccessIssue]
        return options["process_request"](connection, request), connection.operates

    server = open_page("127.0.0.1", PORT, KEY, check=every_port_is_free, serve=serve)
    try:
        return virtual_time.run(scenario())
    finally:
        close_page(server)


def _handshake(path: str, host: str = OWN, origin: str = f"http://{OWN}") -> Request:
    """The request of a page of `origin` on `host` for a websocket."""
    return _request(path, ("Host", host), ("Origin", origin), ("Upgrade", "websocket"))


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "LocalHost"])
@pytest.mark.parametrize(("key", "operates"), [(KEY, True), (watch_key(KEY), False)])
def test_the_own_page_is_admitted_under_the_names_of_this_machine(host: str, key: str, operates: bool) -> None:
    own = f"{host}:{PORT}"
    assert _answered(_handshake(f"/{key}", own, f"http://{own}")) == (None, operates)


@pytest.mark.parametrize(
    "hostile",
    [
        pytest.param(_handshake(""), id="no key"),
        pytest.param(_handshake(f"/{'x' * len(KEY)}"), id="a wrong key"),
        pytest.param(_handshake(f"/{KEY[:-1]}"), id="part of the key"),
        pytest.param(_handshake(f"/?key={KEY}"), id="the key in the query"),
        pytest.param(_handshake(f"/x/{KEY}"), id="the key behind another"),
        pytest.param(_handshake(f"/{KEY}", origin="http://evil.example"), id="a foreign page"),
        pytest.param(_handshake(f"/{KEY}", origin=f"http://127.0.0.1:{PORT + 1}"), id="a page of another port"),
        pytest.param(_handshake(f"/{KEY}", origin="null"), id="a page of a file"),
        pytest.param(_handshake(f"/{KEY}", origin=f"https://{OWN}"), id="the own page by another scheme"),
        pytest.param(_handshake(f"/{KEY}", "evil.example:8080", "http://evil.example:8080"), id="another host"),
        pytest.param(_handshake(f"/{KEY}", "evil.example:8080"), id="another host with the own page"),
        pytest.param(_handshake(f"/{KEY}", f"127.0.0.1:{PORT + 1}", f"http://127.0.0.1:{PORT + 1}"), id="another port"),
        pytest.param(_handshake(f"/{KEY}", "127.0.0.1", "http://127.0.0.1"), id="no port"),
    ],
)
def test_a_hostile_handshake_is_refused_and_does_not_learn_the_key(hostile: Request) -> None:
    answer, operates = _answered(hostile)
    assert answer is not None
    assert answer.status_code == 403
    assert KEY.encode() not in (answer.body or b"")
    assert not operates


@pytest.mark.parametrize("encoding", ["gzip", "identity"])
def test_the_browsers_tab_is_named_dlokit(encoding: str) -> None:
    answer, _ = _answered(_request(f"/{KEY}/", ("Host", OWN), ("Accept-Encoding", encoding)))
    assert answer is not None
    assert re.findall("<title>(.*?)</title>", bytes(answer.body).decode()) == ["dlokit"]


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
        open_unheard_page("127.0.0.1", 0, new_key())


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
    assert not vars(vars(ended[0])["_websock_server"])["_server_thread"].is_alive()


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
    server = open_unheard_page("127.0.0.1", 0, KEY)
    try:
        names = {kind.__name__ for kind in vars(vars(server)["_websock_server"])["_incoming_handlers"]}
    finally:
        close_page(server)
    assert "GuiUpdateMessage" in names
    assert {name for name in names if "Share" in name or "Tunnel" in name} == set()
