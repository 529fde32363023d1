"""The skills of planning."""

from dlokit.communication.skill import Skill
from dlokit.types.action import Action, ControlAdvice, ControlForecast, Correction, GraspedNode, Marks
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.feasibility import GoalVerdict, Verdict
from dlokit.types.system import StrategySpec


def _propose(shape: DloState, goal: GoalShape, marks: Marks, skip: int = 0) -> Action:
    """Return and publish the best valid action, after `skip` others. Fails with: no_valid_grasp."""
    ...


def _judge_goal(goal: GoalShape, threshold_m: float) -> GoalVerdict:
    """Judge whether a goal can be reached to `threshold_m` (RMSE) [m] and would hold; also publishes the verdict.

    Table, reach, view, self-collision, bends, room for the fingers, and what friction holds, tried in the model.
    Rejects: bad_shape, bad_threshold.
    """
    ...


def _check_start(shape: DloState) -> Verdict:
    """Check that the DLO is on the table, in reach and view, and does not cross itself."""
    ...


def _foresee_control(
    shape: DloState, goal: GoalShape, action: Action, prediction_error_m: float = 0.0
) -> ControlForecast:
    """Decide, before an action, whether shape servoing should follow it.

    `prediction_error_m` is the prediction error of such actions in this task [m]. Rejects: shapes_differ.
    """
    ...


def _correct(
    shape: DloState,
    goal: GoalShape,
    grip: GraspedNode,
    done: tuple[Correction, ...],
    threshold_m: float,
    others: tuple[GraspedNode, ...] = (),
) -> ControlAdvice:
    """Shape servoing: the next correction of a held DLO on the table, or the end of control.

    `done` are the corrections since the grasp, `others` nodes held by other robots. Rejects: shapes_differ, bad_grip.
    """
    ...


def _set_strategy(spec: StrategySpec) -> None:
    """Select the strategy that chooses actions. Rejects: unknown_strategy, bad_settings."""
    ...


PROPOSE = Skill(
    "planning",
    "propose",
    _propose,
    timeout_s=30.0,
    requires="shape and goal have the same number of nodes",
    ensures="the action is reachable, its gripper fits, its node is not marked",
)
JUDGE_GOAL = Skill(
    "planning",
    "judge_goal",
    _judge_goal,
    timeout_s=30.0,
    requires="the goal has the model's number of nodes",
    ensures="the verdict names every problem, and the nearest shape found that holds, if any",
)
CHECK_START = Skill("planning", "check_start", _check_start, timeout_s=10.0, ensures="the verdict names every problem")
FORESEE_CONTROL = Skill(
    "planning",
    "foresee_control",
    _foresee_control,
    timeout_s=10.0,
    requires="the action was proposed for this shape",
    ensures="control follows if the expected reduction of the error exceeds the uncertainty of the observation",
)
CORRECT = Skill(
    "planning",
    "correct",
    _correct,
    timeout_s=10.0,
    requires="the grip's node is held where its tool is, and the shape is seen since the last correction",
    ensures="a correction is within the limits, reachable, and expected to bring the shape nearer to the goal",
)
SET_STRATEGY = Skill("planning", "set_strategy", _set_strategy, timeout_s=5.0)
