"""The server of the page: admits only browsers that have its key, and passes their callbacks to the event loop.

The client of viser connects its websocket to the address of its page, path included, so a key in the path of the page
is also in the path of the websocket's handshake. viser has no hook there, so its call of
`websockets.asyncio.server.serve` is replaced while its server starts. A viser without that call serves no page.
"""

import asyncio
import contextlib
import gzip
import importlib
import io
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable, Coroutine, Generator
from contextlib import contextmanager
from dataclasses import replace
from html import escape
from http import HTTPStatus
from typing import Any, ParamSpec

import msgspec
import viser
import viser.infra
import websockets
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from dlokit.errors import MachineError
from dlokit.skills.viewer.serving.address import (
    EVERY_ADDRESS,
    HEADERS,
    PREFIX,
    CheckPort,
    RunFiles,
    authority,
    check_port,
    lasting_port,
    watch_key,
)

P = ParamSpec("P")


class LoopGate:
    """Lets other threads run functions on one event loop. Calls after `shut` are dropped."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._open = True

    def post(self, function: Callable[P, object], *args: P.args, **kwargs: P.kwargs) -> None:
        """Run ``function(*args, **kwargs)`` on the loop, soon. Callable on any thread."""
        if not self._open:
            return
        try:
            self._loop.call_soon_threadsafe(self._run, lambda: function(*args, **kwargs))
        except RuntimeError:
            # The loop was closed between the check and the call.
            self._open = False

    def posting(self, function: Callable[[], object]) -> Callable[[object], Coroutine[Any, Any, None]]:
        """A callback for the page that ignores the event and runs `function` on the loop."""

        async def posted(_: object) -> None:
            self.post(function)

        return posted

    def shut(self) -> None:
        """Drop all further calls, including posted ones."""
        self._open = False

    def _run(self, function: Callable[[], object]) -> None:
        if self._open:
            function()


ServePage = Callable[[ServerConnection, Request], Awaitable[Response | None] | Response | None]
"""Answers a request for a file; None for the handshake of a websocket, which then continues."""
Serve = Callable[..., Any]
"""Listens for connections, as `websockets.asyncio.server.serve` does."""
OpenPage = Callable[[str, int, str, RunFiles | None], viser.ViserServer]
"""Opens a page, as `open_page` does."""

SHARE_MESSAGES = ("ShareUrlRequest", "ShareUrlDisconnect")
"""Messages with which a browser asks viser to publish the page on the internet."""
WATCHER_MESSAGES = frozenset({"ViewerCameraMessage"})
"""Messages accepted from a page without operation: viser draws nothing for a client before it knows its camera."""

_SERVE = "serve"
_starting = threading.Lock()


class PageConnection(ServerConnection):
    """A connection that drops a watcher's messages; every client is a watcher until it is admitted as an operator."""

    operates = False

    async def recv(self, decode: Any = None) -> Any:
        """The next message that the client may send."""
        while True:
            data = await super().recv(decode)
            if self.operates or _may_be_sent_by_a_watcher(data):
                return data


def _may_be_sent_by_a_watcher(data: object) -> bool:
    try:
        message = msgspec.msgpack.decode(data) if isinstance(data, bytes) else None
    except msgspec.DecodeError:
        return False
    return isinstance(message, dict) and message.get("type") in WATCHER_MESSAGES


class PageGate:
    """Checks every request to the server of one page, before viser handles it."""

    def __init__(self, host: str, key: str, files: RunFiles | None = None) -> None:
        """Admit requests under `host` and the names of the loopback interface; `key` is in their path.

        `files` are served below it; None: no files.
        """
        self._key = key
        self._files = files
        self._watch_key = watch_key(key)
        self._hosts = ("localhost", "127.0.0.1", "::1", socket.gethostname() if host in EVERY_ADDRESS else host)
        self.in_place = False
        """Whether a server uses this gate."""

    @contextmanager
    def guarding(self, serve: Serve = websockets.asyncio.server.serve) -> Generator[None]:
        """A context in which every started server uses this gate, and listens with `serve`."""
        with _starting:
            module, before = websockets.asyncio.server, websockets.asyncio.server.serve
            setattr(module, _SERVE, self._gated(serve))
            try:
                yield
            finally:
                setattr(module, _SERVE, before)

    def refusal(self, request: Request, local: tuple[str, int]) -> str | None:
        """Why a request to the address `local` is refused; None if it is accepted."""
        allowed = [authority(host, local[1]) for host in (*self._hosts, local[0])]
        hosts = [host.lower() for host in request.headers.get_all("Host")]
        if len(hosts) != 1 or hosts[0] not in allowed:
            return (
                f"The request is for the host {hosts!r}; this page is served for {', '.join(dict.fromkeys(allowed))}. "
                "Open the address that dlokit printed; a tunnel must have the same port at both ends."
            )
        origins = request.headers.get_all("Origin")  # browsers send it with every handshake of a websocket
        if any(origin.lower() != f"http://{hosts[0]}" for origin in origins):
            return f"The request comes from a page of {origins!r}; only the viewer's own page may make it."
        if not (_is_in(request, self._key) or _is_in(request, self._watch_key)):
            return "The key of the page is missing or wrong. Open the whole address that dlokit printed last."
        return None

    def _gated(self, serve: Serve) -> Serve:
        # It must not raise: viser would wait without a time limit for a dead server thread.
        def gated_serve(*args: Any, **options: Any) -> Any:
            self.in_place = True
            options["process_request"] = self._admission(options.get("process_request"))
            options["create_connection"] = PageConnection
            return serve(*args, **options)

        return gated_serve

    def _admission(self, serve_page: ServePage | None) -> ServePage:
        def admit(connection: ServerConnection, request: Request) -> Awaitable[Response | None] | Response | None:
            if (reason := self.refusal(request, connection.local_address[:2])) is not None:
                return connection.respond(HTTPStatus.FORBIDDEN, reason + "\n")
            if isinstance(connection, PageConnection):
                connection.operates = _is_in(request, self._key)
            given, *rest = _segments(request)
            path = "/".join(rest)
            if path.startswith(PREFIX):
                return self._file(connection, path.removeprefix(PREFIX))
            answer = None if serve_page is None else serve_page(connection, replace(request, path=f"/{path}"))
            return titled(answer, f"/{given}/") if isinstance(answer, Response) else answer

        return admit

    def _file(self, connection: ServerConnection, name: str) -> Response:
        found = None if self._files is None else self._files.read(name)
        if found is None:
            return connection.respond(HTTPStatus.NOT_FOUND, f"This page serves no file {name!r}.\n")
        body, kind = found
        answer = connection.respond(HTTPStatus.OK, "")
        headers = answer.headers.copy()
        for header in ("Content-Type", "Content-Length"):
            headers.pop(header, None)
        headers["Content-Type"], headers["Content-Length"] = kind, str(len(body))
        for header, value in HEADERS.items():
            headers[header] = value
        return replace(answer, headers=headers, body=body)


_VISERS_TITLE, _TITLE = b"<title>Viser</title>", b"<title>dlokit</title>"


def titled(answer: Response, base: str) -> Response:
    """The answer with dlokit's title in place of viser's.

    Its relative links begin at `base`, which contains the visitor's key.
    """
    if not answer.headers.get("Content-Type", "").startswith("text/html"):
        return answer
    packed = answer.headers.get("Content-Encoding") == "gzip"
    body = gzip.decompress(answer.body) if packed else bytes(answer.body)
    if _VISERS_TITLE not in body:
        return answer
    body = body.replace(_VISERS_TITLE, _TITLE + f'<base href="{escape(base)}">'.encode(), 1)
    headers = answer.headers.copy()
    for name in ("Content-Encoding", "Content-Length"):
        headers.pop(name, None)
    headers["Content-Length"] = str(len(body))
    return replace(answer, headers=headers, body=body)


def _segments(request: Request) -> list[str]:
    return request.path.partition("?")[0].removeprefix("/").split("/")


def _is_in(request: Request, key: str) -> bool:
    given = _segments(request)[0].encode(errors="surrogateescape")
    return secrets.compare_digest(given, key.encode())


def check_viser() -> None:
    """Raise `MachineError` when the gate cannot guard the server of the installed viser."""
    try:
        starts = importlib.import_module("viser.infra._infra")
        messages = importlib.import_module("viser._messages")
    except ImportError as error:
        raise _unknown_viser(str(error)) from error
    if vars(starts).get("websockets") is not websockets:
        raise _unknown_viser("its server is not started by websockets.asyncio.server.serve")
    for name in (*SHARE_MESSAGES, *WATCHER_MESSAGES):
        if not hasattr(messages, name):
            raise _unknown_viser(f"it has no message {name}")


def _wake_on_loop() -> None:
    try:
        from dlokit.skills.viewer.serving.wakeups import wake_on_loop  # needs a module of viser that may be missing
    except ImportError as error:
        raise _unknown_viser(str(error)) from error
    wake_on_loop()


def remove_sharing(server: viser.ViserServer) -> None:
    """Remove the server's handlers of requests to publish the page. Raises `MachineError` if they are missing."""
    inner = vars(server).get("_websock_server")
    if not isinstance(inner, viser.infra.WebsockServer):
        raise _unknown_viser("its server is not where it was")
    handlers = vars(inner).get("_incoming_handlers")
    kinds = {kind.__name__: kind for kind in handlers} if isinstance(handlers, dict) else {}
    for name in SHARE_MESSAGES:
        if name not in kinds:
            raise _unknown_viser(f"it has no handler of {name}")
        inner.unregister_handler(kinds[name])


def check_guarded(gate: PageGate) -> None:
    """Raise `MachineError` when a started server does not use `gate`."""
    if not gate.in_place:
        raise _unknown_viser("its server was started without the check of the key")


def _unknown_viser(what: str) -> MachineError:
    return MachineError(
        f"The viewer's page cannot be protected with viser {viser.__version__}: {what}. "
        "Allowed is the version in requirements.lock; install it, or run with --headless."
    )


def open_page(
    host: str,
    port: int,
    key: str,
    files: RunFiles | None = None,
    *,
    check: CheckPort = check_port,
    serve: Serve = websockets.asyncio.server.serve,
) -> viser.ViserServer:
    """Serve a page at `page_url(host, port, key)`, and nothing without the key; ends with `close_page`.

    Port 0 is a free one, the same for every page of this `key` (see `lasting_port`). `files` of a run are served
    below it. `check` checks that the port is free, and `serve` listens on it.

    Raises `MachineError` as `check_port` does, and with a viser whose page cannot be protected.
    """
    check_viser()
    _wake_on_loop()
    # The server would silently take the next port, and wait without a time limit on an unknown address.
    check(host, port)
    served_on = port or lasting_port(host, key, check)
    gate = PageGate(host, key, files)
    # Viser prints a banner; the command line prints the address.
    with gate.guarding(serve), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=served_on, label="dlokit", verbose=False)
    try:
        check_guarded(gate)
        remove_sharing(server)
        if port != 0 and server.get_port() != port:
            raise MachineError(
                f"Another program has just taken the viewer's port {port}; choose another one with --port."
            )
    except MachineError:
        close_page(server)
        raise
    return server


def close_page(server: viser.ViserServer) -> None:
    """End the server and its threads."""
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints a message at its end
        server.stop()
