"""One action while it is executed, and which grasps are not to be tried again."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dlokit.decision.convergence import error_m
from dlokit.decision.records import ActionRecord, CorrectionRecord
from dlokit.geometry import rmse_m
from dlokit.types.action import Action, Correction, Marks, kind_of
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.message import Value

SLIPPED = "slipped"
"""The name of a slip as the end of an action."""


@dataclass(kw_only=True)
class ActionAttempt:
    """One action, from its choice to the look after the release; a new value for each action."""

    action: Action
    before_world: Float64Array  # (M, 3) [m]
    """The shape that it was chosen for."""
    began_ns: int
    """When the choice began [ns]."""
    chosen_ns: int
    """When it ended [ns]."""
    tool_travelled_m: float
    """Distance that the tools had travelled by then [m]."""
    planning_time_s: float
    """Duration of the choice on the machine's clock [s]."""
    controlled: bool = False
    """Whether control follows the action."""
    control_end: str = ""
    """Why control ended or did not begin, as in `ActionRecord`."""
    under_way: bool = False
    """Whether the arms execute the action: from their first motion to the look after it."""
    grasp_ok: bool = False
    carrying: bool = False
    """Whether the carry has begun and not ended: an interrupted one may go on."""
    pushed: bool = False
    """Whether closed fingers have pushed the DLO."""
    ended_by: str = ""
    """What ended the action before its planned end, as in `ActionRecord`; the first cause is kept."""
    corrections: list[Correction] = field(default_factory=list[Correction])
    corrections_seen: list[CorrectionRecord] = field(default_factory=list[CorrectionRecord])
    deadlock: bool = False
    """Whether control ended in a deadlock."""
    release_stamp_ns: int | None = None
    """When the fingers opened [ns]; None: not yet."""

    @property
    def slipped(self) -> bool:
        """Whether the DLO slipped out of the gripper."""
        return self.ended_by == SLIPPED

    def ends_early(self, reason: str) -> None:
        """Note what ended the action before its planned end."""
        self.ended_by = self.ended_by or reason

    def goes_on(self) -> None:
        """Note that what seemed to end the action was an interruption."""
        self.ended_by = ""

    @property
    def expected_world(self) -> Float64Array:
        """The shape (M, 3) [m] to expect after the action: the predicted one, or the one before it."""
        predicted = self.corrections[-1].predicted_world if self.corrections else self.action.predicted_nodes_world
        moved = self.pushed or (self.grasp_ok and not self.slipped)
        return predicted if moved and predicted is not None else self.before_world


def record_of(
    attempt: ActionAttempt,
    number: int,
    after: DloState,
    goal: GoalShape,
    *,
    now_ns: int,
    robot_time_s: float,
    path_m: float,
) -> ActionRecord:
    """The record of an action: the shape after it, seen at `now_ns`, and its errors to the goal.

    `robot_time_s` is the time from its choice until the arms were out of the picture [s], `path_m` the distance that
    the tools travelled [m].
    """
    action, predicted = attempt.action, attempt.action.predicted_nodes_world
    return ActionRecord(
        action=number,
        kind=kind_of(action),
        grasp_node=action.grasp.node,
        grasp_ok=attempt.grasp_ok,
        slipped=attempt.slipped,
        rmse_m=error_m(after.nodes_world, goal),
        predicted_rmse_m=None if predicted is None else error_m(predicted, goal),
        prediction_error_m=None if predicted is None else rmse_m(after.nodes_world, predicted),
        duration_s=(now_ns - attempt.began_ns) / 1e9,
        robot_time_s=robot_time_s,
        path_length_m=path_m,
        planning_time_s=attempt.planning_time_s,
        release_stamp_ns=attempt.release_stamp_ns,
        nodes_world=after.nodes_world,
        expected_world=predicted,
        path_world=np.array([pose.position_m for pose in (action.grasp.T_world_tcp, *action.path)]),
        corrections=tuple(attempt.corrections_seen),
        control_end=attempt.control_end or None,
        ended_by=attempt.ended_by or None,
    )


class MarkedGrasp(Value, frozen=True, kw_only=True, eq=False):
    """A grasp that changed nothing, and the shape from which it was tried."""

    node: int
    nodes_world: Float64Array  # (M, 3) [m]


_SLIPS_ENOUGH = 2


@dataclass(kw_only=True)
class GraspMemory:
    """Nodes that are not to be grasped: those that failed from a shape like the present one, and slippery ones."""

    marks: list[MarkedGrasp] = field(default_factory=list[MarkedGrasp])
    slips: dict[int, int] = field(default_factory=dict[int, int])
    """Grasp node → number of times that the DLO slipped out of the fingers there."""

    def mark(self, nodes: Sequence[int], nodes_world: Float64Array) -> None:
        """Mark grasps at these nodes that changed nothing from the shape (M, 3) [m]."""
        self.marks += [MarkedGrasp(node=node, nodes_world=nodes_world) for node in nodes]

    def clear(self, nodes_world: Float64Array, alike_m: float) -> None:
        """Keep the marks whose shape is nearer than `alike_m` (RMSE) [m] to the present one (M, 3) [m]; 0: none."""
        self.marks = [mark for mark in self.marks if rmse_m(mark.nodes_world, nodes_world) < alike_m]

    def slipped(self, node: int) -> None:
        """Note that the DLO slipped out of the fingers at a node."""
        self.slips[node] = self.slips.get(node, 0) + 1

    def invalid(self) -> Marks:
        """The marked nodes, and those at which the DLO slipped out twice."""
        slippery = {node for node, times in self.slips.items() if times >= _SLIPS_ENOUGH}
        return Marks(invalid_nodes=np.array(sorted({mark.node for mark in self.marks} | slippery), dtype=np.int64))
