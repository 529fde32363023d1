"""The agent of a host: it answers the main host, runs processes on request, and waits for the next run."""

import asyncio
from collections.abc import AsyncGenerator, Mapping
from contextlib import asynccontextmanager
from pathlib import Path

from buses import MemoryBuses

from dlokit import __version__
from dlokit.communication.timing import virtual_time
from dlokit.communication.transport import Transport
from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.errors import InputError
from dlokit.extras.hosts.agent import Prepare, host_served
from dlokit.extras.hosts.api import HELLO, RUN_SHARE, ShareReady
from dlokit.system.processes.running import running_systems
from dlokit.system.processes.sockets import LocalBus
from dlokit.system.processes.supervisor import Launch
from dlokit.system.table import ROBOT, ProcessRow, TimeBase
from dlokit.types.outcome import Rejected, Succeeded

ROUTER = ZenohConfig(namespace="hosts", connect=("tls/192.0.2.1:7447",))


def door(local: LocalBus) -> ZenohConfig:
    return ROUTER


@asynccontextmanager
async def host(prepare: Prepare, said: list[str]) -> AsyncGenerator[Transport]:
    """The bus as the main host sees it."""
    buses = MemoryBuses()
    async with host_served("arm", door, prepare, said.append, buses.join), buses.join(ROUTER, TimeBase.MACHINE) as bus:
        yield bus.transport


def refuses(config_toml: str) -> tuple[Launch, Mapping[str, ProcessRow]]:
    raise InputError(f"no strategy in {config_toml}")


def test_it_says_hello_with_its_version() -> None:
    async def body() -> None:
        async with host(refuses, []) as bus:
            hello = await bus.call(HELLO.at("arm"))
        assert isinstance(hello, Succeeded)
        assert hello.result.version == __version__

    virtual_time.run(body())


def test_a_configuration_that_is_not_valid_here_and_an_unknown_process_are_refused(tmp_path: Path) -> None:
    def prepare(config_toml: str) -> tuple[Launch, Mapping[str, ProcessRow]]:
        return Launch(namespace="lamp", config_file=tmp_path / "config.toml", run_dir=tmp_path), {"robot": ROBOT}

    async def body() -> None:
        for prepared, names, why in ((refuses, (), "no strategy in x = 1"), (prepare, ("lamp",), "'lamp'")):
            said = list[str]()
            async with host(prepared, said) as bus:
                outcome = await bus.call(RUN_SHARE.at("arm"), "x = 1", names)
            assert isinstance(outcome, Rejected)
            assert (outcome.reason, outcome.detail) == ("bad_configuration", why)
            assert said == [f"a run is rejected: {why}"]

    virtual_time.run(body())


def test_a_run_is_announced_on_this_machine_until_the_main_host_ends_it_and_the_next_one_may_come(
    tmp_path: Path,
) -> None:
    def prepare(config_toml: str) -> tuple[Launch, Mapping[str, ProcessRow]]:
        return Launch(namespace="lamp", config_file=tmp_path / "config.toml", run_dir=tmp_path), {}

    async def body() -> None:
        said = list[str]()
        async with host(prepare, said) as bus:
            for _ in range(2):
                ready = asyncio.Queue[ShareReady]()
                running = asyncio.create_task(bus.call_reported(RUN_SHARE.at("arm"), ready.put_nowait, "", ()))
                assert (await ready.get()).host == "arm"
                (system,) = running_systems(starting=True)
                assert system.folder == str(tmp_path)
                assert system.client  # other processes reach it through the router
                running.cancel()
                await asyncio.wait({running})
                assert running_systems(starting=True) == []
                assert said.pop() == "the processes have ended; waiting for the next run"

    virtual_time.run(body())
