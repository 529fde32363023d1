"""What a call of the library prints while it runs."""

import builtins
import sys
from io import StringIO

import pytest

from dlokit.app.console import progress_console


class ZMQInteractiveShell:
    """The name by which a notebook is known."""


def test_a_notebook_shows_one_line_that_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(builtins, "get_ipython", ZMQInteractiveShell, raising=False)
    monkeypatch.setenv("FORCE_COLOR", "1")  # as kernels do
    shown = StringIO()
    monkeypatch.setattr(sys, "stdout", shown)
    console = progress_console(True)
    console.print("action 1: pick-and-place\naction 2: pick-and-place")
    console.print("[bold]converged[/]")
    console.print()
    assert shown.getvalue() == "\raction 2: pick-and-place\rconverged" + " " * len(" pick-and-place")
    progress_console(False).print("nothing")
    assert "nothing" not in shown.getvalue()


def test_elsewhere_each_line_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    progress_console(True).print("action 1\naction 2")
    assert capsys.readouterr().out == "action 1\naction 2\n"
