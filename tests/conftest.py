"""What all tests share: their rooms, and what the pure ones among them may not do."""

import gc
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import psutil
import pytest

from dlokit.app.environment import keep_to_one_thread

keep_to_one_thread()  # before any test imports NumPy, as in the command line

# MuJoCo reads this once, when it is first imported; without a display only EGL can render.
if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    os.environ.setdefault("MUJOCO_GL", "egl")

# A shell lets what runs in the background of a script ignore Ctrl-C; the tests of Ctrl-C mean it.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Systems of these tests and those of their user, or of tests beside them, do not find one another.
RUNTIME = tempfile.mkdtemp(prefix="dlk")  # short: the path of a socket has 107 bytes
os.environ["DLOKIT_RUNTIME_DIR"] = RUNTIME

from pure_room import ImpureTest, PureRoom  # noqa: E402  (the environment comes first)

TESTS = Path(__file__).parent
LIVE_ROOMS = ("live", "long", "peers", "ros")
"""Folders whose tests may start processes, open sockets and wait; all others are pure, but for tests marked `live`."""
MINUTES = {
    "(not live or smoke) and not heavy and not long and not peers and not ros": 5,
    "not live and not long and not peers and not ros": 6,
    "not long and not peers and not ros": 17,
    "long": 60,
}
"""About how long each choice of rooms takes on two idle cores [min]."""
WRITABLE = (
    Path(tempfile.gettempdir()),
    *(TESTS.parent / name for name in (".pytest_cache", ".hypothesis")),
    *(Path.home() / name for name in (".cache", ".config")),  # what libraries keep, such as Matplotlib's list of fonts
)
"""Where a pure test may write."""
SERVERS = ("multiprocessing.resource_tracker", "multiprocessing.forkserver", "loky.backend.resource_tracker")
"""Processes that Python keeps once they were needed, until the end of the tests."""
ENDS_S = 60.0
"""A process that goes on for longer does not end by itself [s]; a worker that was told to end takes a moment."""
THREADS = frozenset(threading.enumerate())
"""Those of the process that runs the tests."""
ROOM = PureRoom()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep the tests of a file in one process, unless they belong to a group: its module's fixtures are made once."""
    if config.option.dist != "loadgroup":
        return None
    from xdist.scheduler import LoadGroupScheduling

    class FilesAndGroups(LoadGroupScheduling):
        def _split_scope(self, nodeid: str) -> str:
            scope = super()._split_scope(nodeid)
            return nodeid.partition("::")[0] if scope == nodeid else scope

    return FilesAndGroups(config, log)


@pytest.hookimpl(tryfirst=True)  # pytest-xdist reads the groups in this hook, too
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark each test with its room. Live ones come first and one at a time: they mostly wait, and leave a processor."""
    for item in items:
        room = item.path.relative_to(TESTS).parts[0]
        if room in LIVE_ROOMS:
            item.add_marker(room)
        if item.get_closest_marker("live"):
            item.add_marker(pytest.mark.xdist_group("live"))
    items.sort(key=is_pure)


def is_pure(item: pytest.Item) -> bool:
    return not any(item.get_closest_marker(room) for room in LIVE_ROOMS)


class FirstLine:
    """Says once how many tests run; of a whole room, also about how long it takes."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._said = False

    def say(self, count: int) -> None:
        if self._said:
            return
        self._said = True
        whole = self._config.args_source is pytest.Config.ArgsSource.TESTPATHS
        minutes = MINUTES.get(self._config.option.markexpr) if whole else None
        long = f", about {minutes} minutes on two idle cores" if minutes else ""
        reporter = self._config.pluginmanager.get_plugin("terminalreporter")
        assert reporter is not None
        reporter.write_line(f"{count} tests{long}")

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        self.say(len(ids))

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        if session.items:  # none in the process that distributes them
            self.say(len(session.items))


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(FirstLine(config))


@pytest.fixture
def pure_room() -> PureRoom:
    """What watches this test, for the test of that watch itself."""
    return ROOM


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, object, object]:
    if is_pure(item):
        ROOM.enter(WRITABLE)
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Generator[None, object, object]:
    try:
        return (yield)
    finally:  # also after a fixture that failed: the next test may be a live one
        if is_pure(item):
            ROOM.leave()
        elif nextitem is None or nextitem.path != item.path:  # the systems that a module shares have ended
            refuse_what_is_left()


def refuse_what_is_left() -> None:
    """Raise `ImpureTest` for processes, announced systems, sockets and threads that the tests of a module leave."""
    from dlokit.system.processes.running import running_systems

    gc.collect()  # what the frames of an expected error have kept
    end_s = time.monotonic() + ENDS_S
    while left := [
        *left_processes(),
        *(system.folder for system in running_systems(Path(RUNTIME), starting=True)),
        *(f"socket {one.laddr}" for one in psutil.Process().net_connections(kind="inet")),
        *(f"thread {one.name}" for one in threading.enumerate() if not one.daemon and one not in THREADS),
    ]:
        if time.monotonic() > end_s:
            raise ImpureTest(f"the tests of this module leave {', '.join(left)}")
        time.sleep(0.05)


def left_processes() -> list[str]:
    return [said for process in psutil.Process().children(recursive=True) if (said := left_process(process))]


def left_process(process: psutil.Process) -> str:
    """The command of a process that should have ended; empty if it has, or is a server that multiprocessing keeps."""
    try:
        command = " ".join(process.cmdline())
        ended = process.status() == psutil.STATUS_ZOMBIE
        own = process.ppid() == os.getpid()  # the children of the fork server have its command line
    except psutil.NoSuchProcess:
        return ""
    return "" if ended or (own and any(server in command for server in SERVERS)) else f"{process.pid}: {command}"


def pytest_sessionfinish() -> None:
    shutil.rmtree(RUNTIME, ignore_errors=True)


@pytest.fixture(scope="session")
def simulated_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short recorded run in the simulated cell; its tests are one group, so that it is made once."""
    from dlokit.app.commands import execute

    folder = tmp_path_factory.mktemp("simulated") / "short-run"
    shaped = ("--goal", "S", "--seed", "3", "--planner", "farthest", "--task.threshold-m", "0.03")  # by two actions
    assert execute(["shape", "--headless", "--no-check-camera", *shaped, "--out", str(folder)]) == 0
    return folder
