"""Every Python block of the pages runs: whole scripts in their order, and fragments with what stands around them."""

import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^ *```python\n(.*?)^ *```", re.DOTALL | re.MULTILINE)

FRAGMENTS = {
    "docs/how-to/add-a-component.md": (
        """
from dataclasses import dataclass
from dlokit.communication import topics
from dlokit.communication.component import Component, on
from dlokit.system.table import ComponentRow
from dlokit.types.dlo import DloState

@dataclass(frozen=True, kw_only=True)
class StretchConfig:
    pass

{0}
{1}
assert StretchComponent(StretchConfig()).name == "stretch"
"""
    ),
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
    "docs/how-to/calibrate-a-camera.md": (
        """
from pathlib import Path
from dlokit.description.scene import default_calibration
from dlokit.functional.cameras.calibration_file import write_calibration

write_calibration(Path("calibration.toml"), default_calibration())
{0}
"""
    ),
    "docs/how-to/record-and-replay.md": "{0}",
    "docs/how-to/learn-in-an-environment.md": "{0}\n{1}\n{2}\n{3}\n{4}",
    "docs/reference/recording.md": "{0}",
    "README.md": (
        """
import asyncio
from pathlib import Path
import numpy as np
from dlokit.description.shapes import builtin_shape
from dlokit.skills.perception import api as perception
from dlokit.system.config import RunConfig
from dlokit.system.lockstep import lockstep_system, LockstepSystem
from dlokit.communication.timing import virtual_time

config, folder = RunConfig(record=False), Path("folder")
start_nodes_world = builtin_shape("I", config.cell.dlo.length_m, 100)

async def call():
{0:indented}
    assert len(outcome.result.points_world) > 100

virtual_time.run(call())
{1}
"""
    ),
}
"""Pages with fragments, and scripts in which each fragment stands at its number."""

ELSEWHERE = {
    "docs/how-to/add-a-planner.md": "architecture/test_documentation.py",
    "docs/how-to/add-an-observer.md": "architecture/test_documentation.py",
    "docs/how-to/add-a-segmentation.md": "architecture/test_documentation.py",
    "docs/reference/python-api.md": "long/test_python_api_page.py",
    "docs/tutorials/python.md": "long/test_tutorial_scripts.py",
    "docs/how-to/benchmark-your-method.md": "long/test_tutorial_scripts.py",
}
"""Pages whose blocks another test runs."""


SLOW = ("README.md", "docs/how-to/learn-in-an-environment.md")
"""Pages whose blocks run tasks: half a minute to a minute on idle cores."""


def blocks(page: str) -> list[str]:
    return [textwrap.dedent(block) for block in BLOCK.findall((ROOT / page).read_text(encoding="utf-8"))]


def test_the_code_of_every_page_runs_somewhere() -> None:
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "benchmarks").rglob("*.md")]
    with_code = {page.relative_to(ROOT).as_posix() for page in pages if BLOCK.search(page.read_text(encoding="utf-8"))}
    assert with_code == {*FRAGMENTS, *ELSEWHERE}
    assert [test for test in ELSEWHERE.values() if not (ROOT / "tests" / test).is_file()] == []


@pytest.mark.parametrize("page", [pytest.param(page) if page in SLOW else page for page in FRAGMENTS])
def test_the_blocks_of_a_page_run(page: str, tmp_path: Path) -> None:
    script = FRAGMENTS[page]
    for number, block in enumerate(blocks(page)):
        assert f"{{{number}" in script, "the page has a block that its script does not have"
        script = script.replace(f"{{{number}}}", block).replace(
            f"{{{number}:indented}}", textwrap.indent(block, "    ")
        )
    recordings = ROOT / "tests" / "replay" / "references"
    for place in ("runs/some-run/recording.mcap", "tests/replay/references/wire.mcap"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(recordings / "wire.mcap", tmp_path / place)
    (tmp_path / "script.py").write_text(script, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
