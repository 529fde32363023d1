"""The scripts of the tutorial on Python: run in their order, they print and leave what it says."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
MOST_LINES = {"shape": 10, "clouds": 8, "track": 8, "open": 6, "planner": 40}
"""Lines of code that each script may have; comments, blank lines and docstrings do not count."""


def scripts(page: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)


def check_tutorial(python: str, folder: Path, changed: Callable[[str], str] = str, *, bench: bool = True) -> None:
    """Run the scripts of the tutorial in a folder, each `changed`; assert what they print and save.

    The last one, a bench of ten runs, is left out without `bench`.
    """
    printed = {
        name: run(python, changed(script), folder)
        for name, script in zip(MOST_LINES, scripts("tutorials/python.md"), strict=True)
        if bench or name != "planner"
    }
    assert "converged" in printed["shape"]
    healths = [float(health) for health in re.findall(r"health (\S+),", printed["track"])]
    assert len(healths) == 20
    assert min(healths) > 0.9
    assert not bench or printed["planner"].count("converged") > 5
    assert (folder / "run.png").is_file()
    assert (folder / "recording.png").is_file()


def run(python: str, script: str, folder: Path) -> str:
    """Run a script in a folder; returns what it printed."""
    (folder / "script.py").write_text(script, encoding="utf-8")
    done = subprocess.run([python, "script.py"], cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
