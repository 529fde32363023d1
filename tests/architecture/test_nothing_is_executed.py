"""No input is executed: no source file unpickles or evaluates data, directly or through a library."""

import ast
from collections.abc import Iterable

import pytest

pytestmark = pytest.mark.xdist_group("source_nodes")

PICKLES = "extras/checks/"
"""It unpickles what it has just pickled itself, to check that it can be sent; nothing imports it."""
MODULES = {"pickle", "_pickle", "cPickle", "marshal", "shelve", "dill", "cloudpickle", "jsonpickle", "code"}
CALLS = {"eval", "exec", "compile", "__import__"}
LOADERS = {("joblib", "load"), ("yaml", "load"), ("torch", "load"), ("pandas", "read_pickle")}


def offences(nodes: Iterable[ast.AST]) -> list[str]:
    return [what for node in nodes for what in _offences_of(node)]


def _offences_of(node: ast.AST) -> list[str]:
    match node:
        case ast.Import():
            return [f"import {name.name}" for name in node.names if name.name.partition(".")[0] in MODULES]
        case ast.ImportFrom(module=str(module)):
            found = [f"from {module}"] if module.partition(".")[0] in MODULES else []
            return found + [f"{module}.{name.name}" for name in node.names if (module, name.name) in LOADERS]
        case ast.Call(func=ast.Name(id=name)) if name in CALLS:
            return [f"{name}()"]
        case ast.Attribute(value=ast.Name(id=module), attr=name) if (module, name) in LOADERS:
            return [f"{module}.{name}"]
        case ast.keyword(arg="allow_pickle", value=value) if not _is_false(value):
            return ["allow_pickle"]
        case _:
            return []


def _is_false(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is False


def test_no_source_file_unpickles_or_evaluates(source_nodes: dict[str, tuple[ast.AST, ...]]) -> None:
    sources = {place: nodes for place, nodes in source_nodes.items() if not place.startswith(PICKLES)}
    assert len(sources) > 200, "the sources are not where they are looked for"
    found = {place: offences(nodes) for place, nodes in sources.items()}
    assert not {name: what for name, what in found.items() if what}


def test_the_search_finds_a_violation() -> None:
    guilty = (
        "import pickle",
        "import os, marshal",
        "from pickle import loads",
        "from joblib import load",
        "joblib.load(path)",
        "eval(text)",
        "def f():\n    return exec(text)",
        "numpy.load(path, allow_pickle=True)",
        "numpy.load(path, allow_pickle=flag)",
    )
    for source in guilty:
        assert offences(ast.walk(ast.parse(source))), source
    innocent = "numpy.load(path, allow_pickle=False); re.compile(text); model.eval()"
    assert not offences(ast.walk(ast.parse(innocent)))
