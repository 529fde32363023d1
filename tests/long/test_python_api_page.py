"""Every example of the page on the Python API runs as it stands, in their order."""

import asyncio
from pathlib import Path

import pytest
from page_code import blocks

import dlokit


def test_every_example_runs_where_an_event_loop_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # As in a notebook. Other tests run scripts: those of the tutorial, the README and the library.
    monkeypatch.chdir(tmp_path)
    examples = blocks("docs/reference/python-api.md")
    names: dict[str, object] = {}

    async def inside_a_running_loop() -> None:
        for example in examples:
            exec(compile(example, "python-api.md", "exec"), names)

    asyncio.run(inside_a_running_loop())
    assert len(examples) >= 6
    assert (tmp_path / "run.png").exists()
    assert (tmp_path / "recording.png").exists()
    assert isinstance(names["run"], dlokit.Run)
    assert "converged" in capsys.readouterr().out
