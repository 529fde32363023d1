"""The operator of a run: the commands from the page, and the run's status for the page."""

import asyncio
from collections.abc import Callable

import msgspec

from dlokit.types.flow import Command, RunPhase, RunStatus, TaskEnd


class OperatorDesk:
    """Stores the operator's commands, holds the flow accordingly, and publishes each change."""

    def __init__(self, publish: Callable[[RunStatus], None]) -> None:
        """`publish` sends a status; its stamp is set there."""
        self._publish = publish
        self._changed = asyncio.Event()
        self._allowed = False
        self.status = RunStatus(stamp_ns=0, phase=RunPhase.STARTING)
        self.ends = asyncio.Event()
        """Set when the run shall take no other goal."""

    def publish(
        self, phase: RunPhase, *, asks: str = "", notice: str = "", task: int | None = None, last: TaskEnd | None = None
    ) -> None:
        """Publish another phase; None keeps the number of the task and the last end."""
        before = self.status
        self._put(
            msgspec.structs.replace(
                before,
                phase=phase,
                asks=asks,
                notice=notice,
                task=before.task if task is None else task,
                last=before.last if last is None else last,
            )
        )

    def stay(self) -> None:
        """The run takes another goal after each task."""
        self._put(msgspec.structs.replace(self.status, stays=True))

    def end(self) -> None:
        """The run takes no other goal."""
        self.ends.set()
        self._put(msgspec.structs.replace(self.status, stays=False))

    def task_begins(self) -> None:
        """A pause applied to the previous task only."""
        self._put(
            msgspec.structs.replace(
                self.status, phase=RunPhase.RUNNING, task=self.status.task + 1, paused=False, asks="", notice=""
            )
        )

    def command(self, command: Command) -> None:
        """Note a command that holds or releases the flow; other commands have no effect here."""
        match command:
            case Command.PAUSE | Command.RESUME:
                self._put(msgspec.structs.replace(self.status, paused=command is Command.PAUSE))
            case Command.STEPWISE | Command.CONTINUOUS:
                self._put(msgspec.structs.replace(self.status, stepwise=command is Command.STEPWISE))
            case Command.PROCEED:
                self._allowed = self.status.phase is RunPhase.ASKING
            case _:
                return
        self._changed.set()

    async def gate(self, motion: str) -> None:
        """Wait while the operator has paused, or has not allowed a step's `motion`; without a time limit.

        Empty for a step in which no arm moves: step by step, it is passed at once.
        """
        self._allowed = False
        while self.status.paused or (motion and self.status.stepwise and not self._allowed):
            asks = "" if self.status.paused else motion
            self.publish(RunPhase.ASKING if asks else RunPhase.PAUSED, asks=asks)
            self._changed.clear()
            await self._changed.wait()
        self.publish(RunPhase.RUNNING)

    def _put(self, status: RunStatus) -> None:
        if _content(status) != _content(self.status):
            self.status = status
            self._publish(status)


def _content(status: RunStatus) -> tuple[object, ...]:
    last = status.last
    return (
        *(getattr(status, field) for field in status.__struct_fields__ if field not in ("stamp_ns", "seq", "last")),
        None if last is None else (last.number, last.files),
    )
