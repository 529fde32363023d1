"""The state from which another process can resume a shape task: written at each step, read after a crash."""

from dlokit.decision.attempt import GraspMemory, MarkedGrasp
from dlokit.decision.records import GoalRequest
from dlokit.decision.task import ShapeTask
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

    The last error is omitted: it is measured again. An action that was under way does not count.
    """
    task.errors_m = list(journal.errors_m[:-1])
    task.grasps = GraspMemory(marks=list(journal.marks), slips=dict(journal.slips))
    task.spent.actions = journal.actions
    task.spent.start_accepted = bool(journal.errors_m)
    task.spent.started_ns -= round(journal.elapsed_s * 1e9)
    task.spent.planning_time_s = journal.planning_time_s
