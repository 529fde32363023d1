"""Whether a page can be served at an address, found out before anything is started."""

import socket

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
