"""Nobody without the key of a run joins its bus: no other user, and no other program of the same user."""

import asyncio
import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from live_arm import arm_and_cell

from dlokit.benches.faults import forging_peer
from dlokit.communication import topics
from dlokit.description.arm.franka import PANDA
from dlokit.errors import InputError
from dlokit.skills.robot import api
from dlokit.skills.robot.config import RobotConfig
from dlokit.system.config import RunConfig
from dlokit.system.live import LiveSystem
from dlokit.system.processes.lease_keeper import leases_held
from dlokit.system.processes.running import RunningSystem, the_running_system
from dlokit.types.outcome import Rejected, Succeeded

WAIT_S = 120.0  # both processes are up within 10 s of two idle cores
SHORT_LEASE_S = 0.3
PATIENT = RobotConfig(commander_lease_s=10.0, driver_lease_s=10.0)
"""A busy machine may hold a process up for longer than the usual leases."""
USERS = [
    pytest.param(os.getuid(), id="own user"),
    pytest.param(
        forging_peer.NOBODY,
        id="another user",
        marks=pytest.mark.skipif(os.geteuid() != 0, reason="only root may start a process of another user"),
    ),
]
SIDE_RAD = np.array(PANDA.home_q_rad) + np.array([1.0, *[0.0] * 6])


async def forged(live: LiveSystem, user: int) -> None:
    """Let a peer without the key forge the commander's heartbeats, leases and calls; it must be refused."""
    endpoints = live.bus.connect
    assert {Path(endpoint).name for endpoint in endpoints} == {"bus", "cell", "robot"}
    command = forging_peer.command(user, live.bus.namespace, live.transport.identity, endpoints)
    peer = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
    said, _ = await peer.communicate()
    assert json.loads(said) == forging_peer.REFUSED


def assert_named_in_the_logs(folder: Path, user: int) -> None:
    logs = [(folder / "logs" / f"{name}.log").read_text() for name in ("cell", "robot")]
    # The kernel refuses another user at the folder, and the processes never hear of it.
    assert all(("refused on the bus: a peer without the key" in log) == (user == os.getuid()) for log in logs)


@pytest.mark.parametrize("user", USERS)
def test_a_forging_peer_without_the_key_is_refused_and_the_task_is_unharmed(tmp_path: Path, user: int) -> None:
    async def body() -> None:
        async with (
            asyncio.timeout(WAIT_S),
            arm_and_cell(tmp_path, RunConfig(runtime="live", robot=PATIENT)) as live,
            leases_held(live.transport, live.clock, PATIENT),
        ):
            await anext(live.transport.stream(topics.ROBOT_STATE))
            forging = asyncio.create_task(forged(live, user))
            outcomes = list[object]()
            while not forging.done():
                outcomes.append(await live.transport.call(api.MOVE_JOINTS, SIDE_RAD))
                outcomes.append(await live.transport.call(api.HOME))
            await forging
            assert outcomes
            assert all(isinstance(outcome, Succeeded) for outcome in outcomes), outcomes

    asyncio.run(body())
    assert_named_in_the_logs(tmp_path, user)


@pytest.mark.parametrize("user", USERS)
def test_forged_heartbeats_do_not_keep_the_lease_of_a_lost_commander(tmp_path: Path, user: int) -> None:
    async def body() -> None:
        async with asyncio.timeout(WAIT_S), arm_and_cell(tmp_path) as live:
            taken = await live.transport.call(api.RENEW_LEASE, live.transport.identity, SHORT_LEASE_S)
            assert isinstance(taken, Succeeded)
            await forged(live, user)  # for longer than the lease; the commander itself is silent
            refused = await live.transport.call(api.HOME)
            assert isinstance(refused, Rejected)
            assert refused.reason == "lease_lost"

    asyncio.run(body())
    assert_named_in_the_logs(tmp_path, user)


def ready(folder: Path, run: "subprocess.Popen[bytes]") -> RunningSystem:
    end_s = time.monotonic() + WAIT_S
    while time.monotonic() < end_s:
        assert run.poll() is None
        with contextlib.suppress(InputError):
            return the_running_system(folder)
        time.sleep(0.05)
    raise AssertionError("the run did not start")


def test_a_live_run_opens_only_the_viewers_port_and_shows_its_key_nowhere(tmp_path: Path) -> None:
    command = (str(Path(sys.executable).with_name("dlokit")), "shape", "--runtime", "live", "--out", str(tmp_path))
    with subprocess.Popen((*command, "--port", "0"), stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as run:
        try:
            system = ready(tmp_path, run)
            processes = [psutil.Process(run.pid), *psutil.Process(run.pid).children(recursive=True)]
            listening = {
                connection.laddr.port: process.cmdline()[-1]
                for process in processes
                for connection in process.net_connections(kind="inet")
                if connection.status == psutil.CONN_LISTEN
            }
            assert list(listening.values()) == ["viewer"]
            for process in processes:
                shown = itertools.chain(process.cmdline(), process.environ().values())
                assert not any(system.key in text for text in shown)
        finally:
            run.send_signal(signal.SIGINT)
            output, _ = run.communicate(timeout=WAIT_S)
    written = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()]
    assert any(b"\x89MCAP" in data for data in written)
    assert not any(system.key.encode() in data for data in (*written, output))
    assert not Path(system.endpoint.removeprefix("unixsock-stream/")).parent.exists()
