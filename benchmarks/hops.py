"""How many of our functions stand on the way of a look, of a skill call between processes, and of a motion.

    python benchmarks/hops.py
    python benchmarks/hops.py --json hops.json

Three ways are traced with Python's own profiler, and every distinct function of dlokit on them is listed, in the order
of the first calls.

A look, in lockstep: from the moment in which the decision layer asks perception for it (`decision.looking.look`), over
pictures, segmentation, stereo, cloud, target points and model, until the convergence check (the box `compare`) has
judged the model's state. A skill call, over zenoh: from `port.call` of one component to its outcome, caller and called
one each with a host and a transport of its own, both in one process. A motion, live: from the decision layer's call of
`follow_path`, over the robot's component, its plan, its checks and its gate, to the arm of the simulated cell, and back
with the result; the three have a host and a transport each, all in one process. What live runs in a pool of processes
runs here where it is asked for, and these trips to the pool are counted.

What counts: a function once, however often it is called, by its module and its qualified name, where its file is one of
dlokit's. A compiled kernel counts where Python calls it; what it calls in turn is compiled into it. Comprehensions,
generator expressions and lambdas are listed, and not counted: they are part of the function that they stand in. What is
done once in a process (caches, imports, compilation) is over by then: each way is walked twice before it is traced. The
table under the rope is looked for in every 50th look alone, and not in the one that is traced.

What is on the way: in lockstep other components go on beside it, on the same loop and through the same functions. What
also runs when nobody looks can therefore not just be left out: the bus does both. Asyncio's tasks tell it instead. On
the way are the task that asks, in which perception and the cell answer as well, and the two that take the message on:
the observer's for clouds, and the model's for target points. During the look these handle nothing but what comes of it.
The cell's ticks, the arm's states, planning's own reading of the cloud, and the recorder's writing are other tasks' or
threads', and left out; what a publisher does for all of its readers, the recorder among them, is in. Over zenoh all
threads and all tasks are traced: nothing else runs there, which a time without a call shows before.

The counts are split into plumbing, which carries (dlokit's communication, system and recording), and the rest, which
looks and computes.

Of a motion everything is on the way that its call leads to: the tasks that are made for it, and what these wait for at
the called ends, which a context variable marks from end to end. The cell's ticks and the arm's states go on beside it.

Besides, the frames that lie between `dlokit shape` and the first step of its flow are listed: the functions of dlokit
on the stack in that step, and the coroutines that wait for it.
"""

import asyncio
import inspect
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, nullcontext, redirect_stdout, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, NoReturn

import numpy as np
import zenoh
from rich.console import Console
from rich.table import Table

import dlokit
from dlokit.app import main
from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.port import InlineCompute
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.transport import first_message
from dlokit.communication.zenoh.session import ZenohConfig, open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.decision.convergence import error_m
from dlokit.decision.flow import FaultKind, StepFault, run_flow
from dlokit.decision.looking import LOOK_INTERVAL_S, look
from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.decision.steps.goal import set_goal
from dlokit.decision.steps.perceive import compare, find_dlo
from dlokit.decision.task import Odometer, ShapeTask, Spent
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import without_interval
from dlokit.recording.disk import Disk
from dlokit.skills.robot import api as robot
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob, job_from_config
from dlokit.system.lockstep import LockstepSystem, lockstep_system
from dlokit.system.processes.sockets import local_bus
from dlokit.system.results.recording import lockstep_recorder
from dlokit.types.action import VelocityProfile
from dlokit.types.outcome import Outcome, Succeeded
from dlokit.types.pose import Pose
from parts.command import check_json, run_study, write_figures

OURS = str(Path(dlokit.__file__).parent) + "/"
PLUMBING = ("communication", "system", "recording")
UNTRACED = 2
"""Times that a way is gone before it is traced."""
FIRST_STATE_S = 0.1
"""After this long on the virtual clock, the arm has told where it is."""
IDLE_S, AFTERWARDS_S = 1.0, 1.0
"""Over zenoh: how long it is traced without a call; how long each end has, after an outcome, for what it does then."""
FOUND_WITHIN_S = 10.0
SQUARE_M = 0.05
"""Side of the square that the tool is moved around, with rounded corners."""


ON_WAY: ContextVar[bool] = ContextVar("ON_WAY", default=False)
"""Whether what runs in a context comes of the call that is traced."""


def _named(code: CodeType) -> str:
    module = code.co_filename.removeprefix(OURS).removesuffix(".py").replace("/", ".")
    return f"dlokit.{module}:{code.co_qualname}"


class Trace:
    """Every function of dlokit that is called while it is open, where it is on the way."""

    def __init__(self, on_way: Callable[[], bool] = lambda: True) -> None:
        """`on_way` is asked at each call, in the thread that makes it."""
        self._on_way = on_way
        self._open = False
        self._seen: dict[CodeType, str] = {}

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        """As the profiler calls it."""
        code = frame.f_code
        new = event == "call" and self._open and code not in self._seen and code.co_filename.startswith(OURS)
        if new and self._on_way():
            # Not by the frame's globals: a compiled kernel's has none.
            self._seen[code] = _named(code)

    @contextmanager
    def opened(self) -> Generator[None]:
        """Trace what this thread calls meanwhile, and what threads call that have this trace for their profiler."""
        self._open = True
        sys.setprofile(self)
        try:
            yield
        finally:
            whole = sys.getprofile() is self  # a profiler that raises is taken away
            sys.setprofile(None)
            self._open = False
        assert whole, "the trace ended before its time"

    @property
    def functions(self) -> list[str]:
        """In the order of their first calls."""
        return list(dict.fromkeys(self._seen.values()))


@dataclass(frozen=True)
class Way:
    """What was found on one way; `module:function` each, in the order of the first calls."""

    functions: list[str]
    uncounted: list[str]
    """Comprehensions, generator expressions, lambdas."""

    @property
    def plumbing(self) -> list[str]:
        """What carries."""
        return [name for name in self.functions if _package(name) in PLUMBING]

    @property
    def rest(self) -> list[str]:
        """What looks and computes."""
        return [name for name in self.functions if _package(name) not in PLUMBING]

    @property
    def by_package(self) -> Counter[str]:
        """How many count, by the folder under dlokit that they are in."""
        return Counter(_package(name) for name in self.functions)


def _package(function: str) -> str:
    return function.partition(":")[0].split(".")[1]


def way_of(functions: list[str]) -> Way:
    """What counts, and what does not."""
    return Way(
        functions=[name for name in functions if not name.endswith(">")],
        uncounted=[name for name in functions if name.endswith(">")],
    )


async def _begun(system: LockstepSystem, job: ShapeJob, config: RunConfig) -> ShapeTask:
    """A task of the decision layer that has found the DLO and set its goal, as far as looking goes."""
    port = system.decision.port
    task = ShapeTask(
        port=port,
        config=config.task,
        request=job.request,
        stopwatch=time.monotonic,
        states=port.stream(topics.STATE),
        commands=port.stream(topics.COMMAND),
        odometer=Odometer(),
        recorded=lambda record: None,
        spent=Spent(started_ns=port.clock.now_ns()),
    )
    await system.clock.sleep(FIRST_STATE_S)
    await find_dlo(task)
    await set_goal(task)
    return task


async def _look_and_compare(task: ShapeTask) -> None:
    """As the boxes of the flow do it: a look, the error, the convergence check."""
    task.state = await look(task)
    task.errors_m.append(error_m(task.shape.nodes_world, task.goal))
    await compare(task)


async def traced_look(config: RunConfig) -> Way:
    """Look in lockstep."""
    job = job_from_config(config)
    with (
        tempfile.TemporaryDirectory() as folder,
        lockstep_recorder(config, job.name, Path(folder), LoopClock(), Disk()) as tape,
    ):
        async with lockstep_system(config, job.start_nodes_world, Path(folder), tape) as system:
            task = await _begun(system, job, config)
            for _ in range(UNTRACED):
                await system.clock.sleep(LOOK_INTERVAL_S)
                await _look_and_compare(task)
            await system.clock.sleep(LOOK_INTERVAL_S)
            names = {f"observer on {topics.OBSERVATION.name}", f"model on {topics.TARGETS.name}"}
            handling = {each for each in asyncio.all_tasks() if each.get_name() in names}
            if len(handling) != len(names):
                raise SystemExit(f"the tasks {sorted(names)} are not all there; this benchmark must learn new names")
            tasks = {asyncio.current_task(), *handling}
            trace = Trace(lambda: asyncio.current_task() in tasks)
            with trace.opened():
                await _look_and_compare(task)
            return way_of(trace.functions)


def _half(number: float) -> float:
    """Half of a number."""
    ...


HALF = Skill("called", "half", _half, timeout_s=5.0)


class Called(Component):
    """Has one trivial skill."""

    name = "called"

    @implements(HALF)
    async def half(self, number: float) -> float:
        """Half of it."""
        return number / 2.0


class Caller(Component):
    """Calls it."""

    name = "caller"

    async def ask(self) -> Outcome[float]:
        """Over the bus, as every component does."""
        return await self.port.call(HALF, 5.0)


class TracedSession:
    """A zenoh session whose answers are traced: they come on zenoh's own threads, which Python's profiler passes by.

    What comes of a call is marked as on the way, at both ends.
    """

    def __init__(self, session: zenoh.Session, trace: Trace) -> None:
        self._session = session
        self._trace = trace

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def get(self, key: str, handler: Any, **how: Any) -> None:
        """A query; other callbacks than its own come on threads that Python started."""
        if isinstance(handler, zenoh.handlers.Callback):
            end = None if handler.drop is None else self._traced(handler.drop)
            handler = zenoh.handlers.Callback(self._traced(handler.callback), end, indirect=handler.indirect)
        self._session.get(key, handler, **how)

    def declare_queryable(self, key: str, handler: Callable[[zenoh.Query], None]) -> Any:
        """Of calls; their thread is Python's."""

        def call(query: zenoh.Query) -> None:
            ON_WAY.set(True)
            handler(query)

        return self._session.declare_queryable(key, call)

    def _traced(self, function: Callable[..., object]) -> Callable[..., None]:
        def call(*arguments: object) -> None:
            ON_WAY.set(True)
            sys.setprofile(self._trace)
            try:
                function(*arguments)
            finally:
                sys.setprofile(None)

        return call


async def traced_call() -> Way:
    """Call over zenoh."""
    trace = Trace()

    def session(config: ZenohConfig) -> Any:
        return TracedSession(open_session(config), trace)

    with local_bus("dlokit_hops") as bus:
        threading.setprofile(trace)
        here, there = (ZenohTransport(config, open_session=session) for config in (bus.first(), bus.guest))
        caller, called = Caller(), Called()
        calling, answering = Container(here, LoopClock()), Container(there, LoopClock())
        calling.add(caller)
        answering.add(called)
        try:
            async with calling, answering:
                if not await here.wait_for(called.name, FOUND_WITHIN_S):
                    raise SystemExit("the two ends did not find each other; end other programs, and try again")
                for _ in range(UNTRACED):
                    await _ask(caller)
                await asyncio.sleep(AFTERWARDS_S)
                with trace.opened():
                    await asyncio.sleep(IDLE_S)
                if trace.functions:
                    raise SystemExit(f"something runs without a call, and would be counted: {trace.functions}")
                with trace.opened():
                    await _ask(caller)
                    await asyncio.sleep(AFTERWARDS_S)
        finally:
            threading.setprofile(None)
            await here.close()
            await there.close()
    return way_of(trace.functions)


async def _ask(caller: Caller) -> None:
    outcome = await caller.ask()
    if not isinstance(outcome, Succeeded):
        raise SystemExit(f"the call did not succeed: {outcome}; end other programs, and try again")


class Counted(InlineCompute):
    """Computes in this process, and counts how often it is asked to."""

    trips = 0

    async def __call__(self, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        """One trip."""
        self.trips += 1
        return await super().__call__(function, *args, **kwargs)


class Commander(Component):
    """Asks for motions, as the decision layer does."""

    name = "decision"
    reads = (topics.ROBOT_STATE,)

    async def around(self, trace: Trace | None = None) -> None:
        """Around a square and back, level, from where the tool is; what the call leads to is on the way."""
        state = self.port.latest(topics.ROBOT_STATE).value
        assert state is not None, "the arm has told where it is"
        start = state.T_world_tcp
        path = tuple(
            Pose(position_m=start.position_m + SQUARE_M * np.array([x, y, 0.0]), wxyz=start.wxyz)
            for x, y in ((1, 0), (1, 1), (0, 1), (0, 0))
        )
        profile = VelocityProfile()
        with nullcontext() if trace is None else trace.opened():
            ON_WAY.set(trace is not None)
            outcome = await self.port.call(robot.FOLLOW_PATH, path, profile)
            await asyncio.sleep(AFTERWARDS_S)
        if not isinstance(outcome, Succeeded):
            raise SystemExit(f"the motion did not succeed: {outcome}; end other programs, and try again")


async def traced_motion(config: RunConfig) -> tuple[Way, int]:
    """Move the tool of the cell's arm live; the way, and how many trips to the pool are on it."""
    trace = Trace(ON_WAY.get)

    def session(config: ZenohConfig) -> Any:
        return TracedSession(open_session(config), trace)

    names, pool = ("cell", "robot"), Counted()
    start_nodes_world = job_from_config(config).start_nodes_world
    with local_bus("dlokit_hops") as bus, tempfile.TemporaryDirectory() as folder:
        threading.setprofile(trace)
        joining = (bus.first(), *(bus.process(name, names) for name in names))
        here, *ends = (ZenohTransport(each, open_session=session) for each in joining)
        commander, clock = Commander(), LoopClock()
        hosts = [Container(here, clock), *(Container(end, clock, pool) for end in ends)]
        hosts[0].add(commander)
        for name, end, host in zip(names, ends, hosts[1:], strict=True):
            wiring = Wiring(transport=end, clock=clock, folder=Path(folder), start_nodes_world=start_nodes_world)
            host.add(build_component(name, config, wiring))
        try:
            async with hosts[0], hosts[1], hosts[2]:
                for name in names:
                    if not await here.wait_for(name, FOUND_WITHIN_S):
                        raise SystemExit(f"{name} was not found; end other programs, and try again")
                if await first_message(here, topics.ROBOT_STATE, FOUND_WITHIN_S) is None:
                    raise SystemExit("no state of the arm arrived; end other programs, and try again")
                for _ in range(UNTRACED):
                    await commander.around()
                trips = pool.trips
                await asyncio.create_task(commander.around(trace))
                trips = pool.trips - trips
        finally:
            threading.setprofile(None)
            for transport in (here, *ends):
                await transport.close()
    return way_of(trace.functions), trips


def frames_to_first_step() -> list[str]:
    """The functions of dlokit on the stack, from `run` to the interpreter of the flow, when the first step begins."""
    found: list[CodeType] = []

    async def first_step(task: ShapeTask) -> NoReturn:
        own = asyncio.current_task()
        outer = [each for each in asyncio.all_tasks() if getattr(each, "_fut_waiter", None) is own]
        frame, stack = inspect.currentframe(), list[CodeType]()
        while frame is not None:
            stack.append(frame.f_code)
            frame = frame.f_back
        entry = next(at for at, code in enumerate(stack) if code.co_name == run_flow.__name__)
        awaiting = [code for each in outer for code in _awaiting(each.get_coro())]
        found.extend([*reversed(stack[entry + 1 :]), *awaiting, stack[entry]])
        raise StepFault(FaultKind.FAILED, "the frames are counted")

    step = SHAPE_DLO.steps[0]
    begins, kept = step.run, sys.argv
    try:
        object.__setattr__(step, "run", first_step)
        with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()), suppress(SystemExit):
            sys.argv = ["dlokit", "shape", "--headless", "--out", f"{folder}/run"]
            main.run(sys.argv[1:])
    finally:
        sys.argv = kept
        object.__setattr__(step, "run", begins)
    return [_named(code) for code in found if code.co_filename.startswith(OURS)]


def _awaiting(coroutine: Any) -> Generator[CodeType]:
    """A coroutine and what it awaits in turn, the outermost first."""
    while (code := getattr(coroutine, "cr_code", None)) is not None:
        yield code
        coroutine = coroutine.cr_await


def _print(console: Console, title: str, way: Way) -> None:
    table = Table(title=title, title_justify="left")
    for heading in ("", "function", "module"):
        table.add_column(heading, no_wrap=True, justify="right" if not heading else "left")
    for number, name in enumerate(way.functions, start=1):
        module, function = name.split(":")
        table.add_row(str(number), function, module)
    console.print(table)
    packages = ", ".join(f"{package} {count}" for package, count in sorted(way.by_package.items()))
    console.print(
        f"{title}: {len(way.functions)} functions, {len(way.plumbing)} of them plumbing, {len(way.rest)} others "
        f"({packages}). Not counted: {len(way.uncounted)} comprehensions, generator expressions and lambdas."
    )
    for name in way.uncounted:
        console.print(f"  {name}", highlight=False)


@dataclass(frozen=True)
class Args:
    """Count the functions on the way of a look, of a skill call between processes, and of a motion."""

    json: Path | None = None
    """File for the counts and lists."""
    seed: int = 0
    """Seed of the cell that is looked at."""
    record: bool = True
    """Whether the look is recorded, as a run's are unless it is told otherwise."""


def run(args: Args) -> int:
    """Trace the ways, and print them; exit code 0."""
    check_json(args.json)
    print("a look is traced, then a call, then a motion", file=sys.stderr)
    motion, trips = asyncio.run(
        traced_motion(RunConfig(headless=True, seed=args.seed, record=args.record, runtime="live"))
    )
    ways = {
        "a look in lockstep": virtual_time.run(
            traced_look(RunConfig(headless=True, seed=args.seed, record=args.record))
        ),
        "a skill call over zenoh": asyncio.run(traced_call()),
        "a motion, live": motion,
    }
    console = Console(width=160)
    for title, way in ways.items():
        _print(console, title, way)
    console.print(f"Trips to the pool in a motion: {trips}.")
    frames = frames_to_first_step()
    console.print(f"From `dlokit shape` to its first step: {len(frames)} frames of dlokit.")
    for name in frames:
        console.print(f"  {name}", highlight=False)
    settings = {"seed": args.seed, "record": args.record}
    found = {title: {"functions": way.functions, "uncounted": way.uncounted} for title, way in ways.items()}
    rows = [
        *_figures(ways),
        figure("a motion, live", "dlokit", "trips", without_interval(float(trips), 1), "1"),
        figure("to the first step", "dlokit", "frames", without_interval(float(len(frames)), 1), "1"),
    ]
    write_figures(args.json, "hops", rows, settings | found, console)
    return 0


def _figures(ways: Mapping[str, Way]) -> list[BenchFigure]:
    return [
        figure(title, "dlokit", metric, without_interval(float(len(functions)), 1), "1")
        for title, way in ways.items()
        for metric, functions in (("functions", way.functions), ("plumbing", way.plumbing), ("others", way.rest))
    ]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
