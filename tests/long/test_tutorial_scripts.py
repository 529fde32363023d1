"""The scripts of the pages on Python run as they stand, in their order, and print and leave what the pages say.

`test_python_api_page.py` shows that the same functions run inside an event loop.
"""

import re
import sys
from pathlib import Path

from page_code import blocks, run_script


def test_the_scripts_of_the_tutorial_run_in_their_order(tmp_path: Path) -> None:
    shape, _, track, _, planner = (
        run_script(sys.executable, script, tmp_path) for script in blocks("docs/tutorials/python.md")
    )
    assert "converged" in shape
    healths = [float(health) for health in re.findall(r"health (\S+),", track)]
    assert len(healths) == 20
    assert min(healths) > 0.9
    assert planner.count("converged") > 5
    assert (tmp_path / "run.png").is_file()
    assert (tmp_path / "recording.png").is_file()


def test_the_page_about_the_benchmark_runs(tmp_path: Path) -> None:
    script = "\n".join(blocks("docs/how-to/benchmark-your-method.md"))
    assert "converged" in run_script(sys.executable, script, tmp_path)
