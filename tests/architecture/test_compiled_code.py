"""Compiled functions call none of another file: Numba's cache looks at the outer function's file only.

The code of an inner function is compiled into the outer one. After a change of the inner one's file alone, Numba would
load the outer function as it was compiled before.
"""

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

import dlokit

SOURCE = Path(dlokit.__file__).parent
COMPILED = sorted(path for path in SOURCE.rglob("*.py") if "numba import" in path.read_text(encoding="utf-8"))


def calls_into_other_files(module: ModuleType) -> list[str]:
    """The compiled functions of other files that those of a module call, each with its caller."""
    found = list[str]()
    for caller in _compiled(module):
        function = caller.py_func
        names = function.__code__.co_names
        called = [function.__globals__.get(name) for name in names]
        called += [getattr(one, name, None) for one in called if isinstance(one, ModuleType) for name in names]
        found += [
            f"{function.__name__} calls {one.__name__} of {one.__module__}"
            for one in called
            if isinstance(one, Dispatcher) and one.__module__ != module.__name__
        ]
    return found


def _compiled(module: ModuleType) -> list[Any]:
    return [one for one in vars(module).values() if isinstance(one, Dispatcher) and one.__module__ == module.__name__]


@pytest.mark.parametrize("path", COMPILED, ids=lambda path: path.stem)
def test_compiled_functions_that_call_one_another_are_in_one_file(path: Path) -> None:
    module = importlib.import_module(".".join(path.relative_to(SOURCE.parent).with_suffix("").parts))
    assert _compiled(module)
    assert not calls_into_other_files(module), "move them into one file, or the cached code may be out of date"


@pytest.mark.parametrize("taken", ["from inner import inner", "import inner as i"])
def test_a_call_into_another_file_is_found(taken: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    head, call = "from numba import njit\n", "inner" if taken.startswith("from") else "i.inner"
    (tmp_path / "inner.py").write_text(head + "@njit\ndef inner(x): return x\n")
    (tmp_path / "outer.py").write_text(f"{head}{taken}\n@njit\ndef outer(x): return {call}(x)\n")
    monkeypatch.syspath_prepend(tmp_path)
    outer = importlib.import_module("outer")
    for name in ("inner", "outer"):
        monkeypatch.delitem(sys.modules, name)
    assert calls_into_other_files(outer) == ["outer calls inner of inner"]
