"""Messages of a first run during compilation, and the commands that the demo suggests."""

import io
import shlex
from collections.abc import Callable
from typing import Any

import numba
import pytest
from rich.console import Console

from dlokit.app.commands import parse
from dlokit.app.console import compile_progress
from dlokit.app.shape.demo import NEXT
from dlokit.description.arm.mounts import WorkspaceBox
from dlokit.description.installation import Installation, InstalledArm
from dlokit.errors import ConfigError, MachineError
from dlokit.system.config import RunConfig
from dlokit.system.configuration import preflight
from dlokit.system.configuration.installation_checks import check_installation

COMPILE: Any = numba.njit  # the type stub has only decorators


def said_while(work: Callable[[], object]) -> list[str]:
    printed = io.StringIO()
    with compile_progress(Console(file=printed, width=200), "the observer"):
        work()
    return printed.getvalue().splitlines()


def test_compiling_is_announced_once_and_counted() -> None:
    inner: Any = COMPILE(lambda value: value + 1)
    outer: Any = COMPILE(lambda value: inner(value) * 2)
    begun, done = said_while(lambda: outer(1))
    assert "compiling" in begun
    assert "2 functions" in done


def test_compiled_code_is_not_announced() -> None:
    kernel: Any = COMPILE(lambda value: value + 1)
    kernel(1)
    assert said_while(lambda: kernel(2)) == []


def test_the_demo_names_three_commands_that_dlokit_understands() -> None:
    assert len(NEXT) == 3
    for command in NEXT:
        parse(shlex.split(command)[1:])


DEEP = WorkspaceBox(lower_m=(-1.0, -1.0, -1.0))


@pytest.mark.parametrize(
    ("arm", "named"),
    [
        (InstalledArm(position_m=(0.0, 0.0, -0.8)), "outside its workspace"),
        (
            InstalledArm(position_m=(0.0, 0.0, -0.8), workspace=DEEP),
            "above the table",
        ),
    ],
)
def test_an_arm_that_could_not_stand_at_home_is_refused_before_the_start(arm: InstalledArm, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        check_installation(RunConfig(installation=Installation(arms=(arm,))))


def test_a_live_run_is_refused_before_its_start_where_no_memory_is_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse() -> None:
        raise MachineError("/dev/shm cannot be written")

    monkeypatch.setattr(preflight, "check_shared_memory", refuse)
    with pytest.raises(MachineError, match="/dev/shm cannot be written"):
        preflight.check_before_start(RunConfig(runtime="live", headless=True))
    preflight.check_before_start(RunConfig(headless=True))  # lockstep is one process
