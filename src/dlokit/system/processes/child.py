"""Runs the components of a started process, with its bus, clock, heartbeat, and a reliable end."""

import asyncio
import contextlib
import logging
import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TextIO

import msgspec

from dlokit.communication.container import Container, end_tasks, first_of
from dlokit.communication.port import Compute
from dlokit.communication.timing.urgency import garbage_frozen, may_be_urgent
from dlokit.communication.zenoh.access import log_refused_peers
from dlokit.communication.zenoh.session import OpenSession, open_session
from dlokit.errors import EXIT_BAD_INPUT, EXIT_FAULT, HardwareError, InputError, ProcessFailure
from dlokit.system.build import Wiring, assemble
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import read_toml
from dlokit.system.processes.bus import JoinedBus, calls_published, join_bus
from dlokit.system.processes.child_process import (
    BEAT,
    BEAT_PERIOD_S,
    EXIT_NO_DEVICE,
    READY,
    STOP_GRACE_S,
    ChildSpec,
)
from dlokit.system.processes.freed_memory import freed_memory_returned
from dlokit.system.processes.workers import worker_pool
from dlokit.system.results.run_folder import HIDDEN_START, read_start

log = logging.getLogger(__name__)

BuildContainer = Callable[[ChildSpec, JoinedBus, Compute], Container]
"""Builds the container of a process: (what it serves, its bus, its compute port) → container with the components."""


def components_of(spec: ChildSpec, bus: JoinedBus, compute: Compute) -> Container:
    """The components of a process, from the run's configuration file."""
    folder = Path(spec.run_dir)
    wiring = Wiring(
        transport=bus.transport,
        clock=bus.clock,
        folder=folder,
        start_nodes_world=read_start(folder) if "cell" in spec.components else HIDDEN_START,
        page_key=spec.page_key,
    )
    return assemble(spec.components, read_toml(Path(spec.config_file), RunConfig), wiring, compute=compute)


def run_child(build: BuildContainer = components_of, open_session: OpenSession = open_session) -> None:
    """Serve the components given on standard input, until standard input ends or SIGTERM arrives."""
    log_aside()
    spec = msgspec.json.decode(sys.stdin.buffer.readline(), type=ChildSpec)
    log_refused_peers()
    if not may_be_urgent():
        log.info("real-time priority is not allowed here; dlokit doctor explains the consequences")
    try:
        asyncio.run(_serve(spec, build, open_session))
    except (InputError, HardwareError) as error:
        logging.shutdown()  # the supervisor reads the last line
        sys.stderr.write(" ".join(str(error).split()) + "\n")
        sys.exit(EXIT_BAD_INPUT if isinstance(error, InputError) else EXIT_NO_DEVICE)
    except Exception:
        traceback.print_exc()
        logging.shutdown()
        # Objects that end with the interpreter would write below the error, and the supervisor shows the last lines.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
        sys.exit(EXIT_FAULT)


async def _serve(spec: ChildSpec, build: BuildContainer, open_session: OpenSession) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    loop.add_signal_handler(signal.SIGTERM, stop.set)
    # A daemon thread, because only the end of the pipe can wake it.
    threading.Thread(target=_end_with_parent, args=(loop, stop, spec.outlives_s), daemon=True).start()
    with worker_pool() as compute, freed_memory_returned():
        async with join_bus(spec.bus, spec.time_base, open_session) as bus:
            host = build(spec, bus, compute)
            # Otherwise the first look on a loaded machine would wait for the start of a worker, and time out.
            await beating(spec.beat_fd, asyncio.gather(host.prepare(), dependencies_present(spec, bus)))
            # The page's calls, say, without which a recording would not explain what perception or the model did.
            with calls_published(bus.transport, bus.clock):
                async with garbage_frozen(), host, host.guarded():
                    await first_of(_beat(spec.beat_fd, READY), stop.wait())
    log.info("%s has ended", spec.process)


async def beating(beat_fd: int, work: Awaitable[object]) -> None:
    """Send heartbeats while the process prepares its work: compilation, the first time, may take minutes."""
    beats = asyncio.create_task(_beat(beat_fd, BEAT))
    try:
        await work
    finally:
        await end_tasks(beats)


async def dependencies_present(spec: ChildSpec, bus: JoinedBus) -> None:
    """Wait for the components that this process depends on, while it loads libraries. Raises `ProcessFailure`."""
    for component in spec.after:
        if not await bus.transport.wait_for(component, spec.others_within_s):
            raise ProcessFailure(
                f"component_missing: {component}", f"{spec.process} waited {spec.others_within_s:g} s for it"
            )
    await bus.first_tick(spec.others_within_s)


async def _beat(beat_fd: int, mark: bytes) -> None:
    """Send `mark`, then heartbeats, from the loop that serves the components, so that they stop when the loop hangs."""
    os.set_blocking(beat_fd, False)
    while True:
        # The pipe is full because the supervisor is not reading, or it is closed, which also ends standard input.
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(beat_fd, mark)
        mark = BEAT
        await asyncio.sleep(BEAT_PERIOD_S)


def _end_with_parent(loop: asyncio.AbstractEventLoop, stop: asyncio.Event, outlives_s: float) -> None:
    """Wait for the end of standard input, which marks the end of the parent process."""
    while os.read(sys.stdin.fileno(), 1024):
        pass
    time.sleep(outlives_s)
    with contextlib.suppress(RuntimeError):  # the loop has ended already
        loop.call_soon_threadsafe(stop.set)
    # A loop that hangs gets no second request; the group contains this process and its own workers.
    threading.Event().wait(STOP_GRACE_S)
    os.killpg(0, signal.SIGKILL)


WAITING_LINES = 1000
"""Largest number of lines that wait for the disk; further ones are counted instead."""
CLOSES_WITHIN_S = 1.0
"""Longest wait for the last lines at the end of the process [s]."""


class AsideHandler(logging.Handler):
    """Formats lines where they are logged, and writes them on a thread."""

    def __init__(self, stream: TextIO, closes_within_s: float = CLOSES_WITHIN_S) -> None:
        super().__init__()
        self._closes_within_s = closes_within_s
        self._stream = stream
        self._lines: queue.Queue[str | None] = queue.Queue(WAITING_LINES)
        self._dropped = 0
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Number of lines that are not written yet."""
        return self._lines.unfinished_tasks

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a line; returns at once."""
        try:
            self._lines.put_nowait(self.format(record))
        except queue.Full:
            self._dropped += 1

    def close(self) -> None:
        """Write the waiting lines, unless the disk does not respond."""
        super().close()
        if self._thread.is_alive():
            try:
                self._lines.put(None, timeout=self._closes_within_s)
            except queue.Full:
                return
            self._thread.join(self._closes_within_s)

    def _write(self) -> None:
        while (line := self._lines.get()) is not None:
            dropped, self._dropped = self._dropped, 0
            if dropped:
                line = f"{line}\n({dropped} lines before this one were dropped: the disk was too slow)"
            try:
                self._stream.write(f"{line}\n")
                self._stream.flush()
            except OSError:
                self._dropped += 1 + dropped  # a full disk: the lines are lost, the process is not
            self._lines.task_done()


def log_aside() -> None:
    """Log to standard error from now on, without waiting for it."""
    handler = AsideHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
