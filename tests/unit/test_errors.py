"""The commands that errors advise."""

import shlex
import sys

import pytest

from dlokit.errors import install_command


def test_an_extra_is_installed_into_the_python_that_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/home/a person/venv/bin/python")
    assert shlex.split(install_command("all")) == [
        "/home/a person/venv/bin/python",
        "-m",
        "pip",
        "install",
        "dlokit[all]",
    ]
