"""Peers that zenoh refuses, in the log of the process that refused them.

zenoh reports a refusal only in its own debug log, which it writes to the standard output. This module redirects that
output into a pipe, and logs one sentence for the refusals of a period, so that a peer that tries again and again does
not fill a disk.
"""

import logging
import os
import sys
import threading
import time
from collections.abc import Callable

import zenoh

from dlokit.communication.log_rate import LogRate

log = logging.getLogger(__name__)

_ACCEPT = "zenoh_transport::unicast::establishment::accept"
_REFUSAL = b"UsrPwd extension"
"""What zenoh writes of a peer without a login or with a wrong one, and of no other."""


class RefusalLog:
    """Logs refusals: the first at once, later ones with their number, at the rate of `LogRate`."""

    def __init__(self, monotonic_s: Callable[[], float] = time.monotonic) -> None:
        self._rate = LogRate(monotonic_s)

    def take(self, line: bytes) -> bool:
        """Take one line; returns whether it is of zenoh's log."""
        if _ACCEPT.encode() not in line:
            return False
        if _REFUSAL in line and (attempts := self._rate.due("refused")):
            log.warning("refused on the bus: a peer without the key of this run; attempts: %d", attempts)
        return True


def log_refused_peers() -> None:
    """Log refused peers from now on; other output of this process goes to its standard error. Call this once."""
    os.environ.pop("RUST_LOG", None)  # zenoh would prefer it, and log configurations with the key
    reading, writing = os.pipe()
    os.set_blocking(writing, False)  # a reader that waits for the interpreter must not delay zenoh
    sys.stdout.flush()
    os.dup2(writing, 1)
    os.close(writing)
    zenoh.init_log_from_env_or(f"off,{_ACCEPT}=debug")
    threading.Thread(target=_read, args=(reading,), name="refused peers", daemon=True).start()


def _read(reading: int) -> None:
    refusals = RefusalLog()
    with os.fdopen(reading, "rb") as lines:
        for line in lines:
            if not refusals.take(line):
                os.write(2, line)  # a library's own output
