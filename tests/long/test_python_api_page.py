"""Every example of the page on the Python API runs as it stands, in their order."""

import asyncio
import re
from pathlib import Path

import pytest

import dlokit

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "python-api.md"


def test_every_example_runs_where_an_event_loop_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # As in a notebook. Other tests run scripts: those of the tutorial, the README and the library.
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}

    async def inside_a_running_loop() -> None:
        for block in blocks:
            exec(compile(block, str(PAGE), "exec"), names)

    asyncio.run(inside_a_running_loop())
    assert len(blocks) >= 6
    assert (tmp_path / "run.png").exists()
    assert (tmp_path / "recording.png").exists()
    assert isinstance(names["run"], dlokit.Run)
    assert "converged" in capsys.readouterr().out


def test_every_public_name_has_an_example() -> None:
    examples = "".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))
    assert [name for name in dlokit.__all__ if f"dlokit.{name}" not in examples] == []


def test_every_public_name_has_its_signature_on_the_site() -> None:
    page = (PAGE.parent / "api.md").read_text(encoding="utf-8")
    names = [f"dlokit.{name}" for name in dlokit.__all__ if name not in ("__version__", "bench")]
    names += [f"dlokit.bench.{name}" for name in dlokit.bench.__all__ if name != "Choice"]
    assert sorted(re.findall(r"^::: (dlokit\.(?!testing)\S+)$", page, re.MULTILINE)) == sorted(names)
