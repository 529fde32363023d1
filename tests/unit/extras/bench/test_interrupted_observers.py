"""A comparison of observers that is interrupted reports what is finished, and says so by its exit code."""

from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest

from dlokit.errors import EXIT_INTERRUPTED
from dlokit.extras.bench.commands import observers
from dlokit.extras.bench.commands.observers import ObserversArgs, run_observers


def interrupted(*_: object) -> Generator[Any]:
    yield from ()
    raise KeyboardInterrupt


def not_measured(_: Callable[[], object]) -> tuple[()]:
    return ()


def test_it_ends_with_130(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    # Both would start processes.
    monkeypatch.setattr(observers, "run_in_workers", interrupted)
    monkeypatch.setattr(observers, "in_a_worker", not_measured)
    assert run_observers(ObserversArgs(quick=True, methods="map", out=tmp_path / "out")) == EXIT_INTERRUPTED
    assert "interrupted: 0 of" in capsys.readouterr().out
