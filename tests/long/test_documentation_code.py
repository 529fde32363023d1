"""The Python blocks of pages that run tasks, with what stands around them; `architecture/test_documented_code.py` runs
the short ones."""

import sys
from pathlib import Path

import pytest
from page_code import completed, run_script

FRAGMENTS = {
    "docs/how-to/learn-in-an-environment.md": "{0}\n{1}\n{2}\n{3}\n{4}",
    "docs/reference/commands.md": (
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
    assert outcome.result.points > 100

virtual_time.run(call())
{1}
"""
    ),
}
"""Pages, and scripts in which each block stands at its number."""


@pytest.mark.parametrize("page", FRAGMENTS)
def test_the_blocks_of_a_page_run(page: str, tmp_path: Path) -> None:
    run_script(sys.executable, completed(FRAGMENTS[page], page), tmp_path)
