"""The death of a process is noticed and named even if the supervisor's watch or its files fail."""

import asyncio
import errno
import gc
import logging
import math
import os
import resource
import signal
import sys
from collections.abc import Callable, Generator
from pathlib import Path

import pytest

from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.errors import ProcessFailure
from dlokit.system.processes import supervisor as module
from dlokit.system.processes.child_process import EXIT_NO_DEVICE, ChildProcess, ChildSpec, LogFile
from dlokit.system.processes.supervisor import STARTED_WITHIN_S, Launch, Supervisor
from dlokit.system.table import NEVER, ProcessRow, Restart, TimeBase

BEATS = """
import json, os, sys, time
beats = json.loads(sys.stdin.readline())["beat_fd"]
os.write(beats, b"r")
while True:
    time.sleep(0.1)
    os.write(beats, b".")
"""
SILENT = "import time; time.sleep(600)"
pytestmark = pytest.mark.live

NOTICED_WITHIN_S = 60.0
"""A tenth of a second on an idle machine; only a watch that hangs needs this long."""
ONCE = Restart(times=1, window_s=600.0, wait_s=0.05)


@pytest.fixture
def no_more_files() -> Generator[Callable[[], None]]:
    """From the call on, no file can be opened; open files stay open."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    yield lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (3, limits[1]))
    resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def supervisor(
    run_dir: Path, restart: Restart = NEVER, code: str = BEATS, ready_within_s: float = ProcessRow.ready_within_s
) -> Supervisor:
    rows = (ProcessRow(name="lamp", components=(), restart=restart, ready_within_s=ready_within_s),)
    launch = Launch(
        namespace="lamp", config_file=run_dir / "config.toml", run_dir=run_dir, command=(sys.executable, "-Sc", code)
    )
    return Supervisor(rows, launch, lambda name: ZenohConfig(namespace="lamp"))


def kill(running: Supervisor) -> None:
    os.kill(running.pids["lamp"], signal.SIGKILL)


def failure_of(running: Supervisor, what_happens: Callable[[Supervisor], object]) -> ProcessFailure:
    """The notification of the task that waits for the run, after an event."""

    async def main() -> ProcessFailure:
        async with running:
            waiting = asyncio.create_task(running.wait_failed())
            await asyncio.sleep(0.0)
            what_happens(running)
            with pytest.raises(ProcessFailure) as failure:
                async with asyncio.timeout(NOTICED_WITHIN_S):
                    await waiting
            return failure.value

    return asyncio.run(main())


def test_a_death_is_noticed_though_the_folder_of_the_logs_is_missing(tmp_path: Path) -> None:
    def happens(running: Supervisor) -> None:
        (tmp_path / "run").rename(tmp_path / "moved")  # the lamp may just be starting its log
        kill(running)

    failure = failure_of(supervisor(tmp_path / "run"), happens)
    assert failure.reason == "process_died: lamp"
    assert "lamp.log" in failure.detail


@pytest.mark.parametrize(
    ("restart", "reason", "detail"),
    [
        (NEVER, "process_died: lamp", "lamp ended with signal 9"),
        (ONCE, "process_not_started: lamp", os.strerror(errno.EMFILE)),
    ],
)
def test_a_death_is_noticed_though_no_file_can_be_opened(
    tmp_path: Path, no_more_files: Callable[[], None], restart: Restart, reason: str, detail: str
) -> None:
    def happens(running: Supervisor) -> None:
        no_more_files()
        kill(running)

    failure = failure_of(supervisor(tmp_path, restart), happens)
    assert failure.reason == reason
    assert detail in failure.detail


def test_a_device_that_does_not_respond_ends_the_run_with_its_sentence_alone(tmp_path: Path) -> None:
    beats_once = BEATS.partition("while")[0]
    code = f"{beats_once}sys.stderr.write('a detail\\nno lamp at 10.0.0.9; is it on?\\n')\nsys.exit({EXIT_NO_DEVICE})"
    failure = failure_of(supervisor(tmp_path, code=code), lambda running: None)
    assert str(failure) == "process_died: lamp: no lamp at 10.0.0.9; is it on?"


def test_a_process_that_cannot_be_started_at_all_is_a_named_failure(tmp_path: Path) -> None:
    async def main() -> None:
        (tmp_path / "logs").write_text("a file in the place of the folder", encoding="utf-8")
        async with supervisor(tmp_path):
            pass

    with pytest.raises(ProcessFailure, match=r"process_not_started: lamp: .*logs"):
        asyncio.run(main())


def test_a_failed_start_keeps_no_file_open(tmp_path: Path) -> None:
    async def main() -> int:
        (tmp_path / "logs").write_text("a file in the place of the folder", encoding="utf-8")
        gc.collect()  # files of earlier tests are not closed in between
        before = len(os.listdir("/proc/self/fd"))
        for _ in range(3):
            with pytest.raises(ProcessFailure):
                await supervisor(tmp_path).__aenter__()
        return len(os.listdir("/proc/self/fd")) - before

    assert asyncio.run(main()) == 0


class FrozenLoop(asyncio.SelectorEventLoop):
    """A loop whose process was frozen for a while."""

    frozen_s = 0.0

    def time(self) -> float:
        return super().time() + self.frozen_s


def test_a_supervisor_that_was_frozen_itself_takes_no_process_for_frozen(tmp_path: Path) -> None:
    async def main() -> None:
        async with supervisor(tmp_path) as running:
            loop = asyncio.get_running_loop()
            assert isinstance(loop, FrozenLoop)
            await asyncio.sleep(0.0)  # the watch has begun
            loop.frozen_s = 60.0
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.5):
                    await running.wait_failed()

    with asyncio.Runner(loop_factory=FrozenLoop) as runner:
        runner.run(main())


def test_a_process_that_is_silent_while_it_starts_is_a_named_failure(tmp_path: Path) -> None:
    async def main() -> None:
        async with asyncio.timeout(NOTICED_WITHIN_S), supervisor(tmp_path, code=SILENT, ready_within_s=0.2):
            pass

    with pytest.raises(ProcessFailure, match=r"process_not_ready: lamp.*no sign of life for 0.2 s"):
        asyncio.run(main())


def test_a_restarted_process_that_beats_and_is_never_ready_is_given_up(tmp_path: Path) -> None:
    second = tmp_path / "second"
    never_ready = BEATS.replace(
        'os.write(beats, b"r")', f'os.write(beats, b"." if os.path.exists({str(second)!r}) else b"r")'
    )

    once = Restart(times=1, window_s=math.inf, wait_s=0.0)

    async def main() -> None:
        async with supervisor(tmp_path, once, never_ready) as running:
            loop = asyncio.get_running_loop()
            assert isinstance(loop, FrozenLoop)
            second.touch()
            kill(running)
            async with asyncio.timeout(NOTICED_WITHIN_S):
                while running.report().processes[0].restarts == 0:  # noqa: ASYNC110  (nothing tells of a restart)
                    await asyncio.sleep(0.05)
            loop.frozen_s = STARTED_WITHIN_S
            async with asyncio.timeout(NOTICED_WITHIN_S):
                await running.wait_failed()

    with (
        asyncio.Runner(loop_factory=FrozenLoop) as runner,
        pytest.raises(ProcessFailure, match=r"process_not_ready: lamp.*not ready within 900 s"),
    ):
        runner.run(main())


def test_the_group_of_a_process_is_killed_before_its_number_can_be_anyones(tmp_path: Path) -> None:
    killed: list[str] = []

    def kill_group(group: int, number: int) -> None:
        killed.append(Path(f"/proc/{group}/stat").read_text().rpartition(")")[2].split()[0])
        os.killpg(group, number)

    async def main() -> None:
        log = LogFile(tmp_path / "lamp.log")
        lamp = ChildProcess((sys.executable, "-Sc", BEATS), spec(tmp_path), log, kill_group)
        os.kill(lamp.pid, signal.SIGKILL)
        async with asyncio.timeout(NOTICED_WITHIN_S):
            while lamp.exit_code is None:  # noqa: ASYNC110  a process has no event to wait for
                await asyncio.sleep(0.01)
        await lamp.stop()
        log.close()

    asyncio.run(main())
    assert killed == ["Z"]  # once, when it had ended and nobody had reaped it


def spec(run_dir: Path) -> ChildSpec:
    return ChildSpec(
        process="lamp",
        components=(),
        bus=ZenohConfig(namespace="lamp"),
        time_base=TimeBase.MACHINE,
        config_file="",
        run_dir=str(run_dir),
        page_key="",
        beat_fd=-1,
    )


class Raises(logging.Handler):
    """A log handler that fails."""

    def emit(self, record: logging.LogRecord) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize(("restart", "reason"), [(NEVER, "process_died: lamp"), (ONCE, "supervisor_failed: OSError")])
def test_a_log_line_that_cannot_be_written_hides_no_death(tmp_path: Path, restart: Restart, reason: str) -> None:
    handler = Raises(level=logging.WARNING)
    module.log.addHandler(handler)
    try:
        assert failure_of(supervisor(tmp_path, restart), kill).reason == reason
    finally:
        module.log.removeHandler(handler)


def test_the_failure_is_notified_before_it_is_logged(tmp_path: Path) -> None:
    running, told = supervisor(tmp_path), list[bool]()

    class Looks(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            failed = running._failed  # pyright: ignore[reportPrivateUsage]
            told.append(failed is not None and failed.done())

    handler = Looks(level=logging.ERROR)
    module.log.addHandler(handler)
    try:
        failure_of(running, kill)
    finally:
        module.log.removeHandler(handler)
    assert told == [True]


def test_a_watch_that_raises_is_a_failed_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def raises(child: object) -> None:
        raise RuntimeError("a mistake of ours")

    def happens(running: Supervisor) -> None:
        monkeypatch.setattr(module.ChildProcess, "silent_s", raises)

    failure = failure_of(supervisor(tmp_path), happens)
    assert failure.reason == "supervisor_failed: RuntimeError"
    assert "a mistake of ours" in failure.detail


def test_a_watch_that_is_cancelled_by_another_is_a_failed_run(tmp_path: Path) -> None:
    def happens(running: Supervisor) -> None:
        [watch] = [task for task in asyncio.all_tasks() if task.get_name() == "watch processes"]
        watch.cancel()

    assert failure_of(supervisor(tmp_path), happens).reason == "supervisor_failed: cancelled"


def test_an_orderly_end_is_no_failure(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with supervisor(tmp_path) as running:
            waiting = asyncio.create_task(running.wait_failed())
            await asyncio.sleep(0.0)
        assert not waiting.done()
        waiting.cancel()

    asyncio.run(main())
    assert "supervisor_failed" not in caplog.text


ENDS = """
import json, os, pathlib, signal, sys, time
spec = json.loads(sys.stdin.readline())
folder, name = pathlib.Path(spec["run_dir"]), spec["process"]
waits_for = {"robot": "lamp", "cell": "robot"}.get(name)
def end(number, frame):
    (folder / f"{name} is asked").touch()
    while waits_for == "lamp" and not (folder / "lamp is asked").exists():
        time.sleep(0.01)
    alone = waits_for != "robot" or (folder / "robot has ended").exists()
    (folder / f"{name} has ended").write_text("in order" if alone else "before the robot")
    os._exit(0)
signal.signal(signal.SIGTERM, end)
os.write(spec["beat_fd"], b"r")
while True:
    time.sleep(0.1)
    os.write(spec["beat_fd"], b".")
"""


def test_a_process_ends_after_those_that_need_it_and_waits_for_no_other(tmp_path: Path) -> None:
    rows = (
        ProcessRow(name="cell", components=()),
        ProcessRow(name="robot", components=(), after=("cell",)),
        ProcessRow(name="lamp", components=()),
    )
    command = (sys.executable, "-Sc", ENDS)
    launch = Launch(namespace="lamp", config_file=tmp_path / "config.toml", run_dir=tmp_path, command=command)

    async def main() -> None:
        async with Supervisor(rows, launch, lambda name: ZenohConfig(namespace="lamp")):
            pass

    asyncio.run(main())
    # The robot ends only once the lamp, which was started before it, is asked to end as well.
    assert (tmp_path / "robot has ended").exists()
    assert (tmp_path / "cell has ended").read_text() == "in order"
