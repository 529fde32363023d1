"""A live system is visible neither on the network nor to another system on the same machine."""

import asyncio
import ipaddress
from contextlib import AsyncExitStack
from pathlib import Path

import psutil
import pytest
from tiny_process import ECHO
from tiny_system import echo_row, tiny_system

from dlokit.communication import topics
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.system.live import LiveSystem
from dlokit.types.flow import Command, OperatorCommand
from dlokit.types.outcome import Succeeded

pytestmark = pytest.mark.live

WAIT_S = 60.0  # starting a process takes a second; many on a loaded machine take more


def addresses_open(pid: int) -> list[str]:
    """Addresses on which a process listens, without those of established connections."""
    connections = psutil.Process(pid).net_connections(kind="inet")
    return [each.laddr.ip for each in connections if not each.raddr]


def test_a_live_system_listens_on_the_loopback_interface_only(tmp_path: Path) -> None:
    async def main() -> None:
        async with asyncio.timeout(WAIT_S), tiny_system(tmp_path, echo_row()) as system:
            opened = [addresses_open(pid) for pid in (psutil.Process().pid, *system.supervisor.pids.values())]
            assert opened[0], "this process is where the others meet: it listens"
            for address in (address for each in opened for address in each):
                assert ipaddress.ip_address(address).is_loopback

    asyncio.run(main())


def test_a_default_transport_opens_no_port_to_the_network() -> None:
    async def main() -> None:
        before = addresses_open(psutil.Process().pid)
        transport = ZenohTransport(ZenohConfig(namespace="dlokit_test_sockets"))
        opened = addresses_open(psutil.Process().pid)
        await transport.close()
        assert len(opened) > len(before)
        assert all(ipaddress.ip_address(address).is_loopback for address in opened)

    asyncio.run(main())


def test_two_systems_of_one_machine_do_not_see_each_other(tmp_path: Path) -> None:
    async def main() -> None:
        async with asyncio.timeout(2 * WAIT_S), AsyncExitStack() as stack:
            one = await stack.enter_async_context(tiny_system(tmp_path / "one", echo_row()))
            other = await stack.enter_async_context(tiny_system(tmp_path / "other"))
            assert isinstance(await one.transport.call(ECHO, "here"), Succeeded)
            assert not other.transport.alive("echo").alive
            await nothing_crosses(one, other)

    asyncio.run(main())


async def nothing_crosses(one: LiveSystem, other: LiveSystem) -> None:
    """A command published in one system arrives in it, and not in the other."""
    heard = one.transport.stream(topics.COMMAND)
    assert other.transport.latest(topics.COMMAND).value is None
    one.transport.publish(topics.COMMAND, OperatorCommand(stamp_ns=1, seq=1, command=Command.PAUSE))
    assert (await anext(heard)).command is Command.PAUSE
    ticks = other.transport.stream(topics.CLOCK)
    for _ in range(10):  # the other system has had as much time to receive it
        await anext(ticks)
    assert other.transport.latest(topics.COMMAND).value is None
