"""The skills of the decision layer: a flow is itself a skill, and larger tasks build on it."""

from dlokit.communication.skill import Condition, ReportingSkill, Skill
from dlokit.decision.config import Infeasible
from dlokit.decision.records import ActionRecord, GoalRequest, ShapeResult
from dlokit.types.dlo import GoalShape
from dlokit.types.message import Value
from dlokit.types.system import StrategySpec


class ShapeProgress(Value, frozen=True, kw_only=True, eq=False):
    """Progress of a shape task: reported at each step of its flow chart, and after each action."""

    step: str
    """The step that begins."""
    actions: int
    """Actions that have ended."""
    rmse_m: float | None
    """Last estimate of the error to the goal [m]; None before the first."""
    text: str = ""
    """One line for people."""
    action: ActionRecord | None = None
    """The action that has just ended; reported once."""


def _shape_dlo(
    goal: str | GoalRequest,
    threshold_m: float | None = None,
    max_actions: int | None = None,
    infeasible: Infeasible | None = None,
    planner: str | StrategySpec | None = None,
) -> ShapeResult:
    """Bring the DLO into a shape by looking at it: the paper's Fig. 6 as one skill.

    `goal` is a built-in shape by its name (I, L, U, S, W, spiral), or a curve in the world. It counts as reached below
    an RMSE of `threshold_m` [m]; at most `max_actions` actions are tried; `infeasible` is the policy for a goal that
    does not hold; `planner` chooses actions in this and later tasks, by its name or with settings. None: as configured.

    It succeeds when the task reaches an end of its chart (converged, stalled, budget, infeasible) or the operator
    cancels it; the result's `outcome` names the end, its `rmse_m` is the final error. Cancelling the call stops the
    robot, whose gripper stays closed. Fails with: task_failed (the robot, the camera or a component failed).
    Rejected with: busy (another task runs), unknown_shape, bad_shape, unknown_post, bad_settings, unknown_strategy.
    """
    ...


def _stop_task(by: str = "") -> bool:
    """End the running task, as the operator's button does; return whether one ran, or a person's stop of an arm had
    already ended the last one.

    The arms brake, and stay stopped. A run that takes goal after goal waits for the next one. `by` names the caller in
    the reason of the task's end.
    """
    ...


def _see_goal() -> GoalShape:
    """Take the shape that the camera sees now as the goal: the arms move out of the picture, and the camera looks.

    Fails with: fixtures (one does not stand as believed; nothing has moved), or the reason of the skill that failed,
    e.g. no_points or robot_lost. Rejected with: busy (a task runs).
    """
    ...


IDLE = Condition("no other task runs", "busy")

SHAPE_DLO = ReportingSkill(
    "decision",
    "shape_dlo",
    _shape_dlo,
    timeout_s=7200.0,
    requires=(IDLE,),
    ensures="the robot is at rest; the DLO is within the threshold of the goal if the outcome is converged",
    moves_arm=True,
    reports=ShapeProgress,
)
SEE_GOAL = Skill(
    "decision",
    "see_goal",
    _see_goal,
    timeout_s=120.0,
    requires=(IDLE,),
    ensures="the arms are out of the picture, and the shape that was seen is the goal",
    moves_arm=True,
)
STOP_TASK = Skill("decision", "stop_task", _stop_task, 5.0, "", "the task that ran has ended, or is ending")
