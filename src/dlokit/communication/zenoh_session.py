"""Opening a zenoh session that stays on this machine, or goes where it is told to."""

import json
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from dlokit.errors import MachineError

SHARED_FROM_BYTES = 2**16


@dataclass(frozen=True, kw_only=True)
class ZenohConfig:
    """How the processes of one run find one another."""

    namespace: str
    """Prefix of every key, so that runs side by side do not hear each other."""
    listen: tuple[str, ...] = ("tcp/127.0.0.1:0",)
    """Endpoints to listen on; the default opens no port to the network."""
    connect: tuple[str, ...] = ()
    """Endpoints to connect to: where the processes of the run meet."""
    multicast_interface: str | None = None
    """Interface on which peers find one another by themselves, e.g. `lo`; None: only through `connect`.

    Whoever searches opens a socket of all interfaces for the answers: it is off unless asked for.
    """


OpenSession = Callable[[ZenohConfig], zenoh.Session]
"""Opens a session as configured; a bench may put something of its own in between."""


def open_session(config: ZenohConfig) -> zenoh.Session:
    """A session of peers. Raises `MachineError` when an endpoint cannot be used."""
    settings = zenoh.Config()
    for key, value in _settings(config).items():
        settings.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(settings)
    except zenoh.ZError as error:
        raise MachineError(
            f"the bus cannot listen on {config.listen} or reach {config.connect}: {error}; "
            f"end the other run that uses the endpoint, or configure another one"
        ) from error


def _settings(config: ZenohConfig) -> dict[str, object]:
    settings: dict[str, object] = {
        "mode": "peer",
        "namespace": config.namespace,
        "listen/endpoints": list(config.listen),
        "connect/endpoints": list(config.connect),
        # Nobody waits for peers at the start: liveliness says who is there.
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "scouting/delay": 0,
        "scouting/multicast/enabled": config.multicast_interface is not None,
        # A cloud goes faster through the socket than through shared memory, a picture the other way round.
        "transport/shared_memory/transport_optimization/message_size_threshold": SHARED_FROM_BYTES,
        # A reader that hangs may hold up a writer this long [µs], then its link is closed.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
    }
    if config.multicast_interface is not None:
        settings["scouting/multicast/interface"] = config.multicast_interface
    return settings
