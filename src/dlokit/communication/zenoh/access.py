"""What other hosts may do on this host's bus, as zenoh's own access control enforces it.

A host is known by the common name of its certificate, on the link that it connects through; whoever matches nobody may
do nothing. Processes of this host come in over the loopback interface, which is no link of TLS, and may do everything.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

OWN = "own processes"
READABLE = ("alive", "caller", "reader", "writer")
"""Kinds of liveliness tokens: that somebody is there is no secret among hosts that know one another."""


@dataclass(frozen=True, kw_only=True)
class HostRights:
    """What one other host may do; every host may read every topic."""

    host: str
    """Common name of its certificate."""
    trusted: bool = False
    """Whether it may do everything: the host that others meet at, which has looked at what it passes on."""
    publishes: tuple[str, ...] = ()
    """Names of topics."""
    serves: tuple[str, ...] = ()
    """Components that answer calls there."""
    calls: tuple[str, ...] = ()
    """``component/skill`` or ``component/*``."""


def access_control(namespace: str, hosts: Sequence[HostRights]) -> dict[str, Any]:
    """The part `access_control` of a zenoh configuration: what is not allowed is denied.

    zenoh allows a key expression that an allowed one includes: a query of ``**`` is none.
    """
    rules = [_rule(f"{OWN}/{flow}", flow, _EVERY_MESSAGE, ["**"]) for flow in ("ingress", "egress")]
    policies = [{"rules": [rule["id"] for rule in rules], "subjects": [OWN]}]
    for host in hosts:
        own = _everything(host.host, namespace) if host.trusted else _rules_of(host, namespace)
        rules += own
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [host.host]})
    subjects: list[dict[str, Any]] = [{"id": OWN, "link_protocols": ["tcp"]}]
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


def _everything(host: str, namespace: str) -> list[dict[str, Any]]:
    return [_rule(f"{host}/{flow}", flow, _EVERY_MESSAGE, [f"{namespace}/**"]) for flow in ("ingress", "egress")]


def _rules_of(host: HostRights, namespace: str) -> list[dict[str, Any]]:
    """What comes from it is looked at message by message; what goes to it was asked for by what came."""
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
