"""A push in the flow chart: closed fingers that hold nothing."""

import numpy as np
import pytest
from ideal_lab import I, lab, shape

from dlokit.decision.config import TaskConfig
from dlokit.description.shapes import moved
from dlokit.geometry.polylines import rmse_m
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig

PUSHES = PlanningConfig(
    strategy=RolloutConfig(
        search=SearchConfig(rollouts=70, finalists=2, generations=1),
        pick_place=False,
        drag=False,
        lay_down=False,
        push=True,
    )
)
"""A planner that can do nothing but push."""


def test_a_push_descends_with_closed_fingers_and_is_observed_afterwards() -> None:
    pushed, goal = lab(I), moved(I, (0.03, 0.0))
    trace = shape(pushed, goal, TaskConfig(max_actions=1), planning=PUSHES)
    assert {("grasp", "beside", "push"), ("push", "done", "release")} <= trace.edges()
    assert "grasp" not in trace.calls
    (record,) = trace.result.history
    assert (record.kind, record.grasp_ok, record.slipped) == ("push", False, False)
    assert np.linalg.norm(pushed.nodes - I, axis=1).max() > 0.005
    # Not that it is nearer to the goal: which push so short a search finds depends on the processor's rounding, and the
    # lab's rope has no friction. On some it comes to 34 mm where 16 were predicted.
    assert record.rmse_m == pytest.approx(rmse_m(pushed.nodes, goal), abs=0.01)
    assert trace.calls[-1] == "look"


@pytest.mark.parametrize(
    ("reason", "edge"),
    [
        ("unreachable", ("push", "refused", "release")),
        ("lost_commander", ("push", "interrupted", "recover")),
        ("fault", ("push", "failed", "failed")),
    ],
)
def test_a_push_that_the_arm_refuses_ends_by_name(reason: str, edge: tuple[str, str, str]) -> None:
    broken = lab(I)
    broken.fails = {"follow_path": [reason]}
    assert edge in shape(broken, moved(I, (0.03, 0.0)), TaskConfig(max_actions=1), planning=PUSHES).edges()
