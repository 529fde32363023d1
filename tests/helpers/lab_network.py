"""A network of simulated machines: one network namespace each, on a separate bridge (Linux, as root)."""

import os
import shutil
import subprocess
from collections.abc import Generator
from contextlib import contextmanager


def why_not() -> str:
    """Why such a network is not possible here; empty if it is."""
    if shutil.which("ip") is None or os.geteuid() != 0:
        return "network namespaces need iproute2 and root"
    name = f"dlk{os.getpid()}-try"
    if subprocess.run(("ip", "netns", "add", name), capture_output=True).returncode != 0:
        return "this kernel or container allows no network namespaces"
    subprocess.run(("ip", "netns", "del", name), check=True)
    return ""


class LabNetwork:
    """Machines by name, with addresses from 10.77.0.1 in the order of their names."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._prefix = f"dlk{os.getpid()}-"
        self._names = names

    def address(self, name: str) -> str:
        return f"10.77.0.{self._names.index(name) + 1}"

    def inside(self, name: str, *command: str) -> tuple[str, ...]:
        """The command that runs `command` on that machine."""
        return ("ip", "netns", "exec", self._prefix + name, *command)

    def cut(self, name: str) -> None:
        """Disconnect its cable."""
        self._switch("link", "set", name, "down")

    def heal(self, name: str) -> None:
        self._switch("link", "set", name, "up")

    def build(self) -> None:
        _ip("netns", "add", f"{self._prefix}switch")
        self._switch("link", "add", "bridge", "type", "bridge")
        self._switch("link", "set", "bridge", "up")
        for name in self._names:
            here = self._prefix + name
            _ip("netns", "add", here)
            _ip("-n", here, "link", "set", "lo", "up")
            _ip("link", "add", "cable", "netns", here, "type", "veth", "peer", name, "netns", f"{self._prefix}switch")
            _ip("-n", here, "addr", "add", f"{self.address(name)}/24", "dev", "cable")
            _ip("-n", here, "link", "set", "cable", "up")
            self._switch("link", "set", name, "master", "bridge")
            self._switch("link", "set", name, "up")

    def remove(self) -> None:
        for name in (*self._names, "switch"):
            subprocess.run(("ip", "netns", "del", self._prefix + name), capture_output=True)

    def _switch(self, *arguments: str) -> None:
        _ip("-n", f"{self._prefix}switch", *arguments)


@contextmanager
def lab_network(*names: str) -> Generator[LabNetwork]:
    """Provide machines within the context, and remove them at its end."""
    network = LabNetwork(names)
    try:
        network.build()
        yield network
    finally:
        network.remove()


def _ip(*arguments: str) -> None:
    subprocess.run(("ip", *arguments), check=True, capture_output=True)
