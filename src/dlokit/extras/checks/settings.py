"""The requirements on the settings of every strategy."""

import ast
import dataclasses
import inspect
import pickle
import re
import textwrap
from collections.abc import Iterator
from typing import Any

from dlokit.communication.strategies import StrategyKind
from dlokit.extras.checks.checks import Check
from dlokit.system.configuration.toml_config import KIND, from_toml, to_toml

NO_ENTRY_POINTS = "dlokit.testing"
"""A group without entry points, so that a strategy is checked before it is installed."""


def settings_checks(purpose: str, taken: dict[str, type[Any]]) -> tuple[Check[type[Any]], ...]:
    """The requirements of a configuration class; `taken` are the installed ones by their names."""

    def free(config: type[Any]) -> Iterator[str]:
        owner = taken.get(getattr(config, "name", ""))
        if owner is not None and (owner.__module__, owner.__qualname__) != (config.__module__, config.__qualname__):
            yield f"the name {config.name!r} is taken by {owner.__module__}:{owner.__qualname__}"

    def travels(config: type[Any]) -> Iterator[str]:
        yield from _pickled(config)
        kind: StrategyKind[Any] = StrategyKind(purpose, NO_ENTRY_POINTS, (config,))
        settings = config()
        if kind.from_spec(kind.to_spec(settings)) != settings:
            yield "settings that were sent are not those that arrive"
        if from_toml(to_toml(settings), config, "its own TOML") != settings:
            yield "settings that were written to TOML are not those that are read"

    return (
        Check(name="frozen dataclass", wanted="a class with @dataclass(frozen=True)", run=_frozen),
        Check(
            name="name",
            wanted='a class variable, name: ClassVar[str] = "…", of small letters, digits, - and _',
            run=_named,
        ),
        Check(name="free name", wanted="a name that no other installed strategy has; choose another", run=free),
        Check(
            name="defaults",
            wanted="every setting has a default, so that the class can be built without arguments",
            run=_defaults,
        ),
        Check(
            name="documented",
            wanted="a docstring for the class and a docstring under every setting: they are the --help",
            run=_documented,
        ),
        Check(
            name="travels",
            wanted="settings of plain values (numbers, text, tuples, dataclasses of these) that are equal after a "
            f"journey as JSON, TOML and pickle; none is called {KIND!r}",
            run=travels,
        ),
    )


def _frozen(config: type[Any]) -> Iterator[str]:
    if not dataclasses.is_dataclass(config):
        yield f"{config.__name__} is no dataclass"
    elif not config.__dataclass_params__.frozen:  # pyright: ignore[reportAttributeAccessIssue]  # set by dataclass
        yield f"{config.__name__} is not frozen"


def _named(config: type[Any]) -> Iterator[str]:
    name = getattr(config, "name", None)
    if "name" in {field.name for field in _fields(config)}:
        yield "name is a setting, so that it could differ from one instance to the next"
    elif not isinstance(name, str):
        yield f"name is {name!r}"
    elif not re.fullmatch(r"[a-z][a-z0-9_-]*", name):
        yield f"name is {name!r}, which a command line cannot list"


def _defaults(config: type[Any]) -> Iterator[str]:
    for field in _fields(config):
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            yield f"{field.name} has no default"


def _documented(config: type[Any]) -> Iterator[str]:
    # A dataclass without a docstring is given one by Python, which begins with its signature.
    if not config.__doc__ or config.__doc__.startswith(f"{config.__name__}("):
        yield f"{config.__name__} has no docstring"
    try:
        source = textwrap.dedent(inspect.getsource(config))
    except (OSError, TypeError):
        return  # a class typed into an interpreter has no source to look into
    (body,) = (node.body for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    for node, below in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        said = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        if node.target.id in {field.name for field in _fields(config)} and not said:
            yield f"{node.target.id} has no docstring under it"


def _pickled(config: type[Any]) -> Iterator[str]:
    if KIND in {field.name for field in _fields(config)}:
        yield f"a setting is called {KIND!r}, which in config.toml says which strategy it is"
    if pickle.loads(pickle.dumps(config())) != config():
        yield "settings that went to a worker process are not those that arrive"


def _fields(config: type[Any]) -> tuple[dataclasses.Field[Any], ...]:
    return dataclasses.fields(config) if dataclasses.is_dataclass(config) else ()
