"""The server of the page: opened on a port of this machine, or not at all."""

import contextlib
import io
import socket

import viser

from dlokit.errors import MachineError


def check_port(host: str, port: int) -> None:
    """Raise `MachineError` when a page cannot be served at `host`:`port`; port 0 stands for any free one."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise MachineError(
            f"The viewer's address {host!r} is not known to this machine ({error}); "
            f"allowed are 127.0.0.1 and this machine's own addresses. Choose one with --viewer.host."
        ) from error
    with socket.socket(family, kind, protocol) as probe:
        # As the server does it: a port that a server has just left may be taken at once.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(address)
        except OSError as error:
            raise MachineError(
                f"The viewer cannot use port {port} of {host} ({error.strerror}): "
                f"another program has it, or it is not yours to use. Choose another one with --viewer.port, "
                f"e.g. --viewer.port {port + 1 if port < 65535 else 8080}, or any free one with --viewer.port 0."
            ) from error


def open_page(host: str, port: int) -> viser.ViserServer:
    """Serve a page; ends with `close_page`. Raises `MachineError` as `check_port` does."""
    # The server would quietly take the next port, and wait for ever on an address that there is not.
    check_port(host, port)
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a banner; the command line prints the address
        server = viser.ViserServer(host=host, port=port, label="dlokit", verbose=False)
    if port != 0 and server.get_port() != port:
        close_page(server)
        raise MachineError(
            f"The viewer's port {port} was taken by another program just now; choose another one with --viewer.port."
        )
    return server


def close_page(server: viser.ViserServer) -> None:
    """End the server and its threads."""
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a farewell
        server.stop()
