"""The source files of the package, as several tests of the architecture read them."""

import ast
from pathlib import Path

import pytest

import dlokit

SOURCE = Path(dlokit.__file__).parent


@pytest.fixture(scope="package")
def source_nodes() -> dict[str, tuple[ast.AST, ...]]:
    """All nodes of the syntax tree of each source file, by the file's path below the package."""
    return {
        path.relative_to(SOURCE).as_posix(): tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        for path in SOURCE.rglob("*.py")
    }
