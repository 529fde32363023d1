"""What all tests share."""

import os
import signal
import sys
from pathlib import Path

import pytest

from dlokit.app.environment import keep_to_one_thread

keep_to_one_thread()  # before any test imports NumPy, as in the command line

# MuJoCo reads this once, when it is first imported; without a display only EGL can render.
if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")

# A shell lets what runs in the background of a script ignore Ctrl-C; the tests of Ctrl-C mean it.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the groups in this hook, too
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Live systems first and one at a time: they mostly wait, and leave the other processors to the other tests."""
    for item in items:
        if item.get_closest_marker("live"):
            item.add_marker(pytest.mark.xdist_group("live"))
    items.sort(key=lambda item: item.get_closest_marker("live") is None)


@pytest.fixture(scope="session")
def simulated_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short recorded run in the simulated cell; its tests are one group, so that it is made once."""
    from dlokit.app.commands import execute

    folder = tmp_path_factory.mktemp("simulated") / "short-run"
    assert (
        execute(["shape", "--headless", "--no-check-camera", "--goal", "S", "--seed", "3", "--out", str(folder)]) == 0
    )
    return folder
