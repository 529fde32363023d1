"""Programs of a tiny run on several hosts: the main host, the arm's, an observing desk, and strangers.

Each prints its observations as lines; the main host and the desk execute commands from standard input.
"""

import asyncio
import json
import logging
import sys
import time
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import zenoh
from tiny_process import ECHO, Echo, TinyCell

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.port import Compute
from dlokit.communication.timing.deadlines import ThreadWatchdog
from dlokit.communication.transport import Transport
from dlokit.communication.zenoh.session import Login, TlsFiles, ZenohConfig, open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.errors import MachineError, ProcessFailure, SkillFailure
from dlokit.extras.hosts.agent import serve_host
from dlokit.extras.hosts.config import HostsConfig
from dlokit.extras.hosts.live import spread_system
from dlokit.extras.hosts.routers import NAMESPACE, OTHER_HOST, host_router_config
from dlokit.recording.disk import Disk
from dlokit.skills.robot import api
from dlokit.skills.robot.config import RobotConfig
from dlokit.skills.robot.lease import RobotLease
from dlokit.system.live import leases_held
from dlokit.system.live_system import LiveSystem
from dlokit.system.processes.bus import JoinedBus, SystemTransport
from dlokit.system.processes.child import run_child
from dlokit.system.processes.child_process import ChildSpec
from dlokit.system.processes.sockets import local_bus
from dlokit.system.processes.supervisor import Launch
from dlokit.system.table import AGAIN, ProcessRow, TimeBase
from dlokit.types.robot import MotionResult, RobotMode, RobotState
from dlokit.types.system import Heartbeat

MAIN, ARM, EYE, DESK = "main", "arm", "eye", "desk"
OWN = ProcessRow(name="decision", components=())
CELL = ProcessRow(name="cell", components=("cell",), time_base=TimeBase.MACHINE)
ROBOT = ProcessRow(name="robot", components=("robot",), after=("cell",))
OBSERVER = ProcessRow(name="observer", components=("echo",), restart=AGAIN)
STATE_PERIOD_S = 0.02
WAIT_S = 60.0
LOOKS = 20
LOOK_EVERY_S = 0.1


def hosts_of(endpoint: str, certificates: str) -> HostsConfig:
    runs = {MAIN: ("decision", "cell"), ARM: ("robot",), EYE: ("observer",), DESK: ()}
    return HostsConfig(endpoint=endpoint, certificates=certificates, runs=runs, wait_s=60.0)


def say(text: str) -> None:
    print(text, flush=True)


class TinyRobot(Component):
    """An arm reduced to its lease, its state, and a motion that continues until it is braked."""

    name = "robot"
    publishes = (topics.ROBOT_STATE,)
    reads = (topics.HEARTBEAT,)

    def __init__(self) -> None:
        super().__init__()
        self._lease = RobotLease(time.monotonic_ns)
        self._watch = ThreadWatchdog()
        self._braked = asyncio.Event()

    async def run(self) -> None:
        self.port.tap(topics.HEARTBEAT, self._hear)
        pose = geometry.pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        zeros = np.zeros(7)
        try:
            while True:
                self.port.publish(
                    topics.ROBOT_STATE,
                    RobotState(
                        stamp_ns=self.port.clock.now_ns(),
                        robot="first",
                        q_rad=zeros,
                        dq_rad_s=zeros,
                        tau_nm=zeros,
                        T_world_tcp=pose,
                        finger_width_m=0.0,
                        mode=RobotMode.IDLE,
                    ),
                )
                await asyncio.sleep(STATE_PERIOD_S)  # also without the cell's clock, when its host is disconnected
        finally:
            self._watch.close()

    def _hear(self, heartbeat: Heartbeat) -> None:
        self._lease.hear(heartbeat.holder)
        if heartbeat.holder.startswith("signed"):
            logging.info("heartbeat %s", heartbeat.holder)

    @implements(api.RENEW_LEASE)
    async def renew_lease(self, holder: str, duration_s: float = 0.2) -> None:
        self._lease.renew(holder, duration_s)
        loop = asyncio.get_running_loop()

        def ran_out() -> None:
            loop.call_soon_threadsafe(self._brake)

        self._watch.begin(self._lease, ran_out)

    def _brake(self) -> None:
        if not self._braked.is_set():
            self._braked.set()
            logging.info("braked")

    @implements(api.RELEASE_LEASE)
    async def release_lease(self, holder: str) -> None:
        self._lease.release(holder)

    @implements(api.HOME)
    async def home(self) -> MotionResult:
        logging.info("moving")
        await self._braked.wait()
        raise SkillFailure(api.LEASE.reason, "braked on the way")

    @implements(api.STOP)
    async def stop(self) -> None:
        pass


KINDS = {"cell": TinyCell, "robot": TinyRobot, "echo": Echo}


def tiny_components(spec: ChildSpec, bus: JoinedBus, compute: Compute) -> Container:
    host = Container(bus.transport, bus.clock, compute)
    for name in spec.components:
        host.add(KINDS[name]())
    return host


def launch_in(folder: Path) -> Launch:
    command = (sys.executable, __file__, "child")
    return Launch(namespace=NAMESPACE, config_file=folder / "config.toml", run_dir=folder, command=command)


async def obey(orders: dict[str, Callable[[], Awaitable[object]]]) -> None:
    """Execute the commands on standard input, one word per line, concurrently; end at its end."""
    tasks: list[asyncio.Task[None]] = []

    async def do(word: str) -> None:
        done = await orders[word]()
        say(f"{word}: {done if isinstance(done, str) else repr(done)}")

    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    while line := (await reader.readline()).decode().strip():
        tasks.append(asyncio.create_task(do(line)))
    await asyncio.gather(*tasks)


async def new_states(transport: Transport) -> str:
    """Wait for states that the arm published after this call."""
    states = transport.stream(topics.ROBOT_STATE)
    for _ in range(3):
        await anext(states)
    return "flow"


def orders_for(transport: SystemTransport, who: str) -> dict[str, Callable[[], Awaitable[object]]]:
    async def claim() -> str:
        transport.publish(topics.HEARTBEAT, Heartbeat(stamp_ns=1, holder=f"signed {who}"))
        return "published"

    async def echo() -> object:
        await transport.wait_for("echo", WAIT_S)
        return await transport.call(ECHO, "here")

    return {
        "echo": echo,
        "home": lambda: transport.call(api.HOME),
        "stop": lambda: transport.call(api.STOP),
        "states": lambda: new_states(transport),
        "claim": claim,
    }


async def main_host(hosts: HostsConfig, folder: Path) -> None:
    async with (
        spread_system((OWN, CELL, ROBOT, OBSERVER), launch_in(folder), hosts, "", say, None, Disk()) as live,
        leases_held(live.transport, live.clock, RobotConfig()),
    ):
        say("ready")
        await live.run(obeyed(live), lambda result, failure: None)


async def obeyed(live: LiveSystem) -> None:
    await obey(orders_for(live.transport, MAIN))


async def other_host(name: str, hosts: HostsConfig, folder: Path) -> None:
    rows = {row.name: row for row in (CELL, ROBOT, OBSERVER)}
    door = partial(host_router_config, hosts, name, MAIN)
    await serve_host(name, door, lambda _: (launch_in(folder), rows), say)


async def desk_host(hosts: HostsConfig, folder: Path) -> None:
    with local_bus(NAMESPACE) as local:
        transport = ZenohTransport(host_router_config(hosts, DESK, MAIN, local))
        assert await transport.wait_for("robot", 60.0)
        say("ready")
        await obey(orders_for(transport, DESK))
        await transport.close()


def look_in(endpoint: str, files: Sequence[str], within_s: float, login: str = OTHER_HOST) -> dict[str, int] | str:
    """What a client without dlokit sees of the bus: number of answers to each query, if it can connect."""
    tls = TlsFiles(authority=files[0], certificate=files[1], key=files[2]) if files else None
    config = ZenohConfig(
        namespace=NAMESPACE,
        role="router",
        connect=(endpoint,),
        login=Login(user=login, password="its certificate"),
        tls=tls,
        connect_within_s=within_s,
    )
    try:
        session = open_session(config)
    except MachineError:
        return "refused"
    seen: dict[str, int] = {}
    for _ in range(LOOKS):  # a new client receives the declarations gradually
        for key in ("last/**", "call/robot/*", "call/**", "**"):
            replies = session.get(key, timeout=3.0, target=zenoh.QueryTarget.ALL)
            seen[key] = sum(reply.ok is not None for reply in replies)
        if seen["last/**"]:
            break
        time.sleep(LOOK_EVERY_S)
    session.close()
    return seen


if __name__ == "__main__":
    if sys.argv[1] == "child":
        run_child(tiny_components)
    elif sys.argv[1] == "look":
        say(json.dumps([look_in(**attempt) for attempt in json.loads(sys.argv[2])]))
    else:
        logging.basicConfig(level=logging.WARNING)
        program = {
            MAIN: main_host,
            ARM: partial(other_host, ARM),
            EYE: partial(other_host, EYE),
            DESK: desk_host,
        }[sys.argv[1]]
        try:
            asyncio.run(program(hosts_of(sys.argv[2], sys.argv[3]), Path(sys.argv[4])))
        except ProcessFailure as failure:
            say(f"ended by {failure.reason}")
