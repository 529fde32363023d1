"""The bus of a run on several hosts: each host has one door, and its processes go through it.

The main host's door is the only one that listens to the network. Processes of a host reach their door over the loopback
interface, and open no port.
"""

from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.system.certificates import host_files
from dlokit.system.hosts_config import HostsConfig, kind_of
from dlokit.system.placement import Placement, placed, rights_at_main, rights_elsewhere
from dlokit.system.processes import ProcessRow

NAMESPACE = "dlokit/hosts"
"""Of all runs on several hosts: at one endpoint there is one at a time."""


def check_hosts(hosts: HostsConfig, rows: tuple[ProcessRow, ...]) -> None:
    """Raise `ConfigError` for what is placed wrongly, or for a certificate of the main host that is missing."""
    placement = placed(hosts, rows)
    if kind_of(hosts.endpoint) == "tls":
        host_files(hosts.folder, placement.main)


def main_door(hosts: HostsConfig, placement: Placement, meeting_point: str) -> ZenohConfig:
    """The door at which the other hosts' doors connect. Raises `ConfigError` when a certificate is missing."""
    secured = kind_of(hosts.endpoint) == "tls"
    return ZenohConfig(
        namespace=NAMESPACE,
        role="router",
        listen=(meeting_point, hosts.endpoint),
        tls=host_files(hosts.folder, placement.main) if secured else None,
        others=rights_at_main(placement) if secured else None,
    )


def other_door(hosts: HostsConfig, name: str, main: str, meeting_point: str) -> ZenohConfig:
    """The door of the host `name`, which connects to the one of the host `main`. Raises `ConfigError`."""
    secured = kind_of(hosts.endpoint) == "tls"
    return ZenohConfig(
        namespace=NAMESPACE,
        role="router",
        listen=(meeting_point,),
        connect=(hosts.endpoint,),
        tls=host_files(hosts.folder, name) if secured else None,
        others=rights_elsewhere(main) if secured else None,
    )


def through_door(meeting_point: str) -> ZenohConfig:
    """How a process of a host joins the bus."""
    return ZenohConfig(namespace=NAMESPACE, role="client", listen=(), connect=(meeting_point,))
