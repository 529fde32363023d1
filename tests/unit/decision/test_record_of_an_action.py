"""The record of an action has its errors to the goal and to what was predicted, and why it ended."""

import numpy as np
import pytest

from dlokit.decision.attempt import ActionAttempt, record_of
from dlokit.decision.records import ActionRecord
from dlokit.geometry import downward
from dlokit.types.action import Drag, Grasp, VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape, Topology

NODES = np.column_stack((np.linspace(0.3, 0.8, 31), np.zeros(31), np.full(31, 0.004)))
SIDE = np.array([0.0, 0.01, 0.0])


def record(predicted: Float64Array | None, *, ended_by: str = "", control_end: str = "") -> ActionRecord:
    pose = downward([0.5, 0.0, 0.01], 0.0)
    grasp = Grasp(node=3, T_world_tcp=pose)
    action = Drag(stamp_ns=0, grasp=grasp, path=(pose,), velocity=VelocityProfile(), predicted_nodes_world=predicted)
    attempt = ActionAttempt(
        action=action,
        before_world=NODES,
        began_ns=0,
        chosen_ns=1_000_000_000,
        tool_travelled_m=0.0,
        planning_time_s=0.5,
        ended_by=ended_by,
        control_end=control_end,
    )
    after = DloState(
        stamp_ns=0,
        nodes_world=NODES + SIDE,
        topology=Topology(edges=np.zeros((0, 2), dtype=np.int64), rest_lengths_m=np.zeros(0)),
    )
    goal = GoalShape(stamp_ns=0, nodes_world=NODES, name="I")
    return record_of(attempt, 1, after, goal, now_ns=9_000_000_000, robot_time_s=8.0, path_m=0.4)


def test_its_errors_are_those_to_the_goal_and_to_the_prediction() -> None:
    done = record(NODES + 3.0 * SIDE)
    assert done.rmse_m == pytest.approx(0.01)
    assert done.predicted_rmse_m == pytest.approx(0.03)
    assert done.prediction_error_m == pytest.approx(0.02)
    assert done.duration_s == 9.0


def test_without_a_prediction_it_has_no_error_of_one() -> None:
    done = record(None)
    assert (done.predicted_rmse_m, done.prediction_error_m) == (None, None)


@pytest.mark.parametrize(("noted", "kept"), [("", None), ("lease_lost", "lease_lost")])
def test_a_planned_end_has_no_reason(noted: str, kept: str | None) -> None:
    done = record(None, ended_by=noted, control_end=noted)
    assert (done.ended_by, done.control_end) == (kept, kept)
