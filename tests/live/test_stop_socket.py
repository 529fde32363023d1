"""The stop socket of a robot's process: each order is executed and answered, also one that came before the process."""

import asyncio
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from dlokit.errors import SkillFailure
from dlokit.system.processes.first_press import STOP
from dlokit.system.processes.stop_socket import (
    CONFIRMED_STOP,
    ENABLE,
    Answer,
    caller_of,
    press,
    process_named,
    stop_at_start_file,
    stop_button,
    stop_socket,
)

HANGS_S = 60.0
"""It takes milliseconds; only a failing test waits this long."""


class Arm:
    def __init__(self) -> None:
        self.orders: list[str] = []
        self.callers: list[str] = []

    async def stop(self, caller: Callable[[], str]) -> None:
        self.orders.append("stop")
        self.callers.append(caller())

    async def enable(self) -> None:
        self.orders.append("enable")


def test_an_order_is_executed_and_its_answer_is_confirmed(tmp_path: Path) -> None:
    async def body() -> None:
        arm, socket = Arm(), stop_socket(tmp_path, "")
        async with stop_button(socket, arm.stop, arm.enable):
            assert await press(socket, STOP, HANGS_S) == Answer(confirmed=True, text=CONFIRMED_STOP)
            assert await press(socket, ENABLE, HANGS_S) == Answer(confirmed=True, text="is enabled")
        assert arm.orders == ["stop", "enable"]
        (caller,) = arm.callers
        assert caller.startswith(f"process {os.getpid()} (")

    asyncio.run(body())


def test_a_stop_that_feedback_does_not_confirm_is_not_confirmed(tmp_path: Path) -> None:
    async def fail(caller: object = None) -> None:
        raise SkillFailure("not_confirmed", "no feedback")

    async def body() -> None:
        socket = stop_socket(tmp_path, "")
        async with stop_button(socket, fail, fail):
            for order in (STOP, ENABLE, b"dance\n"):
                answer = await press(socket, order, HANGS_S)
                assert answer is not None
                assert not answer.confirmed
        assert await press(socket, STOP, HANGS_S) is None

    asyncio.run(body())


def test_an_arm_that_hangs_is_not_confirmed_within_the_time(tmp_path: Path) -> None:
    async def hang(caller: object = None) -> None:
        await asyncio.Event().wait()

    async def body() -> None:
        socket = stop_socket(tmp_path, "")
        async with stop_button(socket, hang, hang):
            answer = await press(socket, STOP, 0.1)
        assert answer is None or not answer.confirmed  # None: on a busy machine there was no connection in time

    asyncio.run(body())


def test_a_stop_before_the_start_is_executed_at_the_start_and_again_by_who_waits_for_it(tmp_path: Path) -> None:
    async def body() -> None:
        arm, socket = Arm(), stop_socket(tmp_path, "")
        stop_at_start_file(socket).touch(mode=0o600)
        stopping = asyncio.create_task(press(socket, STOP, HANGS_S, starts=True))
        await asyncio.sleep(0.0)  # it has found nobody
        async with stop_button(socket, arm.stop, arm.enable):
            assert arm.orders[0] == "stop"
            assert await stopping == Answer(confirmed=True, text=CONFIRMED_STOP)
            await press(socket, ENABLE, HANGS_S)
            assert not stop_at_start_file(socket).exists()  # a restarted process does not start stopped
        assert arm.orders == ["stop", "stop", "enable"]

    asyncio.run(body())


def test_a_robot_that_does_not_start_in_time_has_no_answer(tmp_path: Path) -> None:
    assert asyncio.run(press(stop_socket(tmp_path, ""), STOP, 0.1, starts=True)) is None


def test_a_process_is_named_by_its_number_and_command_without_control_characters() -> None:
    command = (sys.executable, "-c", "input(1)", "\x1b[31mred")
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.read(1) == b"1"  # it runs
        named = process_named(process.pid)
        process.kill()
    program = Path(sys.executable).name
    assert named == f"process {process.pid} ({program} -c input(1)  [31mred)"
    assert process_named(process.pid) == f"process {process.pid}"  # it has ended
    assert process_named(0) == "a process of another container"


def test_a_caller_that_has_closed_the_connection_is_another_process() -> None:
    mine, theirs = socket.socketpair()
    assert caller_of(mine).startswith(f"process {os.getpid()} (")
    mine.close()
    theirs.close()
    assert caller_of(mine) == "another process"
