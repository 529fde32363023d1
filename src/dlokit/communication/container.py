"""The container: connects components to a bus and answers skill calls (Algorithm 2)."""

import asyncio
import logging
from collections.abc import AsyncGenerator, Coroutine, Mapping
from contextlib import asynccontextmanager
from typing import Any, NoReturn, TypeVar

from dlokit.communication.component import Component
from dlokit.communication.dispatch import Dispatcher
from dlokit.communication.log_rate import LogRate
from dlokit.communication.port import Compute, InlineCompute, Port
from dlokit.communication.timing.clock import Clock
from dlokit.communication.topic import KeepLast, Topic
from dlokit.communication.transport import Transport
from dlokit.errors import CommunicationError, ConfigError, SkillFailure, SkillRejected

log = logging.getLogger(__name__)

T = TypeVar("T")

STOP_TIMEOUT_S = 5.0
"""Longest wait for the components' tasks to end when the container stops [s]."""


class Container:
    """Runs components of one process on one event loop. Use as an async context manager."""

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        compute: Compute | None = None,
        instances: Mapping[str, tuple[str, ...]] | None = None,
    ) -> None:
        """`instances` lists, by component, the instances in addition to the first; a reader receives all of them."""
        self._instances = instances or {}
        self.transport = transport
        self.clock = clock
        self._compute: Compute = compute or InlineCompute()
        self._components: list[Component] = []
        self._tasks: list[asyncio.Task[None]] = []
        self._failed: asyncio.Future[None] | None = None

    def add(self, component: Component) -> None:
        """Add a component and attach its port; call this before the container starts."""
        for topic in component.publishes:
            if topic.publisher != component.name:
                raise ConfigError(
                    f"{component.name} cannot publish {topic.name}: in the topic table, its publisher is "
                    f"{topic.publisher}"
                )
        component.attach(
            Port(
                self.transport,
                self.clock,
                self._compute,
                owner=component.address,
                publishes=component.publishes,
                subscribes=component.subscribes(),
                instance=component.instance,
            )
        )
        self._components.append(component)

    async def prepare(self) -> None:
        """Run each component's preparation in its compute process; a live process does so before it reports ready."""
        for component in self._components:
            preparation = component.preparation()
            if preparation is None:
                continue
            try:
                await self._compute(preparation)
            except Exception:  # the call that needs it fails with the same error, by name
                log.exception("%s could not be prepared; its first computation will take longer", component.address)

    async def __aenter__(self) -> "Container":
        self._failed = asyncio.get_running_loop().create_future()
        # All subscriptions are made before the first component runs, so that no first message is lost.
        for component in self._components:
            for row, method in component.handlers().items():
                for topic in self._all_instances(row):
                    # The last state still holds for a component that joins late; an earlier event is over.
                    stream = self.transport.stream(topic, with_last=isinstance(topic.policy, KeepLast))
                    self._start(component, f"on {topic.name}", _handle(component, topic, method, stream))
            for row in component.reads:
                for topic in self._all_instances(row):
                    # The first read subscribes and finds nothing yet: the container does it for the component.
                    self.transport.latest(topic)
        for component in self._components:
            self.transport.serve(component.address, Dispatcher(component, self.clock))
        for component in self._components:
            self._start(component, "run", component.run())
        return self

    async def __aexit__(self, *exc: object) -> None:
        for component in reversed(self._components):
            await self.transport.withdraw(component.address)
        for task in reversed(self._tasks):
            task.cancel()
        if self._tasks:
            _, stuck = await asyncio.wait(self._tasks, timeout=STOP_TIMEOUT_S)
            for task in stuck:
                log.error("%s did not end within %g s of its cancellation", task.get_name(), STOP_TIMEOUT_S)
        if self._failed is not None and self._failed.done():
            self._failed.exception()  # retrieved, so that the loop logs no warning

    @property
    def components(self) -> tuple[Component, ...]:
        """Its components, in the order in which they were added."""
        return tuple(self._components)

    async def wait_failed(self) -> NoReturn:
        """Wait until a component's task raises, and raise its error."""
        assert self._failed is not None, "the container is not started"
        await asyncio.shield(self._failed)
        raise AssertionError("only an error ends the wait")

    @asynccontextmanager
    async def guarded(self) -> AsyncGenerator[None]:
        """Cancel the block when a component's task raises, and raise its error in place of the block's result.

        A cancellation from elsewhere reaches the block alone, which may catch it and return a result.
        """
        block, inside, interrupted = asyncio.current_task(), True, False
        assert block is not None

        def interrupt(watch: asyncio.Task[NoReturn]) -> None:
            nonlocal interrupted
            if inside:
                interrupted = block.cancel()

        watch = asyncio.create_task(self.wait_failed(), name="watch")
        watch.add_done_callback(interrupt)
        try:
            yield
        finally:
            inside = False
            if interrupted:
                block.uncancel()
            if watch.done():
                watch.result()
            await end_tasks(watch)

    def _all_instances(self, topic: Topic[Any]) -> tuple[Topic[Any], ...]:
        return (topic, *(topic.at(instance) for instance in self._instances.get(topic.publisher, ())))

    def _start(self, component: Component, what: str, coroutine: Any) -> None:
        task: asyncio.Task[None] = asyncio.create_task(coroutine, name=f"{component.address} {what}")
        task.add_done_callback(self._note_error)
        self._tasks.append(task)

    def _note_error(self, task: asyncio.Task[None]) -> None:
        if task.cancelled() or task.exception() is None:
            return
        error = task.exception()
        if self._failed is not None and not self._failed.done() and error is not None:
            self._failed.set_exception(error)
        log.error("%s ended: %s", task.get_name(), error, exc_info=error)


async def _handle(component: Component, topic: Topic[Any], method: str, stream: Any) -> None:
    handler, rate = getattr(component, method), LogRate()
    async for message in stream:
        try:
            await handler(message)
        except (SkillFailure, SkillRejected, CommunicationError) as error:
            # One bad message must not end the component: it continues with the next.
            if number := rate.due(topic.name):
                log.warning("%s on %s: %d failed, the last: %s", component.address, topic.name, number, error)


async def first_of(*works: Coroutine[Any, Any, T]) -> T:
    """Result or error of the awaitable that ends first; the rest are cancelled. In a tie, the first given counts."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        return next(task for task in tasks if task in done).result()
    finally:
        await end_tasks(*tasks)


async def end_tasks(*tasks: asyncio.Task[Any]) -> None:
    """Cancel tasks and wait until all have ended; their errors are ignored."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
