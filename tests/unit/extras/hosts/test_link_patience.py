"""Links between hosts are limited, other connections are left alone."""

import socket
from contextlib import ExitStack

import pytest

from dlokit.extras.hosts.routers import limit_links

OPTION = getattr(socket, "TCP_USER_TIMEOUT", None)


@pytest.mark.live
@pytest.mark.skipif(OPTION is None, reason="this system knows no such limit")
def test_links_to_and_from_the_port_are_limited_and_no_others() -> None:
    assert OPTION is not None
    with ExitStack() as stack:
        listening, elsewhere = (stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(2))
        out, other = (
            stack.enter_context(socket.create_connection(server.getsockname())) for server in (listening, elsewhere)
        )
        accepted = stack.enter_context(listening.accept()[0])
        limit_links(listening.getsockname()[1], 5000)
        limits = [each.getsockopt(socket.IPPROTO_TCP, OPTION) for each in (out, accepted, other)]
        assert limits == [5000, 5000, 0]
