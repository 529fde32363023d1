"""A system is assembled in one place, and what is chosen by name is listed in one."""

import ast
import inspect

import pytest

import dlokit
from dlokit.app.shape.shape import ShapeArgs
from dlokit.communication.container import Container
from dlokit.system.request import Choices

pytestmark = pytest.mark.xdist_group("source_nodes")

ASSEMBLED_IN = {
    "system/build.py",  # every run, and every part of one
    "recording/component_replay.py",  # one component, in a layer below
    "extras/hosts/agent.py",  # of no run: it waits for runs
}


def test_containers_are_made_where_systems_are_assembled_and_in_two_other_places(
    source_nodes: dict[str, tuple[ast.AST, ...]],
) -> None:
    found = {
        place
        for place, nodes in source_nodes.items()
        for node in nodes
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == Container.__name__
    }
    assert found == ASSEMBLED_IN


def test_the_functions_of_the_library_take_the_one_list_of_choices() -> None:
    for function in (dlokit.shape, dlokit.live, dlokit.judge):
        parameters = inspect.signature(function).parameters
        assert not set(parameters) & set(Choices.__annotations__), function.__name__
        assert "Choices" in str(parameters["choices"].annotation), function.__name__


def test_the_command_line_takes_the_one_list_of_choices() -> None:
    assert "Choices" in str(ShapeArgs.__annotations__["choices"])
