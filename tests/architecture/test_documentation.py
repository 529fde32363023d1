"""The commands, links and files on the pages exist."""

import asyncio
import re
import shlex
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dlokit.app.commands import parse
from dlokit.extras.bench.commands.shaping import ShapingArgs
from dlokit.extras.bench.shaping.suites import SUITE_NAMES
from dlokit.extras.checks.checks import findings
from dlokit.extras.checks.segmentations import SEGMENTATION_CHECKS
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.config import OURS, to_spec
from dlokit.skills.planning.actions import ActionConfig
from dlokit.skills.planning.base import PlanningTools, StrategyConfig
from dlokit.types.action import Marks
from dlokit.types.dlo import DloState, GoalShape
from dlokit.types.observation import Observation

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
EXAMPLES = sorted((ROOT / "examples").rglob("*.md"))
LINK = re.compile(r"\]\(([^)#]+?)(?:#[^)]*)?\)")
CODE = re.compile(r"```.*?```", re.DOTALL)
NEW_FILES = ("add-a-kind-of-action.md", "add-an-observer.md")
"""Pages that name a file to be written."""
SOURCE = re.compile(r"`((?:src|tests|examples)/[\w./-]+)`")


def page_id(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def commands() -> list[str]:
    """Every `dlokit …` line in a fence of shell commands, without its comment."""
    fences = [fence for page in PAGES for fence in re.findall(r"```sh\n(.*?)```", page.read_text("utf-8"), re.DOTALL)]
    lines = [line.split("  #")[0].strip() for fence in fences for line in fence.splitlines()]
    # The files of a reader's lab do not exist here.
    asks = {line for line in lines if line.startswith("dlokit ")}
    return sorted(line for line in asks if "--config" not in line and "lab.toml" not in line)


@pytest.mark.parametrize("page", [*PAGES, *EXAMPLES], ids=page_id)
def test_every_link_has_a_target(page: Path) -> None:
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    links = [link for link in LINK.findall(text) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", [page for page in PAGES if page.name not in NEW_FILES], ids=page_id)
def test_every_source_file_that_a_page_names_exists(page: Path) -> None:
    named = [name for name in SOURCE.findall(page.read_text(encoding="utf-8")) if "<" not in name]
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize("command", commands())
def test_every_command_is_one_that_dlokit_understands(command: str) -> None:
    settings = parse(shlex.split(command)[1:])
    if isinstance(settings, ShapingArgs):  # its sweep knows the suites, not the command line
        assert settings.suite[0] in SUITE_NAMES


def test_no_page_installs_dlokit_by_its_name() -> None:
    """No package index has dlokit: in a clone, `pip install '.[all]'` works."""
    by_name = re.compile(r"pip install '?dlokit\b")
    scripts = [path for folder in ("benchmarks", "examples") for path in (ROOT / folder).rglob("*.*")]
    files = [path for path in scripts if path.suffix in (".py", ".toml", ".md")]
    pages = [page for page in (*PAGES, *files) if page.name != "CHANGELOG.md"]
    assert [page_id(page) for page in pages if by_name.search(page.read_text(encoding="utf-8"))] == []


def test_commands_are_found_in_the_pages() -> None:
    assert len(commands()) > 8


def module_of(page: str, room: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module that a how-to page asks the reader to write."""
    text = (ROOT / "docs" / "how-to" / page).read_text(encoding="utf-8")
    ((name, code),) = re.findall(
        rf"`(?:src/dlokit/skills/{room}|my_package)/(\w+)\.py`:\n\n```python\n(.*?)```", text, re.DOTALL
    )
    module = ModuleType(f"dlokit.skills.{room}.{name}")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(code, f"{name}.py", "exec"), vars(module))
    return module


def test_the_planner_of_the_how_to_works_as_written(monkeypatch: pytest.MonkeyPatch) -> None:
    # `test_added_by_packages.py` compares add-a-planner.md with the package.
    monkeypatch.syspath_prepend(ROOT / "examples" / "planner_package" / "src")
    settings: StrategyConfig = import_module("dlokit_along.planner").AlongConfig()
    strategy = settings.build(PlanningTools(reachable=lambda pose: True, actions=ActionConfig()))
    nodes = np.column_stack([np.full(11, 0.5), np.linspace(-0.25, 0.25, 11), np.full(11, 0.004)])
    shape = DloState(stamp_ns=0, nodes_world=nodes, topology=chain(11, 0.5))
    goal = GoalShape(stamp_ns=0, nodes_world=nodes + np.array([0.05, 0.0, 0.0]))

    async def grasped() -> list[int]:
        marks = Marks(invalid_nodes=np.array([3]))
        return [action.grasp.node async for action in strategy.propose(shape, goal, marks)]

    assert sorted(asyncio.run(grasped())) == [0, 1, 2, 4, 5, 6, 7, 8, 9, 10]


def test_the_observer_of_the_how_to_works_as_written(monkeypatch: pytest.MonkeyPatch) -> None:
    settings: ObserverStrategyConfig = module_of("add-an-observer.md", "observer", monkeypatch).NearestConfig()
    assert to_spec(settings).name == "nearest"
    nodes = np.column_stack([np.full(11, 0.5), np.linspace(-0.25, 0.25, 11), np.full(11, 0.004)])
    seen = Observation(stamp_ns=1, points_world=(nodes + np.array([0.02, 0.0, 0.0])).astype(np.float32))
    prior = DloState(stamp_ns=0, nodes_world=nodes, topology=chain(11, 0.5))
    targets = settings.build(BelievedDlo()).estimate(seen, prior)
    # Each node has one point 2 cm beside it; its neighbours' points, 5 cm along, are outside the radius.
    np.testing.assert_allclose(targets.nodes_world, seen.points_world, atol=1e-6)
    assert targets.visible.all()


def test_the_segmentation_of_the_how_to_keeps_to_its_protocol(monkeypatch: pytest.MonkeyPatch) -> None:
    # The docstrings of its settings, which a check reads, need a file.
    module = module_of("add-a-segmentation.md", "perception", monkeypatch)
    failed = {finding.check for finding in findings(SEGMENTATION_CHECKS, lambda: module.OtsuConfig().build())}
    assert failed == set()


def test_the_map_of_the_paper_has_every_built_in_observer() -> None:
    page = (ROOT / "docs" / "paper_map.md").read_text(encoding="utf-8")
    modules = [type(config().build(BelievedDlo())).__module__ for config in OURS]
    files = [f"{module.removeprefix('dlokit.').replace('.', '/')}.py" for module in modules]
    assert [file for file in files if f"`{file}`" not in page] == []
