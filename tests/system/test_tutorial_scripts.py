"""The scripts of the tutorial: as short as promised, and they run, also inside a running event loop."""

import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)

MOST_LINES = {"shape": 10, "clouds": 8, "track": 8, "open": 6, "planner": 40}
"""Lines of code that each script may have; comments, blank lines and docstrings do not count."""

IN_A_LOOP = """
import asyncio

async def notebook():
{}

asyncio.run(notebook())
"""


def scripts(page: str) -> list[str]:
    return BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))


def run(script: str, folder: Path) -> str:
    (folder / "script.py").write_text(script, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_scripts_are_as_short_as_promised() -> None:
    for (name, most), script in zip(MOST_LINES.items(), scripts("tutorials/python.md"), strict=True):
        lines = [line for line in script.splitlines() if line.strip() and not line.strip().startswith(("#", '"""'))]
        assert len(lines) <= most, name


@pytest.mark.long
@pytest.mark.parametrize("where", ["script", "loop"])
def test_the_scripts_run_in_their_order(where: str, tmp_path: Path) -> None:
    printed: dict[str, str] = {}
    for name, script in zip(MOST_LINES, scripts("tutorials/python.md"), strict=True):
        whole = script if where == "script" else IN_A_LOOP.format(textwrap.indent(script, "    "))
        printed[name] = run(whole, tmp_path)
    assert "converged" in printed["shape"]
    healths = [float(health) for health in re.findall(r"health (\S+),", printed["track"])]
    assert len(healths) == 20
    assert min(healths) > 0.9
    assert printed["planner"].count("converged") > 5
    assert (tmp_path / "run.png").is_file()
    assert (tmp_path / "recording.png").is_file()


@pytest.mark.long
def test_the_page_about_the_benchmark_runs(tmp_path: Path) -> None:
    assert "converged" in run("\n".join(scripts("how-to/benchmark-your-method.md")), tmp_path)
