"""Where a shape task is and was: told to everybody on the bus, and to whoever called."""

from collections.abc import Awaitable, Callable

from dlokit.communication import topics
from dlokit.decision import api
from dlokit.decision.flow import StepFault
from dlokit.decision.journal import Journal, journal_of
from dlokit.decision.records import ActionRecord, StepVisit
from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.decision.task import ShapeTask
from dlokit.types.flow import FlowStatus, RunOutcome

OPERATOR = "operator"
"""In the timings: the flow waited for the operator, who sets the goal or has paused it."""


class Diary:
    """Publishes each box as it is entered, and measures how long it took."""

    def __init__(
        self,
        task: ShapeTask,
        gate: Callable[[], Awaitable[None]],
        told: Callable[[FlowStatus], None],
        keep: Callable[[Journal], None],
    ) -> None:
        """`gate` holds the flow up while the operator has paused; `told` hears what is published.

        `keep` is given what another process would need to go on.
        """
        self._keep = keep
        self._gate = gate
        self._task = task
        self._told = told
        self._since: tuple[str, int, float] | None = None
        self.timings: list[StepVisit] = []

    async def entered(self, step: str, last_outcome: str) -> None:
        """The flow has come to a box."""
        self._stop_timing()
        paused_ns = self._task.port.clock.now_ns()
        await self._gate()
        self._waited(self._task.port.clock.now_ns() - paused_ns)
        if (journal := journal_of(self._task)) is not None:
            self._keep(journal)
        self._since = (step, self._task.port.clock.now_ns(), self._task.stopwatch())
        self._publish(step, last_outcome, None)

    def faulted(self, fault: StepFault) -> None:
        """A box could not end as it should: why, should the task end here, and what ended an action under way."""
        self._task.reason = str(fault)
        box = None if self._since is None else SHAPE_DLO.step(self._since[0])
        if box is not None and box.mode is not None and self._task.attempt_under_way is not None:
            self._task.attempt.ends_early(fault.reason)

    def close(self, outcome: RunOutcome) -> None:
        """The task has ended."""
        self._stop_timing()
        self._publish(outcome.value, "", outcome)

    def _stop_timing(self) -> None:
        if self._since is None:
            return
        step, since_ns, since_s = self._since
        now_ns, machine_s = self._task.port.clock.now_ns(), self._task.stopwatch() - since_s
        # A task for which the operator sets the goal starts within a step: until then nothing was computed.
        waited_ns = max(self._task.spent.started_ns - since_ns, 0)
        self._waited(waited_ns)
        cell_s, waited_s = (now_ns - since_ns - waited_ns) / 1e9, waited_ns / 1e9
        self.timings.append(StepVisit(step=step, cell_s=cell_s, machine_s=max(machine_s - waited_s, 0.0)))
        self._since = None

    def _waited(self, waited_ns: int) -> None:
        """The flow waited for the operator: a visit of its own, without computing."""
        if waited_ns > 0:
            self.timings.append(StepVisit(step=OPERATOR, cell_s=waited_ns / 1e9, machine_s=0.0))

    def _publish(self, step: str, last_outcome: str, outcome: RunOutcome | None) -> None:
        task, box = self._task, SHAPE_DLO.step(step)
        status = FlowStatus(
            stamp_ns=self._task.port.clock.now_ns(),
            flow=SHAPE_DLO.name,
            step=step,
            last_outcome=last_outcome,
            actions=task.actions,
            rmse_m=task.errors_m[-1] if task.errors_m else None,
            text=task.reason or "",
            outcome=outcome,
            mode=None if box is None else box.mode,
        )
        self._task.port.publish(topics.FLOW, status)
        self._told(status)


class TaskDiary:
    """What the caller of a task is told."""

    def __init__(self, report: Callable[[api.ShapeProgress], None]) -> None:
        self._report = report
        self._step = ""

    def entered(self, status: FlowStatus) -> None:
        """The flow has come to a box."""
        self._step = status.step
        self._report(
            api.ShapeProgress(step=status.step, actions=status.actions, rmse_m=status.rmse_m, text=status.text)
        )

    def recorded(self, record: ActionRecord) -> None:
        """An action has ended."""
        self._report(api.ShapeProgress(step=self._step, actions=record.action, rmse_m=record.rmse_m, action=record))
