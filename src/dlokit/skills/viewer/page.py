"""The server of the page: opened on a port of this machine, or not at all."""

import contextlib
import io

import viser

from dlokit.errors import MachineError
from dlokit.skills.viewer.port import check_port


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
