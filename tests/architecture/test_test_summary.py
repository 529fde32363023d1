"""`make test` ends with one sum: every failure has its line, and a part that left nothing counts as failed."""

import subprocess
import sys
from pathlib import Path

import pytest
import summary

TESTS = """
def test_good(): pass

def test_bad(): assert 1 == 2, "one is not two"

def test_not_here():
    import pytest
    pytest.skip("no hardware")
"""


def test_failures_have_a_line_each_and_parts_are_added_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "test_one.py").write_text(TESTS)
    for part in ("first", "second"):
        command = [sys.executable, "-m", "pytest", "-q", f"--junitxml={part}.xml"]
        subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=60, check=False)
    assert summary.main(tmp_path, ["first", "second"]) == 1
    lines = capsys.readouterr().out.strip().splitlines()
    assert lines[:-1] == ["FAILED test_one.py::test_bad - AssertionError: one is not two"] * 2
    assert lines[-1] == "2 passed, 2 failed, 2 skipped"


def test_a_part_that_left_no_results_has_failed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert summary.main(tmp_path, ["live"]) == 1
    assert "FAILED live: it left no results" in capsys.readouterr().out
