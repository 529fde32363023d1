"""`dlokit stop` as a process: what it presses before it imports anything large, and what it says afterwards."""

import asyncio
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from buses import new_bus

from dlokit.description.arm.mounts import INSTANCES
from dlokit.errors import EXIT_BAD_INPUT
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.system.processes.running import announced
from dlokit.system.processes.runtime_folder import RUNTIME_DIR
from dlokit.system.processes.stop_socket import stop_button, stop_socket
from parts.stops.first_press import FORBIDDEN, measured_press

HANGS_S = 60.0


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for sockets that this process and the commands have in common."""
    folder = Path(tempfile.mkdtemp(dir=os.environ[RUNTIME_DIR]))
    monkeypatch.setenv(RUNTIME_DIR, str(folder))
    return folder


def stopped(sockets: Sequence[Path], *arguments: str) -> tuple[int, str, list[Path]]:
    """Exit code and output of `dlokit stop` while robot processes serve the sockets, and the sockets it pressed."""
    pressed, callers = list[Path](), list[str]()

    async def body() -> tuple[int, str]:
        async with asyncio.timeout(HANGS_S), asyncio.TaskGroup() as group:
            ended = asyncio.Event()
            for path in sockets:
                group.create_task(serve(path, ended))
            while not all(path.exists() for path in sockets):  # noqa: ASYNC110  a file wakes nobody
                await asyncio.sleep(0.01)
            command = (sys.executable, "-m", "dlokit", "stop", *arguments)
            process = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            output, _ = await process.communicate()
            ended.set()
        assert process.returncode is not None
        return process.returncode, output.decode()

    async def serve(path: Path, ended: asyncio.Event) -> None:
        async def stop(caller: Callable[[], str]) -> None:
            pressed.append(path)
            callers.append(caller())

        async def enable() -> None: ...

        async with stop_button(path, stop, enable):
            await ended.wait()

    code, output = asyncio.run(body())
    assert all(re.fullmatch(r"process \d+ \(python.* stop.*\)", caller) for caller in callers), callers
    return code, output, pressed


@pytest.mark.smoke
def test_nothing_large_is_imported_before_the_press() -> None:
    press = measured_press()
    assert press.received == b"stop\n"
    assert sorted(FORBIDDEN & set(press.modules)) == []
    assert not {name for name in press.modules if name.startswith("dlokit.app.") and name != "dlokit.app.main"}


def test_a_stop_presses_the_sockets_of_all_runs_and_one_with_run_those_of_this_run(
    folder: Path, tmp_path: Path
) -> None:
    mine = [stop_socket(tmp_path / "mine", instance) for instance in INSTANCES]
    other = stop_socket(tmp_path / "other", "")
    for line in (["--run", str(tmp_path / "mine")], [f"--run={tmp_path / 'mine'}"]):
        code, output, pressed = stopped([*mine, other], *line)
        assert sorted(pressed) == mine
        assert code == 0
        assert output.count("arm of a run without a decision process is at rest") == 2
    code, output, pressed = stopped([*mine, other])
    assert sorted(pressed) == sorted([*mine, other])
    assert code == 0
    assert output.count("arm of a run without a decision process is at rest") == 3


@pytest.mark.parametrize("arguments", [["--help"], ["--rum", "x"], ["now"], ["--run"]])
def test_a_line_that_asks_for_something_else_presses_nothing(
    arguments: list[str], folder: Path, tmp_path: Path
) -> None:
    code, output, pressed = stopped([stop_socket(tmp_path, "")], *arguments)
    assert pressed == []
    assert code == (0 if arguments == ["--help"] else EXIT_BAD_INPUT)
    assert "dlokit stop" in output


@contextmanager
def a_system(run: Path) -> Generator[None]:
    """The note and the configuration of a system without processes, which ends."""
    (run / CONFIG_FILE).write_text(to_toml(RunConfig()), encoding="utf-8")
    with announced(run, new_bus()) as note:
        note.ready()
        note.ending()
        yield


def test_the_answer_to_the_first_press_is_the_arms_line_and_the_arm_is_pressed_once(
    folder: Path, tmp_path: Path
) -> None:
    with a_system(tmp_path):
        code, output, pressed = stopped([socket := stop_socket(tmp_path, "")])
        assert pressed == [socket]
        assert output.splitlines() == [
            f"{tmp_path}: the first arm is at rest",
            f"{tmp_path}: it is ending, and its task has ended",
        ]
        assert code == 0


def test_without_a_system_and_without_an_arm_there_is_nothing_to_stop(folder: Path, tmp_path: Path) -> None:
    assert stopped([]) == (EXIT_BAD_INPUT, "dlokit: you have no running system: there is nothing to stop.\n", [])
    code, output, _ = stopped([], "--run", str(tmp_path))
    assert code == EXIT_BAD_INPUT
    assert "no system runs in" in output
