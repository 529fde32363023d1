"""The model's skills."""

from dlokit.communication.skill import Skill
from dlokit.types.action import Action
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief, DloState, GoalShape
from dlokit.types.flow import GoalFrame
from dlokit.types.passing import SideWish


def _reset(nodes_world: Float64Array | None = None) -> None:
    """Put the model at a curve (K, 3) [m], or, without one, at the targets that come next. Rejects: bad_shape."""
    ...


def _set_goal(
    nodes_world: Float64Array,
    name: str = "goal",
    ends_interchangeable: bool = False,
    beside: tuple[SideWish, ...] | None = None,
) -> GoalShape:
    """Take a curve (K, 3) [m] as the goal, resampled to the model's M nodes, and publish it. Rejects: bad_shape.

    `beside` says how the DLO is to pass posts; None: as configured.
    """
    ...


def _build_goal(frames: tuple[GoalFrame, ...]) -> GoalShape:
    """Drag the goal rod by frames until it rests, and publish the goal. Rejects: bad_frames."""
    ...


def _predict(action: Action, state: DloState) -> DloState:
    """The shape that an action would leave, with the model's friction and stiffness. Rejects: bad_shape."""
    ...


def _settle(nodes_world: Float64Array) -> Float64Array:
    """Where a rod released as a curve (K, 3) [m] comes to rest under friction, (M, 3) [m]. Rejects: bad_shape."""
    ...


def _learn(before_world: Float64Array, after_world: Float64Array) -> DloBelief:
    """Learn from the last grasp-to-release: the shapes (M, 3) [m] at rest before and after it; publishes the belief.

    Rejects: bad_shape. Fails with: nothing_held (no grip has ended since the last time, or the DLO was lost
    meanwhile), nothing_moved (nothing can be learnt from an action that moved nothing).
    """
    ...


RESET = Skill("model", "reset", _reset, timeout_s=5.0, ensures="the next state is at the nodes, or at the next targets")
SET_GOAL = Skill("model", "set_goal", _set_goal, timeout_s=5.0, ensures="the goal is published")
BUILD_GOAL = Skill(
    "model", "build_goal", _build_goal, timeout_s=10.0, ensures="the goal obeys the rod; it is published"
)
PREDICT = Skill("model", "predict", _predict, timeout_s=20.0)
SETTLE = Skill("model", "settle", _settle, timeout_s=20.0)
LEARN = Skill(
    "model",
    "learn",
    _learn,
    timeout_s=60.0,
    requires="the held node was reported from the grasp to the release",
    ensures="the belief is published, and all later predictions use it",
)
