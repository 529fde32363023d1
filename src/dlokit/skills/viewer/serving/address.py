"""The addresses of the viewer's page: the keys in their paths, the port, and the files of a run below them."""

import base64
import hashlib
import hmac
import re
import secrets
import socket
from collections.abc import Callable, Mapping
from pathlib import Path

from dlokit.errors import MachineError

KEY_BYTES = 24
EVERY_ADDRESS = ("0.0.0.0", "::")
"""Hosts that stand for all addresses of the machine."""
HTTP_PORT = 80
"""The port that browsers omit from an address."""
_LASTING_PORTS = range(20_000, 32_000)
"""Ports below those that systems assign to outgoing connections (from 32,768)."""


CheckPort = Callable[[str, int], None]
"""Checks whether a page can be served at a host and a port, as `check_port` does."""


def new_key() -> str:
    """A new random key, of characters that need no escape in a URL."""
    return secrets.token_urlsafe(KEY_BYTES)


def watch_key(key: str) -> str:
    """The key of pages that may only watch; the operator's `key` cannot be derived from it."""
    digest = hmac.digest(key.encode(), b"watch", hashlib.sha256)
    return base64.urlsafe_b64encode(digest[:KEY_BYTES]).decode()


def page_url(host: str, port: int, key: str) -> str:
    """URL for a browser on the viewer's machine of the page that is served on `host`:`port` with `key`."""
    return f"http://{authority('localhost' if host in EVERY_ADDRESS else host, port)}/{key}"


def authority(host: str, port: int) -> str:
    """Host and port as a browser sends them in `Host`: IPv6 addresses in brackets, port 80 omitted."""
    host = f"[{host}]" if ":" in host else host
    return host.lower() if port == HTTP_PORT else f"{host}:{port}".lower()


def check_port(host: str, port: int) -> None:
    """Raise `MachineError` when a page cannot be served at `host`:`port`; port 0 means any free one."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise MachineError(
            f"The viewer's address {host!r} is not known to this machine ({error}); "
            f"allowed are 127.0.0.1 and this machine's own addresses. Choose one with --viewer.host."
        ) from error
    with socket.socket(family, kind, protocol) as probe:
        # As the server does: a port that another server has just released can be used immediately.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(address)
        except OSError as error:
            raise MachineError(
                f"The viewer cannot use port {port} of {host} ({error.strerror}): "
                f"another program uses it, or you lack the permission. Choose another one with --port, "
                f"e.g. --port {port + 1 if port < 65535 else 8080}, or any free one with --port 0."
            ) from error


def lasting_port(host: str, key: str, check: CheckPort = check_port) -> int:
    """The port of the page with `key` if any free port is requested: the same each time the page is served.

    Open pages thus reconnect to a restarted viewer. 0, any free port, where `check` finds that another program uses it.
    """
    digest = hmac.digest(key.encode(), b"port", hashlib.sha256)
    port = _LASTING_PORTS[int.from_bytes(digest) % len(_LASTING_PORTS)]
    try:
        check(host, port)
    except MachineError:
        return 0
    return port


PREFIX = "files/"
"""Path of the files below the key in the page's address."""
KINDS: Mapping[str, str] = {
    "report.html": "text/html; charset=utf-8",
    "result.json": "application/json",
    "goal.csv": "text/csv; charset=utf-8",
    "nearest_goal.csv": "text/csv; charset=utf-8",
    "config.toml": "text/plain; charset=utf-8",
}
"""Names of the files → their content types."""
_ALLOWED = re.compile(rf"(task-\d{{1,6}}/)?({'|'.join(map(re.escape, KINDS))})")
# A report shows texts of a configuration from another author: styles are allowed, scripts and requests are not.
HEADERS: Mapping[str, str] = {
    "Content-Security-Policy": "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class RunFiles:
    """Reads the files of one run's folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, name: str) -> tuple[bytes, str] | None:
        """Content and content type of a file by its path in the folder; None if it is missing or not served."""
        if not _ALLOWED.fullmatch(name):
            return None
        path = self._folder / name
        try:
            # A link could lead out of the folder.
            if path.is_symlink() or path.parent.is_symlink():
                return None
            return path.read_bytes(), KINDS[path.name]
        except OSError:
            return None
