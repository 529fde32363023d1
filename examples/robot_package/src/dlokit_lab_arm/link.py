"""The connection to the controller: replace this file by the library of your arm."""

import json
import socket
import threading
import time
from typing import Any

CONNECT_S = 2.0


class Link:
    """Orders go out from any thread; a thread of its own receives the states, however busy the event loop is."""

    def __init__(self, address: str, port: int) -> None:
        """Connect, and wait for the first state. Raises `OSError`."""
        self._socket = socket.create_connection((address, port), timeout=CONNECT_S)
        self._sending = threading.Lock()
        self._heard = threading.Event()
        self.newest: tuple[dict[str, Any], int] = ({}, 0)
        """The newest state, and when it arrived on the machine's monotonic clock [ns]."""
        self.is_lost = False
        threading.Thread(target=self._receive, name="lab arm", daemon=True).start()
        if not self._heard.wait(CONNECT_S) or self.is_lost:
            self.close()
            raise TimeoutError(f"no state came within {CONNECT_S:g} s")

    def send(self, order: str, **values: Any) -> None:
        """Send an order; does nothing after the connection was lost, which `is_lost` says."""
        line = json.dumps({"order": order, **values}).encode() + b"\n"
        try:
            with self._sending:
                self._socket.sendall(line)
        except OSError:
            self.is_lost = True

    def close(self) -> None:
        """Disconnect."""
        self.is_lost = True
        self._socket.close()

    def _receive(self) -> None:
        try:
            with self._socket.makefile("rb") as lines:
                for line in lines:
                    self.newest = (json.loads(line), time.monotonic_ns())
                    self._heard.set()
        except (OSError, ValueError):
            pass
        self.is_lost = True
        self._heard.set()
