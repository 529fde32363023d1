"""The command sets what libraries read when they are loaded."""

import os

import pytest

from dlokit.app.environment import prepare_environment


def test_a_command_draws_without_the_backend_of_the_notebook_that_starts_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MUJOCO_GL", "PYOPENGL_PLATFORM"):
        monkeypatch.setenv(name, os.environ.get(name, "egl"))
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    prepare_environment()
    assert os.environ["MPLBACKEND"] == "agg"
