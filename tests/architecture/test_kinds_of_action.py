"""The table of the kinds of action is the only place that knows them by name: all else reads their facts."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest

import dlokit
from dlokit.types.action import KINDS, Action

SOURCE = Path(dlokit.__file__).parent
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


def modules() -> dict[str, ast.Module]:
    return {
        path.relative_to(SOURCE).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for path in SOURCE.rglob("*.py")
    }


def _named(*nodes: ast.AST) -> bool:
    names = (name for node in nodes for name in ast.walk(node))
    return any(
        (isinstance(name, ast.Name) and name.id in CLASSES)
        or (isinstance(name, ast.Attribute) and name.attr in CLASSES)
        for name in names
    )


def switches(tree: ast.AST) -> Iterator[int]:
    """Lines that decide by the class of an action: isinstance, match, comparisons, dictionaries with a key a kind."""
    for node in ast.walk(tree):
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


def literals(tree: ast.AST) -> Iterator[int]:
    """Lines with the name of a kind as a literal."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and node.value in KINDS:
            yield node.lineno


def test_every_kind_has_its_row() -> None:
    assert list(KINDS) == [str(kind.__struct_config__.tag) for kind in get_args(Action)]
    assert all(facts.does and facts.usual_error_m > 0.0 for facts in KINDS.values())


def test_only_modules_that_propose_actions_name_their_classes() -> None:
    named = {place for place, tree in modules().items() if _named(tree)}
    assert named - {TABLE} == PROPOSE


def test_nothing_switches_on_the_class_of_an_action() -> None:
    found = [f"{place}:{line}" for place, tree in modules().items() for line in switches(tree)]
    assert found == []


def test_nothing_compares_with_the_name_of_a_kind() -> None:
    found = [f"{place}:{line}" for place, tree in modules().items() for line in literals(tree)]
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
    assert list(switches(ast.parse(code)))


@pytest.mark.parametrize("code", ['row.kind == "push"', '{"lay-down": 1}', 'match kind:\n    case "pair": pass'])
def test_a_switch_on_names_is_found(code: str) -> None:
    assert list(literals(ast.parse(code)))
