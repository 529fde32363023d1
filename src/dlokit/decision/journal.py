"""The course of a shape task: each step as it is published, and the journal from which another process resumes."""

from collections.abc import Awaitable, Callable

from dlokit.communication import topics
from dlokit.decision import api
from dlokit.decision.attempt import GraspMemory, MarkedGrasp
from dlokit.decision.faults import BY_A_PERSON
from dlokit.decision.flow import Flow, StepFault
from dlokit.decision.records import ActionRecord, GoalRequest, StepVisit
from dlokit.decision.task import ShapeTask
from dlokit.types.flow import FlowStatus, RunOutcome
from dlokit.types.message import Value


class Journal(Value, frozen=True, kw_only=True, eq=False):
    """A shape task between two steps of its flow chart."""

    request: GoalRequest
    """The requested goal; one that the operator dragged, as a curve."""
    errors_m: tuple[float, ...]
    """RMSE before the first action and after each [m]; empty before the first look."""
    marks: tuple[MarkedGrasp, ...]
    slips: tuple[tuple[int, int], ...]
    """Grasp node, and number of times that the DLO slipped out of the fingers there."""
    elapsed_s: float
    """Used part of the time budget, on the run's clock [s]."""
    planning_time_s: float
    """On the machine's clock [s]."""

    @property
    def actions(self) -> int:
        """Number of actions that have ended, and count to the budget."""
        return max(len(self.errors_m) - 1, 0)


def journal_of(task: ShapeTask) -> Journal | None:
    """The journal of a task at this moment; None before it has a goal."""
    request = task.request
    if request is None:
        if task.goal_set is None:
            return None
        request = GoalRequest.of(task.goal_set.asked or task.goal)
    return Journal(
        request=request,
        errors_m=tuple(task.errors_m),
        marks=tuple(task.grasps.marks),
        slips=tuple(sorted(task.grasps.slips.items())),
        elapsed_s=(task.port.clock.now_ns() - task.spent.started_ns) / 1e9,
        planning_time_s=task.spent.planning_time_s,
    )


def take_up(task: ShapeTask, journal: Journal) -> None:
    """Put a new task into the state of the journal's task, with its budgets as used there; the DLO is observed again.

    The last error is omitted: it is measured again. An unfinished action does not count.
    """
    task.errors_m = list(journal.errors_m[:-1])
    task.grasps = GraspMemory(marks=list(journal.marks), slips=dict(journal.slips))
    task.spent.actions = journal.actions
    task.spent.start_accepted = bool(journal.errors_m)
    task.spent.started_ns -= round(journal.elapsed_s * 1e9)
    task.spent.planning_time_s = journal.planning_time_s


OPERATOR = "operator"
"""Name in the timings of the time in which the flow waited for the operator: to set the goal, or paused."""


class Diary:
    """Publishes each step as it begins, and measures its duration."""

    def __init__(
        self,
        chart: Flow[ShapeTask],
        task: ShapeTask,
        gate: Callable[[str], Awaitable[None]],
        published: Callable[[FlowStatus], None],
        keep: Callable[[Journal], None],
    ) -> None:
        """`chart` is the flow chart that runs.

        `gate` waits at a step while the operator has paused, or has not allowed its motion, which it gets in words.
        `published` is called with each published status; `keep` receives what another process needs to resume the task.
        """
        self._chart = chart
        self._keep = keep
        self._gate = gate
        self._task = task
        self._published = published
        self._since: tuple[str, int, float] | None = None
        self.timings: list[StepVisit] = []

    async def entered(self, step: str, last_outcome: str) -> None:
        """Note that the flow has come to a step."""
        self._stop_timing()
        paused_ns = self._task.port.clock.now_ns()
        row = self._chart.step(step)
        await self._gate("" if row is None else row.motion)
        self._waited(self._task.port.clock.now_ns() - paused_ns)
        if (journal := journal_of(self._task)) is not None:
            self._keep(journal)
        self._since = (step, self._task.port.clock.now_ns(), self._task.stopwatch())
        self._publish(step, last_outcome, None)

    def faulted(self, fault: StepFault) -> None:
        """Note the fault of a step as the task's reason, and as the end of the current action."""
        step = None if self._since is None else self._chart.step(self._since[0])
        self._task.reason, self._task.fault = str(fault), fault.reason
        if step is not None and fault.reason in BY_A_PERSON:  # the step is on the page, the skill is not
            self._task.reason = f"{fault.why}, in the step “{step.name.replace('_', ' ')}”"
        if step is not None and step.mode is not None and self._task.attempt_under_way is not None:
            self._task.attempt.ends_early(fault.reason)

    def close(self, outcome: RunOutcome) -> None:
        """Note that the task has ended."""
        self._stop_timing()
        self._publish(outcome.value, "", outcome)

    def _stop_timing(self) -> None:
        if self._since is None:
            return
        step, since_ns, since_s = self._since
        now_ns, machine_s = self._task.port.clock.now_ns(), self._task.stopwatch() - since_s
        # A task whose goal the operator sets starts within a step: until then nothing was computed.
        waited_ns = max(self._task.spent.started_ns - since_ns, 0)
        self._waited(waited_ns)
        cell_s, waited_s = (now_ns - since_ns - waited_ns) / 1e9, waited_ns / 1e9
        self.timings.append(StepVisit(step=step, cell_s=cell_s, machine_s=max(machine_s - waited_s, 0.0)))
        self._since = None

    def _waited(self, waited_ns: int) -> None:
        """Add the time in which the flow waited for the operator, as a visit of its own without computing."""
        if waited_ns > 0:
            self.timings.append(StepVisit(step=OPERATOR, cell_s=waited_ns / 1e9, machine_s=0.0))

    def _publish(self, step: str, last_outcome: str, outcome: RunOutcome | None) -> None:
        task, entered = self._task, self._chart.step(step)
        status = FlowStatus(
            stamp_ns=self._task.port.clock.now_ns(),
            flow=self._chart.name,
            step=step,
            last_outcome=last_outcome,
            # An action that the end of the task cuts short has moved the DLO too.
            actions=task.actions + (outcome is not None and task.unfinished),
            rmse_m=task.errors_m[-1] if task.errors_m else None,
            text=task.reason or "",
            outcome=outcome,
            mode=None if entered is None else entered.mode,
        )
        self._task.port.publish(topics.FLOW, status)
        self._published(status)


class TaskDiary:
    """Reports the progress of a task to its caller."""

    def __init__(self, report: Callable[[api.ShapeProgress], None]) -> None:
        self._report = report
        self._step = ""

    def entered(self, status: FlowStatus) -> None:
        """Report that the flow has come to a step."""
        self._step = status.step
        self._report(
            api.ShapeProgress(step=status.step, actions=status.actions, rmse_m=status.rmse_m, text=status.text)
        )

    def recorded(self, record: ActionRecord) -> None:
        """Report an action that has ended."""
        self._report(api.ShapeProgress(step=self._step, actions=record.action, rmse_m=record.rmse_m, action=record))
