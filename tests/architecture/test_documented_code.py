"""Every Python block of the pages runs: the short ones here, with what stands around them."""

import re
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest
from page_code import BLOCK, ROOT, blocks, completed

import dlokit

FRAGMENTS = {
    "docs/how-to/add-a-topic.md": (
        """
from dlokit.communication.topic import Topic
from dlokit.communication.topics import LAST
from dlokit.types.message import Message

{0}
{1}
assert STRETCH.type is Stretch
"""
    ),
    "docs/how-to/add-a-break-condition.md": (
        """
from types import SimpleNamespace as Fake

class Progress:
    OUT_OF_PATH = "out_of_path"

def decide(so_far, config, best):
{0:indented}
history = [Fake(path_length_m=60.0), Fake(path_length_m=50.0)]
decided = decide(Fake(history=history), Fake(max_path_m=100.0), "best")
assert decided == ("out_of_path", "the tool travelled 100 m; best")
"""
    ),
    "docs/how-to/add-a-figure-of-an-action.md": (
        """
from types import SimpleNamespace as Fake

from dlokit.app.shape.outcome_text import ActionColumn, millimetres
from dlokit.decision.records import ActionFigures

class WithHeight(ActionFigures, frozen=True, kw_only=True):
{0:indented}

def record_of(action):
{1:indented}
    return dict(highest_m=highest_m)

{2}
path = [Fake(position_m=(0.0, 0.0, height_m)) for height_m in (0.01, 0.2, 0.01)]
assert record_of(Fake(path=path)) == {"highest_m": 0.2}
assert HEIGHT.text(Fake(highest_m=0.2)) == "200.0 mm"
"""
    ),
    "docs/how-to/calibrate-a-camera.md": (
        """
from pathlib import Path
from dlokit.description.default_cameras import default_calibration
from dlokit.functional.cameras.calibration_file import write_calibration

write_calibration(Path("calibration.toml"), default_calibration())
{0}
"""
    ),
    "docs/how-to/record-and-replay.md": "{0}",
    "docs/reference/recording.md": "{0}",
}
"""Pages with fragments, and scripts in which each fragment stands at its number."""

ELSEWHERE = {
    "docs/how-to/add-a-command.md": "architecture/test_added_by_packages.py",
    "docs/how-to/add-a-component.md": "architecture/test_added_by_packages.py",
    "docs/how-to/add-a-kind-of-action.md": "paper/test_added_kind_of_action.py",
    "docs/how-to/add-a-planner.md": "architecture/test_added_by_packages.py",
    "docs/how-to/add-an-observer.md": "architecture/test_documentation.py",
    "docs/how-to/add-a-segmentation.md": "architecture/test_documentation.py",
    "docs/how-to/learn-in-an-environment.md": "long/test_documentation_code.py",
    "docs/reference/commands.md": "long/test_documentation_code.py",
    "docs/reference/python-api.md": "long/test_python_api_page.py",
    "docs/tutorials/python.md": "long/test_tutorial_scripts.py",
    "docs/how-to/benchmark-your-method.md": "long/test_tutorial_scripts.py",
}
"""Pages whose blocks another test runs."""
MOST_LINES = {"shape": 10, "clouds": 8, "track": 8, "open": 6, "planner": 40}
"""Lines of code that each script of the tutorial may have; comments, blank lines and docstrings do not count."""


def test_the_code_of_every_page_runs_somewhere() -> None:
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "benchmarks").rglob("*.md")]
    with_code = {page.relative_to(ROOT).as_posix() for page in pages if BLOCK.search(page.read_text(encoding="utf-8"))}
    assert with_code == {*FRAGMENTS, *ELSEWHERE}
    for page, test in ELSEWHERE.items():
        assert Path(page).name in (ROOT / "tests" / test).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", FRAGMENTS)
def test_the_blocks_of_a_page_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recordings = ROOT / "tests" / "replay" / "references"
    for place in ("runs/some-run/recording.mcap", "tests/replay/references/wire.mcap"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(recordings / "wire.mcap", tmp_path / place)
    monkeypatch.chdir(tmp_path)
    module = ModuleType("page_script")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(completed(FRAGMENTS[page], page), page, "exec"), vars(module))


def test_the_scripts_of_the_tutorial_are_as_short_as_promised() -> None:
    for (name, most), script in zip(MOST_LINES.items(), blocks("docs/tutorials/python.md"), strict=True):
        lines = [line for line in script.splitlines() if line.strip() and not line.strip().startswith(("#", '"""'))]
        assert len(lines) <= most, name


def test_every_public_name_has_an_example() -> None:
    examples = "".join(blocks("docs/reference/python-api.md"))
    assert [name for name in dlokit.__all__ if f"dlokit.{name}" not in examples] == []


def test_every_public_name_has_its_signature_on_the_site() -> None:
    page = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    names = [f"dlokit.{name}" for name in dlokit.__all__ if name not in ("__version__", "bench")]
    names += [f"dlokit.bench.{name}" for name in dlokit.bench.__all__ if name != "Choice"]
    assert sorted(re.findall(r"^::: (dlokit\.(?!testing|skills)\S+)$", page, re.MULTILINE)) == sorted(names)
    assert set(re.findall(r"^::: dlokit\.skills\S+\.(\w+)$", page, re.MULTILINE)) == {"PlannerTools", "PlanningTools"}


def test_there_is_an_example_for_each_skill_of_the_paper_and_one_of_a_larger_task() -> None:
    numbered = sorted((ROOT / "examples").glob("[0-9]*.py"))
    assert [path.name[:2] for path in numbered] == [f"{number:02d}" for number in range(1, 10)]
