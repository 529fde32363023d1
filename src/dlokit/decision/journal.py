"""What a shape task must know to go on in another process: written at each box, read after a crash."""

from dlokit.decision.attempt import GraspMemory, MarkedGrasp
from dlokit.decision.records import GoalRequest
from dlokit.decision.task import ShapeTask
from dlokit.types.message import Value


class Journal(Value, frozen=True, kw_only=True, eq=False):
    """A shape task between two boxes of its flow chart."""

    request: GoalRequest
    """The goal as it was asked for; what the operator dragged, as a curve."""
    errors_m: tuple[float, ...]
    """RMSE before the first action and after each [m]; empty before the first look."""
    marks: tuple[MarkedGrasp, ...]
    slips: tuple[tuple[int, int], ...]
    """Grasp node, and how often the DLO slipped out there."""
    elapsed_s: float
    """What is spent of the time budget, on the cell's clock [s]."""
    planning_time_s: float
    """On the machine's clock [s]."""

    @property
    def actions(self) -> int:
        """How many have ended, and are spent of the budget."""
        return max(len(self.errors_m) - 1, 0)


def journal_of(task: ShapeTask) -> Journal | None:
    """What is to be kept of a task now; None before it has a goal."""
    request = task.request
    if request is None:
        if task.goal_set is None:
            return None
        goal = task.goal_set.asked or task.goal
        request = GoalRequest(
            nodes_world=goal.nodes_world, name=goal.name, ends_interchangeable=goal.ends_interchangeable
        )
    return Journal(
        request=request,
        errors_m=tuple(task.errors_m),
        marks=tuple(task.grasps.marks),
        slips=tuple(sorted(task.grasps.slips.items())),
        elapsed_s=(task.port.clock.now_ns() - task.spent.started_ns) / 1e9,
        planning_time_s=task.spent.planning_time_s,
    )


def take_up(task: ShapeTask, journal: Journal) -> None:
    """Bring a new task to where the journal's one was: the DLO is looked at anew, what is spent stays spent.

    The last error is left out: it is measured again. An action that was under way does not count.
    """
    task.errors_m = list(journal.errors_m[:-1])
    task.grasps = GraspMemory(marks=list(journal.marks), slips=dict(journal.slips))
    task.spent.actions = journal.actions
    task.spent.start_accepted = bool(journal.errors_m)
    task.spent.started_ns -= round(journal.elapsed_s * 1e9)
    task.spent.planning_time_s = journal.planning_time_s
