"""Every numbered example runs as a new user would run it, and saves its picture."""

import subprocess
import sys
from pathlib import Path

import cv2
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
NUMBERED = sorted(EXAMPLES.glob("[0-9]*.py"))


def test_the_example_of_learning_runs_to_its_comparison(tmp_path: Path) -> None:
    arguments = ["--demonstrations", "2", "--seeds", "1"]
    ended = subprocess.run(
        [sys.executable, str(EXAMPLES / "behaviour_cloning.py"), *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "cloned" in ended.stdout
    assert len(list((tmp_path / "demonstrations").glob("*.npz"))) == 2


@pytest.mark.parametrize("script", NUMBERED, ids=lambda path: path.stem)
def test_an_example_runs_and_leaves_its_picture(script: Path, tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, str(script), "--out", str(tmp_path)], capture_output=True, text=True, timeout=300, check=False
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    picture = cv2.imread(str(tmp_path / f"{script.stem}.png"))
    assert picture is not None
    # An empty page of matplotlib is all white: something must be drawn on it.
    assert picture.std() > 5.0
