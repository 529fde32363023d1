"""The rights of other hosts on this host's bus, as rules for zenoh's access control.

A host is identified by the common name of its certificate; a link that matches no host may do nothing. Processes of
this host connect over a socket with the key of the run, and may do everything.
"""

import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import zenoh

from dlokit.communication.log_rate import LogRate

OWN = "own processes"
OWN_USER = "dlokit"
"""User name with which the processes of a host log in to each other."""
READABLE = ("alive", "caller", "reader", "writer")
"""Kinds of liveliness tokens, which every known host may read."""


@dataclass(frozen=True, kw_only=True)
class HostRights:
    """The rights of one other host; in addition, every host may read every topic."""

    host: str
    """Common name of its certificate."""
    trusted: bool = False
    """Whether it may do everything: the main host, which enforces the rights of those whose messages it forwards."""
    publishes: tuple[str, ...] = ()
    """Names of topics that it may publish."""
    serves: tuple[str, ...] = ()
    """Components that may answer calls on it."""
    calls: tuple[str, ...] = ()
    """Skills that it may call, as ``component/skill``."""


def access_control(namespace: str, hosts: Sequence[HostRights]) -> dict[str, Any]:
    """The section `access_control` of a zenoh configuration; everything that no rule allows is denied.

    zenoh allows a key expression only if a rule's expression includes it; hence a query of ``**`` is denied.
    """
    rules = _everything(OWN, "**")
    policies = [{"rules": [rule["id"] for rule in rules], "subjects": [OWN]}]
    for host in hosts:
        own = _everything(host.host, f"{namespace}/**") if host.trusted else _rules_of(host, namespace)
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [host.host]})
    subjects: list[dict[str, Any]] = [{"id": OWN, "link_protocols": ["unixsock-stream"], "usernames": [OWN_USER]}]
    subjects += [{"id": host.host, "link_protocols": ["tls"], "cert_common_names": [host.host]} for host in hosts]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


_EVERY_MESSAGE = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


def _everything(name: str, keys: str) -> list[dict[str, Any]]:
    return [_rule(f"{name}/{flow}", flow, _EVERY_MESSAGE, [keys]) for flow in ("ingress", "egress")]


def _rules_of(host: HostRights, namespace: str) -> list[dict[str, Any]]:
    """Rules for each kind of incoming message; all outgoing messages are allowed, since the host requested them."""
    topics, serves = host.publishes, host.serves
    called = dict.fromkeys(call.partition("/")[0] for call in host.calls)
    answered = [*(f"call/{each}/*" for each in serves), *(f"last/{each}" for each in topics)]
    allowed: dict[tuple[str, ...], list[str]] = {
        ("put",): [*(f"topic/{each}" for each in topics), *(f"cancel/{each}" for each in called)],
        ("query",): ["last/**", *(f"call/{each}" for each in host.calls)],
        ("reply", "declare_queryable"): answered,
        ("declare_subscriber",): ["topic/**", *(f"cancel/{each}" for each in serves)],
        ("liveliness_token",): [
            "caller/*",
            "reader/**",
            *(f"writer/{each}/*/*" for each in topics),
            *(f"alive/{each}/*" for each in serves),
        ],
        ("liveliness_query", "declare_liveliness_subscriber"): [f"{kind}/**" for kind in READABLE],
    }
    rules = [
        _rule(f"{host.host}/{messages[0]}", "ingress", messages, [f"{namespace}/{key}" for key in keys])
        for messages, keys in allowed.items()
        if keys
    ]
    return [*rules, _rule(f"{host.host}/egress", "egress", _EVERY_MESSAGE, [f"{namespace}/**"])]


def _rule(name: str, flow: str, messages: Sequence[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "flows": [flow], "messages": list(messages), "permission": "allow", "key_exprs": keys}


log = logging.getLogger(__name__)

_ACCEPT = "zenoh_transport::unicast::establishment::accept"
_REFUSAL = b"UsrPwd extension"
"""Text by which zenoh reports a peer with a missing or wrong login, and no other peer."""


class RefusalLog:
    """Logs refusals: the first at once, later ones with their number, at the rate of `LogRate`."""

    def __init__(self, monotonic_s: Callable[[], float] = time.monotonic) -> None:
        self._rate = LogRate(monotonic_s)

    def take(self, line: bytes) -> bool:
        """Process one line; returns whether it belongs to zenoh's log."""
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
