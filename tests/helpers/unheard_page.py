"""The viewer's page on which nothing listens: viser's own server, with its thread and its messages, and no socket."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from types import SimpleNamespace
from typing import Any

import viser

from dlokit.skills.viewer.serving.address import RunFiles
from dlokit.skills.viewer.serving.page import open_page


@asynccontextmanager
async def serve_nobody(*_: Any, **__: Any) -> AsyncGenerator[SimpleNamespace]:
    """Listen nowhere."""
    yield SimpleNamespace(server=SimpleNamespace(sockets=()))


def every_port_is_free(host: str, port: int) -> None:
    """No other program has a port."""


def open_unheard_page(host: str, port: int, key: str, files: RunFiles | None = None) -> viser.ViserServer:
    """Open a page as `open_page` does, but for the socket."""
    return open_page(host, port, key, files, check=every_port_is_free, serve=serve_nobody)
