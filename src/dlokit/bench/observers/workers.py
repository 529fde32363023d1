"""Trials in processes of their own, whose linear algebra has one thread each."""

import multiprocessing
import os
import queue
import signal
import time
import traceback
from collections.abc import Callable, Generator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.context import SpawnProcess
from typing import Any, TypeVar

from dlokit.bench.observers.runner import BenchPlan, Sequences, Task, Trial, run_task
from dlokit.errors import DlokitError, MachineError

THREAD_VARIABLES = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
)
"""What BLAS libraries, OpenMP and Numba read when they are loaded."""
_TOLD_EVERY_S = 1.0
_LOOKED_AFTER_EVERY_S = 1.0


@dataclass(frozen=True, kw_only=True)
class TrialStage:
    """How far a trial is that is still under way."""

    case: str
    seed: int
    method: str
    frame: int
    frames: int


Said = Trial | TrialStage
Result = TypeVar("Result")


def run_in_workers(plan: BenchPlan, jobs: int) -> Generator[Said]:
    """Every trial, `jobs` cases at once; and how far those are that take long.

    Closing the iterator ends the processes. Raises what a trial raised, `MachineError` when a process died.
    """
    context = multiprocessing.get_context("spawn")  # a forked process would keep the threads' settings of this one
    tasks: Any = context.Queue()
    said: Any = context.Queue()
    for task in (*plan.tasks, *([None] * jobs)):
        tasks.put(task)
    workers = [context.Process(target=_work, args=(plan, tasks, said), daemon=True) for _ in range(jobs)]
    try:
        with one_thread():
            for worker in workers:
                worker.start()
        missing = plan.trials
        while missing > 0:
            item = _next(said, workers)
            if isinstance(item, BaseException):
                raise item
            missing -= isinstance(item, Trial)
            yield item
    finally:
        for worker in workers:
            worker.terminate()
        for done in (tasks, said):
            done.cancel_join_thread()


def in_a_worker(work: Callable[[], Result]) -> Result:
    """What a function of a module gives in a process whose linear algebra has one thread."""
    with one_thread(), ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work).result()


def _next(said: Any, workers: list[SpawnProcess]) -> Any:
    while True:
        try:
            return said.get(timeout=_LOOKED_AFTER_EVERY_S)
        except queue.Empty:
            codes = [worker.exitcode for worker in workers if worker.exitcode]
            if codes:
                raise MachineError(
                    f"A process of the bench ended with code {codes[0]}, perhaps for want of memory: "
                    "use fewer --jobs or shorter sequences (--frames)."
                ) from None


def _work(plan: BenchPlan, tasks: Any, said: Any) -> None:
    # Ctrl-C goes to every process of a terminal; the first one ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sequences = Sequences(plan.frames)
    task: Task
    for task in iter(tasks.get, None):
        try:
            for trial in run_task(task, sequences.of(task), plan.methods, _teller(task, said)):
                said.put(trial)
        except DlokitError as error:
            said.put(error)
        except Exception:  # the other process shows it
            said.put(RuntimeError(traceback.format_exc()))


def _teller(task: Task, said: Any) -> Any:
    last_s = time.monotonic()

    def tell(method: str, frame: int, frames: int) -> None:
        nonlocal last_s
        if time.monotonic() - last_s > _TOLD_EVERY_S:
            last_s = time.monotonic()
            said.put(TrialStage(case=task.case.name, seed=task.seed, method=method, frame=frame, frames=frames))

    return tell


@contextmanager
def one_thread() -> Generator[None]:
    """Processes started meanwhile have one thread for linear algebra, whatever the user has set for this one."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
