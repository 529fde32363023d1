"""Vectors of environments in processes of their own."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent / "async_vector_script.py"


@pytest.mark.parametrize("context", ["fork", pytest.param("spawn", marks=pytest.mark.long)])
def test_no_process_outlives_a_killed_worker(context: str) -> None:
    done = subprocess.run(
        [sys.executable, str(SCRIPT), context], capture_output=True, text=True, timeout=280, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "nothing left" in done.stdout
