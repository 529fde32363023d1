"""How many of our functions stand on the way of a look, and on the way of a skill call between processes.

    python benchmarks/hops.py
    python benchmarks/hops.py --json hops.json

Two ways are traced with Python's own profiler, and every distinct function of dlokit on them is listed, in the order of
the first calls.

A look, in lockstep: from the moment in which the decision layer asks perception for it (`decision.looking.look`), over
pictures, segmentation, stereo, cloud, target points and model, until the convergence check (the box `compare`) has
judged the model's state. A skill call, over zenoh: from `port.call` of one component to its outcome, caller and called
one each with a host and a transport of its own, both in one process.

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
"""

import asyncio
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import zenoh
from rich.console import Console
from rich.table import Table

import dlokit
from dlokit.communication import topics
from dlokit.communication.component import Component, implements
from dlokit.communication.container import Container
from dlokit.communication.skill import Skill
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.zenoh.session import ZenohConfig, open_session
from dlokit.communication.zenoh.transport import ZenohTransport
from dlokit.decision.convergence import error_m
from dlokit.decision.looking import LOOK_INTERVAL_S, look
from dlokit.decision.steps.goal import set_goal
from dlokit.decision.steps.perceive import compare, find_dlo
from dlokit.decision.task import Odometer, ShapeTask, Spent
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import without_interval
from dlokit.recording.disk import Disk
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob, job_from_config
from dlokit.system.lockstep import LockstepSystem, lockstep_system
from dlokit.system.processes.sockets import local_bus
from dlokit.system.results.recording import lockstep_recorder
from dlokit.types.outcome import Outcome, Succeeded
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
            module = code.co_filename.removeprefix(OURS).removesuffix(".py").replace("/", ".")
            self._seen[code] = f"dlokit.{module}:{code.co_qualname}"

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
    """A zenoh session whose answers are traced: they come on zenoh's own threads, which Python's profiler passes by."""

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

    def _traced(self, function: Callable[..., object]) -> Callable[..., None]:
        def call(*arguments: object) -> None:
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
    """Count the functions on the way of a look, and of a skill call between processes."""

    json: Path | None = None
    """File for the counts and lists."""
    seed: int = 0
    """Seed of the cell that is looked at."""
    record: bool = True
    """Whether the look is recorded, as a run's are unless it is told otherwise."""


def run(args: Args) -> int:
    """Trace both ways, and print them; exit code 0."""
    check_json(args.json)
    print("a look is traced, then a call", file=sys.stderr)
    ways = {
        "a look in lockstep": virtual_time.run(
            traced_look(RunConfig(headless=True, seed=args.seed, record=args.record))
        ),
        "a skill call over zenoh": asyncio.run(traced_call()),
    }
    console = Console(width=160)
    for title, way in ways.items():
        _print(console, title, way)
    settings = {"seed": args.seed, "record": args.record}
    found = {title: {"functions": way.functions, "uncounted": way.uncounted} for title, way in ways.items()}
    write_figures(args.json, "hops", _figures(ways), settings | found, console)
    return 0


def _figures(ways: Mapping[str, Way]) -> list[BenchFigure]:
    return [
        figure(title, "dlokit", metric, without_interval(float(len(functions)), 1), "1")
        for title, way in ways.items()
        for metric, functions in (("functions", way.functions), ("plumbing", way.plumbing), ("others", way.rest))
    ]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
