"""The scripts of the tutorial: as short as promised, and they run inside a running event loop.

`test_distribution.py` runs them as they stand, in the environment of a newcomer.
"""

import sys
import textwrap
from pathlib import Path

from tutorial_scripts import MOST_LINES, check_tutorial, run, scripts

IN_A_LOOP = """
import asyncio

async def notebook():
{}

asyncio.run(notebook())
"""


def test_the_scripts_are_as_short_as_promised() -> None:
    for (name, most), script in zip(MOST_LINES.items(), scripts("tutorials/python.md"), strict=True):
        lines = [line for line in script.splitlines() if line.strip() and not line.strip().startswith(("#", '"""'))]
        assert len(lines) <= most, name


def test_the_scripts_run_in_their_order_inside_an_event_loop(tmp_path: Path) -> None:
    # Of the bench, `unit/app/library/test_comparing.py` shows that it runs inside an event loop.
    check_tutorial(
        sys.executable, tmp_path, lambda script: IN_A_LOOP.format(textwrap.indent(script, "    ")), bench=False
    )


def test_the_page_about_the_benchmark_runs(tmp_path: Path) -> None:
    assert "converged" in run(sys.executable, "\n".join(scripts("how-to/benchmark-your-method.md")), tmp_path)
