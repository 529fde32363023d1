"""The tools of a planner, as add-a-planner.md lists and uses them."""

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_code import blocks

from dlokit.communication.wire.codec import encode
from dlokit.errors import BadValue
from dlokit.skills.observer.anchored import chain
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import PlanningTools
from dlokit.skills.planning.own import PlannerTools
from dlokit.types.action import Action, Marks
from dlokit.types.dlo import DloState, GoalShape

PAGE = "docs/how-to/add-a-planner.md"
TEXT = (Path(__file__).parents[2] / PAGE).read_text(encoding="utf-8")
TABLES = re.findall(r"\| `tools\.` \|.*?\n\n", TEXT, re.DOTALL)
TOOLS = PlanningTools(reachable=lambda pose: True, actions=ActionConfig())
NODES = np.column_stack([np.full(31, 0.5), np.linspace(-0.25, 0.25, 31), np.full(31, 0.004)])
SHAPE = DloState(stamp_ns=0, nodes_world=NODES, topology=chain(31, 0.5))
GOAL = GoalShape(stamp_ns=0, nodes_world=NODES + np.array([0.1, 0.0, 0.0]))


def listed(table: str) -> dict[str, str]:
    """The signatures of a table by their names."""
    signatures = re.findall(r"^\| `(?:await )?([^`]+)` \|", table, re.MULTILINE)[1:]
    return {signature.partition("(")[0]: signature for signature in signatures}


def test_the_page_lists_every_tool_of_an_object_with_its_signature() -> None:
    of_class = {name: member for name, member in vars(PlannerTools).items() if not name.startswith("_")}
    signatures = {
        name: name
        if isinstance(member, property)
        else f"{name}({', '.join([*inspect.signature(member).parameters][1:])})"
        for name, member in of_class.items()
    }
    assert listed(TABLES[0]) == signatures


def test_the_page_lists_every_tool_of_a_strategy() -> None:
    properties = {name for name, member in vars(PlanningTools).items() if isinstance(member, property)}
    assert set(listed(TABLES[1])) == {field.name for field in fields(PlanningTools)} | properties


def proposed(planner: Any) -> list[Action]:
    marks = Marks(invalid_nodes=np.array([3]))
    actions: Iterator[Action] = planner.propose(SHAPE, GOAL, marks, PlannerTools(TOOLS))
    return list(actions)


def test_the_planner_of_the_page_goes_part_of_the_way() -> None:
    names: dict[str, Any] = {}
    exec(compile(blocks(PAGE)[-1], PAGE, "exec"), names)
    actions = proposed(names["PartOfTheWay"]())
    assert {action.grasp.node for action in actions} == set(range(31)) - {3}
    for action in actions:
        moved_m = action.path[-1].position_m - action.grasp.T_world_tcp.position_m
        np.testing.assert_allclose(moved_m[:2], [0.08, 0.0], atol=1e-9)


def test_a_goal_as_an_array_is_as_good_as_the_goal_itself() -> None:
    tools = PlannerTools(TOOLS)
    by_array, by_goal = (tools.pick_and_place(SHAPE, goal, 5) for goal in (GOAL.nodes_world, GOAL))
    assert encode(by_array) == encode(by_goal)


@pytest.mark.parametrize("goal", [NODES[:5], NODES[:, :2], NODES * np.nan, "S"], ids=["short", "flat", "nan", "text"])
def test_another_array_is_refused_by_one_clear_error(goal: Any) -> None:
    with pytest.raises(BadValue, match="the goal of pick_and_place"):
        PlannerTools(TOOLS).pick_and_place(SHAPE, goal, 5)
