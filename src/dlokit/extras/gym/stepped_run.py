"""One lockstep run that its caller advances call by call; its clock does not advance between the calls."""

import asyncio
import atexit
import contextlib
import weakref
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from dlokit.communication.component import Component
from dlokit.communication.timing.virtual_time import VirtualTimeLoop, run_with
from dlokit.functional.cell.component import CellComponent
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.lockstep import LockstepSystem, lockstep_system

T = TypeVar("T")


class SteppedRun:
    """All components of a run in this process, without files, threads or child processes.

    If an event loop is already running, as in a notebook, the components run on another thread.
    """

    def __init__(self, config: RunConfig, job: ShapeJob) -> None:
        """Build and start the components. Raises `DlokitError`."""
        self._pool = _thread_beside_loop()
        self._runner = asyncio.Runner(loop_factory=VirtualTimeLoop)
        cells: list[CellComponent] = []

        def build(name: str, config: RunConfig, wiring: Wiring) -> Component:
            component = build_component(name, config, wiring)
            if isinstance(component, CellComponent):
                cells.append(component)
            return component

        context = lockstep_system(config, job.start_nodes_world, None, build=build)
        self._close = weakref.finalize(self, _shut_down, self._pool, self._runner, context)
        self._close.atexit = False
        self._closed_at_exit = False
        self.system: LockstepSystem = self._on_thread(lambda: run_with(self._runner, context.__aenter__()))
        (self.cell,) = cells
        """The cell, for the judgement and the pictures of an episode."""

    def run(self, main: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end on the episode's clock. Raises the error of a component that fails meanwhile."""
        result = self._on_thread(lambda: run_with(self._runner, self._watched(main)))
        if not self._closed_at_exit:
            # Only now, after the first picture: the interpreter runs exit handlers in reverse order of their
            # registration.
            atexit.register(self._close)
            self._closed_at_exit = True
        return result

    def close(self) -> None:
        """End all components; the second call does nothing."""
        atexit.unregister(self._close)
        self._close()

    async def _watched(self, main: Coroutine[Any, Any, T]) -> T:
        async with self.system.host.guarded():
            return await main

    def _on_thread(self, function: Callable[[], T]) -> T:
        return function() if self._pool is None else self._pool.submit(function).result()


def _thread_beside_loop() -> ThreadPoolExecutor | None:
    """A thread for another event loop if one is running on this thread; else None."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return None
    return ThreadPoolExecutor(1, thread_name_prefix="dlokit episode")


def _shut_down(
    pool: ThreadPoolExecutor | None,
    runner: asyncio.Runner,
    context: contextlib.AbstractAsyncContextManager[LockstepSystem],
) -> None:
    def end() -> None:
        with contextlib.suppress(RuntimeError):  # it was never entered
            runner.run(_leave(context))
        runner.close()

    if pool is None:
        end()
        return
    with contextlib.suppress(RuntimeError):  # at the end of the interpreter its threads take no more work
        pool.submit(end).result()
    pool.shutdown()


async def _leave(context: contextlib.AbstractAsyncContextManager[LockstepSystem]) -> None:
    await context.__aexit__(None, None, None)
