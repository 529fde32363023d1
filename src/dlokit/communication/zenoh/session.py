"""Opening a zenoh session, on this machine only or also over configured network endpoints."""

import errno
import json
import os
import sys
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

import zenoh

from dlokit.communication.timing.urgency import threads_urgent
from dlokit.communication.zenoh.access import HostRights, access_control
from dlokit.errors import MachineError

SHARED_FROM_BYTES = 2**16
LINK_LEASE_MS = 5000
"""A link between hosts that is silent for this long is closed; zenoh sends four keep-alive messages in this time."""
RETRY_FIRST_MS = 500
RETRY_LONGEST_MS = 2000
"""Shortest and longest wait before a closed link between hosts is opened again [ms]."""

LOCAL_RETRY_FIRST_MS = 20
LOCAL_RETRY_LONGEST_MS = 200
"""The same on one machine [ms]; at the start, the process at the other end may not listen yet."""


@dataclass(frozen=True, kw_only=True)
class TlsFiles:
    """Paths of the files with which hosts authenticate each other (mutual TLS)."""

    authority: str
    """Certificate of the lab's authority; a host whose certificate it has not signed cannot connect."""
    certificate: str
    """Its common name is the host's name."""
    key: str


@dataclass(frozen=True, kw_only=True)
class Login:
    """User and password by which zenoh admits a peer; the password itself does not cross the link."""

    user: str
    password: str = field(repr=False)


@dataclass(frozen=True, kw_only=True)
class ZenohConfig:
    """How the processes of one run connect to each other."""

    namespace: str
    """Prefix of every key, which separates runs on the same network."""
    listen: tuple[str, ...] = ()
    """Endpoints to listen on: ``unixsock-stream/PATH`` on one machine, ``tls/ADDRESS:PORT`` between machines."""
    connect: tuple[str, ...] = ()
    """Endpoints to connect to, through which the processes of the run find each other."""
    role: Literal["peer", "client", "router"] = "peer"
    """On one machine, every process is a peer. Between hosts, each has a router, which forwards messages between the
    host's own processes (its clients) and the routers of other hosts."""
    discovers_peers: bool = True
    """Whether a peer also connects to peers that others report to it (zenoh's gossip). zenoh reopens a closed link,
    e.g. to a process that hung, only where its endpoint is in `connect`."""
    connect_within_s: float | None = None
    """Opening fails if no connection is made within this time; None: it retries in the background without limit."""
    login: Login | None = None
    """Presented to the peers that this session connects to."""
    accepts: tuple[Login, ...] = ()
    """Logins of the peers that may connect to this session; empty: all that reach an endpoint."""
    tls: TlsFiles | None = None
    """For endpoints `tls/…`: both ends authenticate."""
    others: tuple[HostRights, ...] | None = None
    """Rights of other hosts; None: no access control, e.g. where no other host can connect."""


_TAKEN = (os.strerror(errno.EADDRINUSE), "Unable to acquire lock: EAGAIN")
"""zenoh's error when another process listens at an endpoint: it has locked the file beside its socket."""

OpenSession = Callable[[ZenohConfig], zenoh.Session]
"""Opens a session as configured; a study may replace it to inject faults."""


def open_session(config: ZenohConfig) -> zenoh.Session:
    """Open a session. Raises `MachineError` when an endpoint cannot be used."""
    settings = zenoh.Config()
    try:
        with _logins(config) as logins:
            for key, value in (_settings(config) | logins).items():
                settings.insert_json5(key, json.dumps(value))
            # Heartbeats and brake commands pass through zenoh's threads, which only move bytes.
            with threads_urgent():
                return zenoh.open(settings)
    except zenoh.ZError as error:
        check_shared_memory()  # it names the cause
        taken = any(sign in str(error) for sign in _TAKEN)
        raise MachineError(
            f"the bus cannot listen on {config.listen} or reach {config.connect}: {error}"
            f"{'; stop the process that listens there, or configure another endpoint' if taken else ''}"
        ) from error


@contextmanager
def _logins(config: ZenohConfig) -> Generator[dict[str, object]]:
    """The settings of zenoh's authentication; it reads the accepted logins from a file while a session is opened."""
    settings: dict[str, object] = {}
    if config.login is not None:
        settings |= {"transport/auth/usrpwd/user": config.login.user}
        settings |= {"transport/auth/usrpwd/password": config.login.password}
    if not config.accepts:
        yield settings
        return
    with tempfile.NamedTemporaryFile("w", encoding="utf-8") as file:  # only its owner may read it
        file.writelines(f"{login.user}:{login.password}\n" for login in config.accepts)
        file.flush()
        yield settings | {"transport/auth/usrpwd/dictionary_file": file.name}


def _settings(config: ZenohConfig) -> dict[str, object]:
    settings: dict[str, object] = {
        "mode": config.role,
        "namespace": config.namespace,
        "listen/endpoints": list(config.listen),
        "connect/endpoints": list(config.connect),
        # Do not wait for peers at the start: liveliness tokens show which are present.
        "connect/timeout_ms": -1 if config.connect_within_s is None else round(config.connect_within_s * 1000),
        "connect/exit_on_failure": config.connect_within_s is not None,
        "scouting/delay": 0,
        # Discovery would open a socket on all interfaces for the answers; the endpoints are known.
        "scouting/multicast/enabled": False,
        # A cloud is faster through the socket, an image through shared memory.
        "transport/shared_memory/transport_optimization/message_size_threshold": SHARED_FROM_BYTES,
        # A reader that hangs may block a writer for this long [µs], then its link is closed.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,
    }
    if config.role == "peer":
        settings["connect/retry"] = _retry(LOCAL_RETRY_FIRST_MS, LOCAL_RETRY_LONGEST_MS)
    else:
        settings["connect/retry"] = _retry(RETRY_FIRST_MS, RETRY_LONGEST_MS)
        settings["transport/link/tx/lease"] = LINK_LEASE_MS
    if not config.discovers_peers:
        settings["scouting/gossip/autoconnect"] = {"router": [], "peer": [], "client": []}
    if config.tls is not None:
        settings |= _tls_settings(config.tls)
    if config.others is not None:
        settings["access_control"] = access_control(config.namespace, config.others)
    return settings


def _retry(first_ms: int, longest_ms: int) -> dict[str, int]:
    return {"period_init_ms": first_ms, "period_max_ms": longest_ms, "period_increase_factor": 2}


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


def check_shared_memory(folder: str = "/dev/shm") -> None:
    """Raise `MachineError` with the cause when shared memory is not available, e.g. in a read-only container."""
    if not sys.platform.startswith("linux"):  # other systems have it without a folder
        return
    try:
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            file.write(bytes(4096))  # an empty file fits on a full disk
    except OSError as error:
        raise MachineError(
            f"{folder} cannot be written ({error.strerror}), and several processes need it: mount a tmpfs "
            "there (docker run --shm-size 256m). `dlokit shape` in lockstep runs without it."
        ) from error
