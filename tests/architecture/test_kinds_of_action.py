"""The table of the kinds of action is the only place that knows them by name: all else reads their facts."""

import ast
from collections.abc import Iterable, Iterator
from typing import get_args

import pytest

from dlokit.types.action import KINDS, Action

pytestmark = pytest.mark.xdist_group("source_nodes")

TABLE = "types/action.py"
CLASSES = {kind.__name__ for kind in get_args(Action)}

PROPOSE = {
    "skills/planning/pick_place.py",
    "skills/planning/rollout/carrying.py",
    "skills/planning/rollout/laying.py",
    "skills/planning/rollout/pushing.py",
    "skills/planning/rollout/pairing.py",
    "extras/gym/grasp_actions.py",
}
"""Modules that make actions, and therefore name their classes."""
STEP_OF_THE_CHART = "decision/shape_flow.py"
"""Names its step `push` as a kind is named."""


def names_a_class(nodes: Iterable[ast.AST]) -> bool:
    return any(
        (isinstance(node, ast.Name) and node.id in CLASSES)
        or (isinstance(node, ast.Attribute) and node.attr in CLASSES)
        for node in nodes
    )


def _named(*trees: ast.AST) -> bool:
    return names_a_class(node for tree in trees for node in ast.walk(tree))


def switches(nodes: Iterable[ast.AST]) -> Iterator[int]:
    """Lines that decide by the class of an action: isinstance, match, comparisons, dictionaries with a key a kind."""
    for node in nodes:
        match node:
            case ast.Call(func=ast.Name(id="isinstance" | "issubclass"), args=args) if _named(*args):
                yield node.lineno
            case ast.Compare() if _named(node.left, *node.comparators):
                yield node.lineno
            case ast.MatchClass(cls=cls) if _named(cls):
                yield cls.lineno
            case ast.Dict(keys=keys) if _named(*(key for key in keys if key is not None)):
                yield node.lineno
            case _:
                pass


def literals(nodes: Iterable[ast.AST]) -> Iterator[int]:
    """Lines with the name of a kind as a literal."""
    for node in nodes:
        if isinstance(node, ast.Constant) and node.value in KINDS:
            yield node.lineno


def test_every_kind_has_its_row() -> None:
    assert list(KINDS) == [str(kind.__struct_config__.tag) for kind in get_args(Action)]
    assert all(facts.does and facts.usual_error_m > 0.0 for facts in KINDS.values())


def test_only_modules_that_propose_actions_name_their_classes(source_nodes: dict[str, tuple[ast.AST, ...]]) -> None:
    named = {place for place, nodes in source_nodes.items() if names_a_class(nodes)}
    assert named - {TABLE} == PROPOSE


def test_nothing_switches_on_the_class_of_an_action(source_nodes: dict[str, tuple[ast.AST, ...]]) -> None:
    found = [f"{place}:{line}" for place, nodes in source_nodes.items() for line in switches(nodes)]
    assert found == []


def test_nothing_compares_with_the_name_of_a_kind(source_nodes: dict[str, tuple[ast.AST, ...]]) -> None:
    found = [f"{place}:{line}" for place, nodes in source_nodes.items() for line in literals(nodes)]
    assert [line for line in found if not line.startswith((TABLE, STEP_OF_THE_CHART))] == []


@pytest.mark.parametrize(
    "code",
    [
        "isinstance(action, Push)",
        "isinstance(action, Drag | Push)",
        "issubclass(kind, action.PairPlace)",
        "kind is LayDown",
        "type(action) in (Drag, Push)",
        "errors = {Drag: 0.1}",
        "match action:\n    case Push(): pass",
    ],
)
def test_a_switch_on_classes_is_found(code: str) -> None:
    assert list(switches(ast.walk(ast.parse(code))))


@pytest.mark.parametrize("code", ['row.kind == "push"', '{"lay-down": 1}', 'match kind:\n    case "pair": pass'])
def test_a_switch_on_names_is_found(code: str) -> None:
    assert list(literals(ast.walk(ast.parse(code))))
