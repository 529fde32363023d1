"""Every example of the page on the Python API runs as it stands, in their order."""

import re
from pathlib import Path

import pytest

import dlokit

pytestmark = pytest.mark.live  # one example is a live system

PAGE = Path(__file__).parents[4] / "docs" / "reference" / "python-api.md"


def test_every_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    assert len(blocks) >= 6
    assert (tmp_path / "run.png").exists()
    assert (tmp_path / "recording.png").exists()
    assert isinstance(names["run"], dlokit.Run)
    assert "converged" in capsys.readouterr().out


def test_every_public_name_is_on_the_page() -> None:
    text = PAGE.read_text(encoding="utf-8")
    types = {"Identified", "Nodes", "Recording", "Run", "System", "__version__"}  # what the functions return
    assert [name for name in dlokit.__all__ if name not in types and f"dlokit.{name}" not in text] == []
