"""The status of a run and of the link, with a level and its reason."""

from typing import Any

import msgspec
import pytest
from made_states import ARM_AT_REST
from ros_views import STOPPED, flow

from dlokit.extras.ros2.link.frames import Endpoint, Graph
from dlokit.extras.ros2.published import outgoing
from dlokit.extras.ros2.published.diagnostics import Level, LinkFacts, link_diagnosis, run_diagnosis
from dlokit.extras.ros2.published.outgoing import PUBLISHED, Published
from dlokit.types.flow import RunOutcome, RunPhase, RunStatus, TaskEnd
from dlokit.types.robot import RobotMode


def values(status: Any) -> dict[str, str]:
    return {one.key: one.value for one in status.values}


def test_a_process_that_starts_after_the_task_knows_its_end() -> None:
    end = TaskEnd(
        number=1,
        goal="S",
        outcome=RunOutcome.STALLED,
        text="no better\nshape",
        actions=4,
        rmse_m=0.02,
        threshold_m=0.01,
    )
    found = run_diagnosis(run=RunStatus(stamp_ns=0, phase=RunPhase.WAITING, last=end))
    assert (found.level, found.text) == (Level.WARN, "stalled: no better shape")
    assert dict(found.values)["outcome"] == "stalled"
    assert dict(found.values)["action"] == "4"


BROKEN = msgspec.structs.replace(ARM_AT_REST, mode=RobotMode.FAULT)


@pytest.mark.parametrize(
    ("known", "level", "text"),
    [
        ({}, Level.OK, "no task has begun"),
        ({"flow": flow("grasp", rmse_m=0.05)}, Level.OK, "grasp, 0 actions, RMSE 50.0 mm"),
        ({"flow": flow("converged", actions=1, outcome=RunOutcome.CONVERGED)}, Level.OK, "converged after 1 action"),
        ({"flow": flow("stalled", outcome=RunOutcome.STALLED, text="why")}, Level.WARN, "stalled: why"),
        ({"flow": flow("failed", outcome=RunOutcome.FAILED, text="why")}, Level.ERROR, "failed: why"),
        ({"flow": flow("grasp"), "lost": True}, Level.WARN, "the observer has lost the DLO"),
        (
            {"run": RunStatus(stamp_ns=0, phase=RunPhase.ASKING, asks="move")},
            Level.OK,
            "waits until the operator allows",
        ),
        ({"run": RunStatus(stamp_ns=0, phase=RunPhase.WAITING)}, Level.OK, "waiting"),
        ({"robots": (BROKEN,)}, Level.ERROR, "arm first has stopped itself and must recover"),
        ({"robots": (STOPPED,), "flow": flow("grasp")}, Level.ERROR, "stopped by a person: arm first"),
    ],
)
def test_the_level_of_the_status_has_its_reason(known: dict[str, Any], level: Level, text: str) -> None:
    found = run_diagnosis(**known)
    assert found.level is level
    assert found.text.startswith(text)


def reader(row: Published, **changes: Any) -> Endpoint:
    same = Endpoint(node="/rviz", type=row.kind, reliable=True, transient_local=row.transient_local)
    return msgspec.structs.replace(same, **changes)


@pytest.mark.parametrize(
    ("row", "changes", "level", "said"),
    [
        (outgoing.DLO, {}, Level.OK, ""),
        (outgoing.DLO, {"reliable": False}, Level.OK, "may lose messages: it asks for reliability best effort"),
        (outgoing.DLO, {"transient_local": True}, Level.WARN, "gets nothing: it asks for durability transient local"),
        (outgoing.GOAL, {"transient_local": False}, Level.OK, "gets no message before the next"),
        (outgoing.GOAL, {"type": "nav_msgs/msg/Odometry"}, Level.WARN, "gets nothing: it reads nav_msgs/msg/Odometry"),
    ],
)
def test_a_reader_that_asks_for_something_else_is_named(
    row: Published, changes: dict[str, Any], level: Level, said: str
) -> None:
    graph = Graph(topics={}, publishers={}, subscriptions={row.topic: [reader(row, **changes)]})
    found = link_diagnosis(LinkFacts(graph=graph), PUBLISHED)
    assert found.level is level
    named = dict(found.values).get(f"reader /rviz on {outgoing.absolute(row.topic)}", "")
    assert named.startswith(said)
    assert bool(named) == bool(said)


def test_dropped_messages_and_topics_that_the_node_lacks_are_a_warning() -> None:
    found = link_diagnosis(LinkFacts(dropped=3, clock_offset_ns=-2_000_000, lacks={"~/goal": "no nav_msgs"}), PUBLISHED)
    assert found.level is Level.WARN
    assert "3 messages were dropped" in found.text
    assert "~/goal: no nav_msgs" in found.text
    assert dict(found.values)["clock offset s"] == "-0.002000"
