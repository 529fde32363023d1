"""What the pages tell people to type, to open and to copy is there."""

import re
import shlex
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dlokit.app.commands import parse
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.strategies import OURS, to_spec
from dlokit.types.dlo import DloState
from dlokit.types.observation import Observation

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
LINK = re.compile(r"\]\(([^)#]+?)(?:#[^)]*)?\)")
CODE = re.compile(r"```.*?```", re.DOTALL)
SOURCE = re.compile(r"`((?:src|tests|examples)/[\w./-]+)`")


def page_id(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def commands() -> list[str]:
    """Every `dlokit …` line in a fence of shell commands, without its comment."""
    fences = [fence for page in PAGES for fence in re.findall(r"```sh\n(.*?)```", page.read_text("utf-8"), re.DOTALL)]
    lines = [line.split("  #")[0].strip() for fence in fences for line in fence.splitlines()]
    return sorted({line for line in lines if line.startswith("dlokit ") and "--config" not in line})


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_link_leads_somewhere(page: Path) -> None:
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    links = [link for link in LINK.findall(text) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "add-an-observer.md"], ids=page_id)
def test_every_source_file_that_a_page_names_exists(page: Path) -> None:
    named = [name for name in SOURCE.findall(page.read_text(encoding="utf-8")) if "<" not in name]
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("command", commands())
def test_every_command_is_one_that_dlokit_understands(command: str) -> None:
    parse(shlex.split(command)[1:])


def test_commands_are_found_in_the_pages() -> None:
    assert len(commands()) > 8


def test_the_observer_of_the_how_to_works_as_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / "how-to" / "add-an-observer.md").read_text(encoding="utf-8")
    files = re.findall(r"`src/dlokit/skills/observer/(\w+)\.py`:\n\n```python\n(.*?)```", page, re.DOTALL)
    modules = [ModuleType(f"dlokit.skills.observer.{name}") for name, _ in files]
    for module, (name, code) in zip(modules, files, strict=True):
        monkeypatch.setitem(sys.modules, module.__name__, module)
        exec(compile(code, f"{name}.py", "exec"), vars(module))
    settings: ObserverStrategyConfig = modules[0].NearestConfig()
    assert to_spec(settings).name == "nearest"
    nodes = np.column_stack([np.full(11, 0.5), np.linspace(-0.25, 0.25, 11), np.full(11, 0.004)])
    seen = Observation(stamp_ns=1, points_world=(nodes + np.array([0.02, 0.0, 0.0])).astype(np.float32))
    prior = DloState(stamp_ns=0, nodes_world=nodes, topology=chain(11, 0.5))
    targets = settings.build(BelievedDlo()).estimate(seen, prior)
    # Each node has one point 2 cm beside it; its neighbours' points, 5 cm along, are out of the radius.
    np.testing.assert_allclose(targets.nodes_world, seen.points_world, atol=1e-6)
    assert targets.visible.all()


def test_the_map_of_the_paper_has_every_observer_of_ours() -> None:
    page = (ROOT / "docs" / "paper_map.md").read_text(encoding="utf-8")
    modules = [type(config().build(BelievedDlo())).__module__ for config in OURS]
    files = [f"{module.removeprefix('dlokit.').replace('.', '/')}.py" for module in modules]
    assert [file for file in files if f"`{file}`" not in page] == []
