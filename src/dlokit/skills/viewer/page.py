"""The server of the page: opened on a port of this machine, behind a key, or not at all."""

import contextlib
import io

import viser

from dlokit.errors import MachineError
from dlokit.skills.viewer.page_key import PageGate, check_guarded, check_viser, remove_sharing
from dlokit.skills.viewer.port import check_port


def open_page(host: str, port: int, key: str) -> viser.ViserServer:
    """Serve a page at `page_url(host, port, key)`, and nothing without the key; ends with `close_page`.

    Raises `MachineError` as `check_port` does, and with a viser whose page cannot be protected.
    """
    check_viser()
    # The server would quietly take the next port, and wait for ever on an address that there is not.
    check_port(host, port)
    gate = PageGate(host, key)
    # It prints a banner; the command line prints the address.
    with gate.guarding(), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=host, port=port, label="dlokit", verbose=False)
    try:
        check_guarded(gate)
        remove_sharing(server)
        if port != 0 and server.get_port() != port:
            raise MachineError(
                f"The viewer's port {port} was taken by another program just now; "
                "choose another one with --viewer.port."
            )
    except MachineError:
        close_page(server)
        raise
    return server


def close_page(server: viser.ViserServer) -> None:
    """End the server and its threads."""
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a farewell
        server.stop()
