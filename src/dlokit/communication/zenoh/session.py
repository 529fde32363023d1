"""Opening a zenoh session that stays on this machine, or goes where it is told to."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import zenoh

from dlokit.communication.timing.urgency import threads_urgent
from dlokit.communication.zenoh.access import HostRights, access_control
from dlokit.errors import MachineError

SHARED_FROM_BYTES = 2**16
LINK_LEASE_MS = 5000
"""Between hosts: a link that is silent for so long is gone. zenoh sends a sign of life four times in it."""
RETRY_FIRST_MS = 500
RETRY_LONGEST_MS = 2000
"""How soon a link between hosts that is gone is tried again, at first and at the latest."""


@dataclass(frozen=True, kw_only=True)
class TlsFiles:
    """Paths of the files with which a host proves who it is, and recognises others."""

    authority: str
    """Of the lab: whoever it has not signed cannot connect."""
    certificate: str
    """Its common name is the host's name."""
    key: str


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
    role: Literal["peer", "client", "router"] = "peer"
    """On one machine everybody is a peer. Between several, a router is its host's door: it passes on what the host's
    own processes, its clients, and other doors say."""
    connect_within_s: float | None = None
    """Opening fails when no connection stands after so long; None: it is tried for ever, beside everything else."""
    tls: TlsFiles | None = None
    """For endpoints `tls/…`: both ends prove who they are."""
    others: tuple[HostRights, ...] | None = None
    """What other hosts may do here; None: no access control, e.g. where no other host can connect."""


OpenSession = Callable[[ZenohConfig], zenoh.Session]
"""Opens a session as configured; a bench may put something of its own in between."""


def open_session(config: ZenohConfig) -> zenoh.Session:
    """A session of peers. Raises `MachineError` when an endpoint cannot be used."""
    settings = zenoh.Config()
    for key, value in _settings(config).items():
        settings.insert_json5(key, json.dumps(value))
    try:
        # Heartbeats, and orders to brake, pass through its threads; they move bytes, and nothing of ours runs on them.
        with threads_urgent():
            return zenoh.open(settings)
    except zenoh.ZError as error:
        raise MachineError(
            f"the bus cannot listen on {config.listen} or reach {config.connect}: {error}; "
            f"end the other run that uses the endpoint, or configure another one"
        ) from error


def _settings(config: ZenohConfig) -> dict[str, object]:
    settings: dict[str, object] = {
        "mode": config.role,
        "namespace": config.namespace,
        "listen/endpoints": list(config.listen),
        "connect/endpoints": list(config.connect),
        # Nobody waits for peers at the start: liveliness says who is there.
        "connect/timeout_ms": -1 if config.connect_within_s is None else round(config.connect_within_s * 1000),
        "connect/exit_on_failure": config.connect_within_s is not None,
        "scouting/delay": 0,
        "scouting/multicast/enabled": config.multicast_interface is not None,
        # A cloud goes faster through the socket than through shared memory, a picture the other way round.
        "transport/shared_memory/transport_optimization/message_size_threshold": SHARED_FROM_BYTES,
        # A reader that hangs may hold up a writer this long [µs], then its link is closed.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
    }
    if config.multicast_interface is not None:
        settings["scouting/multicast/interface"] = config.multicast_interface
    if config.role != "peer":
        settings |= _DOORS
    if config.tls is not None:
        settings |= _tls_settings(config.tls)
    if config.others is not None:
        settings["access_control"] = access_control(config.namespace, config.others)
    return settings


_DOORS: dict[str, object] = {
    "transport/link/tx/lease": LINK_LEASE_MS,
    "connect/retry": {
        "period_init_ms": RETRY_FIRST_MS,
        "period_max_ms": RETRY_LONGEST_MS,
        "period_increase_factor": 2,
    },
}


def _tls_settings(files: TlsFiles) -> dict[str, object]:
    return {
        f"transport/link/tls/{key}": value
        for key, value in {
            "root_ca_certificate": files.authority,
            "listen_certificate": files.certificate,
            "listen_private_key": files.key,
            "connect_certificate": files.certificate,
            "connect_private_key": files.key,
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }.items()
    }
