"""The compute port of a live process: one worker for heavy, pure work, so that the event loop goes on beating."""

import logging
from collections.abc import Callable, Generator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

from dlokit.errors import SkillFailure
from dlokit.system.worker import Worker

log = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")


class WorkerCompute:
    """A compute port whose worker starts with the first task; most components have none."""

    def __init__(self) -> None:
        self._worker: Worker | None = None

    async def __call__(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Result of ``function(*args, **kwargs)``, computed in the worker.

        A worker that dies or freezes meanwhile is replaced, and the work, which is pure, done once more. Raises
        `SkillFailure` ``worker_died`` when the second one dies of it too.
        """
        worker = self._present()
        try:
            return await worker.do(function, *args, **kwargs)
        except BrokenProcessPool:
            log.warning("the worker has died; another one does its work once more")
        self._forget(worker)
        worker = self._present()
        try:
            return await worker.do(function, *args, **kwargs)
        except BrokenProcessPool as error:
            self._forget(worker)
            raise SkillFailure("worker_died", "two worker processes have died of this work") from error

    def _present(self) -> Worker:
        if self._worker is None:
            self._worker = Worker()
        return self._worker

    def _forget(self, worker: Worker) -> None:
        worker.shut_down()
        if self._worker is worker:  # another task may have replaced it already
            self._worker = None

    def close(self) -> None:
        """Take no more tasks; what runs is finished, what waits is dropped."""
        if self._worker is not None:
            self._worker.shut_down(drop=True)


@contextmanager
def worker_pool() -> Generator[WorkerCompute]:
    """A compute port whose worker ends with the process that owns it, however that ends."""
    compute = WorkerCompute()
    try:
        yield compute
    finally:
        compute.close()
