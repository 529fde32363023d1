"""A lab with ROS 2 on a network of its own: its environments (`make test-ros`), and programs that run in them.

dlokit stays outside that network; the node in the workspace reaches it at a Unix socket, which crosses networks.
"""

import json
import os
import random
import shutil
import struct
import subprocess
import threading
import time
from collections.abc import Generator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
LAB = ROOT / "tests" / "ros" / "lab"
BRIDGE = ROOT / "ros" / "dlokit_ros"
"""Folder of the Python package of the node in the workspace."""
DISTRIBUTIONS = ("jazzy", "kilted")
"""Distributions whose rclpy the package index has."""
HANGS_S = 60.0
"""What takes longer hangs [s]: two nodes find each other in 3."""
ENDS_S = 10.0
"""A program that goes on for longer after it was told to end is killed [s]."""
SIZES = struct.Struct("<II")
# Domains above 101 use ports that Linux also gives to others.
DOMAINS = range(1, 102)
# Its own memory folder as well: the middleware also passes messages there, and what it leaves goes with the folder.
NETWORK = """
mount -t tmpfs tmpfs /dev/shm
ip link set lo up && ip link set lo multicast on && ip route add 239.0.0.0/8 dev lo && echo ready && exec cat
"""


class RosEnvironment:
    """A virtual environment with rclpy of one distribution; nothing of dlokit is in it."""

    def __init__(self, distribution: str) -> None:
        self.distribution = distribution
        self.folder = ROOT / f".venv-ros-{distribution}"
        self.python = self.folder / "bin" / "python"

    def why_not(self, package: str = "") -> str:
        """Why it, or a package of interfaces in it, is not there; empty where it is."""
        if not (self.folder / ".ready").exists():
            return f"{self.folder} is not ready: make test-ros"
        if package and not (self.folder / "share" / package / "package.xml").exists():
            return f"{self.folder} has no {package}: make test-ros"
        return ""

    def run(self, code: str) -> Any:
        """The result of an expression of Python in it, as JSON has it, with the package `dlokit_ros` at hand."""
        program = "import json, sys, dlokit_ros.bridge as bridge; print(json.dumps(eval(sys.argv[1])))"
        variables = {**os.environ, "PYTHONPATH": str(BRIDGE), "ROS_DISTRO": self.distribution}
        command = (str(self.python), "-c", program, code)
        done = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=HANGS_S, check=True)
        return json.loads(done.stdout)

    def hash_of(self, kind: str) -> str:
        """The hash in the type description of an interface, e.g. ``sensor_msgs/msg/Image``."""
        package, folder, name = kind.split("/")
        description = json.loads((self.folder / "share" / package / folder / f"{name}.json").read_text("utf-8"))
        return next(one["hash_string"] for one in description["type_hashes"] if one["type_name"] == kind)


class LabProgram:
    """A running program of `tests/ros/lab`, which takes orders and answers (`exchange.py`)."""

    def __init__(self, process: subprocess.Popen[bytes], log: Path) -> None:
        """`log` has what it writes on its standard error."""
        self.process = process
        self.log = log
        self._lines = list[dict[str, Any]]()
        self._ended = False
        self._news = threading.Condition()
        self._sending = threading.Lock()
        self._reader = threading.Thread(target=self._read, daemon=True, name=f"answers of {process.pid}")
        self._reader.start()

    def order(self, kind: str, payload: bytes = b"", /, **fields: Any) -> None:
        """Send an order. Raises `BrokenPipeError` when the program has ended."""
        header = json.dumps({"kind": kind, **fields}).encode()
        assert self.process.stdin is not None
        with self._sending:
            self.process.stdin.write(SIZES.pack(len(header), len(payload)) + header + payload)
            self.process.stdin.flush()

    def hear(self, kind: str, *, within_s: float = HANGS_S, **fields: Any) -> dict[str, Any]:
        """The oldest answer of a kind, with these fields, that was not returned yet; waits for it.

        Raises `AssertionError` for an "error", the end of the program, and after `within_s`.
        """
        end_s = time.monotonic() + within_s
        with self._news:
            while True:
                for line in self._lines:
                    if line["kind"] == kind and line.items() >= fields.items():
                        self._lines.remove(line)
                        return line
                    assert line["kind"] != "error" or kind == "error", line
                assert not self._ended, f"the program has ended: {self.said()}"
                left_s = end_s - time.monotonic()
                assert left_s > 0.0, f"no {kind} with {fields} in {within_s:g} s, but {self._lines[-5:]}; {self.said()}"
                self._news.wait(left_s)

    def heard(self, kind: str, **fields: Any) -> list[dict[str, Any]]:
        """The answers of a kind, with these fields, that were not returned yet; does not wait."""
        with self._news:
            found = [line for line in self._lines if line["kind"] == kind and line.items() >= fields.items()]
            self._lines = [line for line in self._lines if line not in found]
        return found

    def said(self) -> str:
        """The end of what it has written on its standard error."""
        return self.log.read_text(encoding="utf-8", errors="replace")[-2000:]

    def end(self) -> None:
        """Close its input, at which it ends, and wait for it."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        with self._sending, suppress(BrokenPipeError):
            self.process.stdin.close()
        end_process(self.process, asked=True)
        self._reader.join()
        self.process.stdout.close()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._news:
                self._lines.append(json.loads(line))
                self._news.notify_all()
        with self._news:
            self._ended = True
            self._news.notify_all()


class RosNetwork:
    """A network on which programs of a ROS environment find each other, and nobody else finds them."""

    def __init__(self, environment: RosEnvironment, folder: Path, inside: tuple[str, ...], *, local: bool) -> None:
        """`folder` takes the logs; `inside` comes before each command; `local`: nodes of this machine share it."""
        self.environment = environment
        self.folder = folder
        self.variables = {
            "ROS_DISTRO": environment.distribution,
            "ROS_DOMAIN_ID": str(random.choice(DOMAINS)),
            "ROS_LOG_DIR": str(folder / "ros-log"),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST" if local else "SUBNET",
            "PYTHONUNBUFFERED": "1",
        }
        """Variables of all programs on it, as those of a terminal with ROS sourced. A test may add some."""
        self._inside = inside
        self._started = ExitStack()
        self._count = 0

    def process(
        self,
        *command: str | Path,
        variables: Mapping[str, str] | None = None,
        name: str = "program",
        piped: bool = False,
    ) -> tuple[subprocess.Popen[bytes], Path]:
        """Start a command on it, with `variables` added; it ends with the test at the latest, however pytest ends.

        Also returns the file of its standard error, and, unless `piped`, output. Call it from a thread that lasts: the
        process ends with that thread.
        """
        self._count += 1
        log = self.folder / f"{self._count}-{name}.log"
        foreign = ("PYTHONPATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "RMW_IMPLEMENTATION")
        inherited = {key: value for key, value in os.environ.items() if key not in foreign}
        with log.open("wb") as out:
            process = subprocess.Popen(
                (*self._inside, "setpriv", "--pdeathsig", "KILL", *command),
                stdin=subprocess.PIPE if piped else subprocess.DEVNULL,
                stdout=subprocess.PIPE if piped else out,
                stderr=out,
                env={**inherited, **self.variables, **(variables or {})},
                start_new_session=True,
            )
        self._started.callback(end_process, process)
        return process, log

    def program(self, name: str, *arguments: str, variables: Mapping[str, str] | None = None) -> LabProgram:
        """Start ``tests/ros/lab/<name>.py``, and wait until it takes orders."""
        script = LAB / f"{name}.py"
        command = (self.environment.python, script, *arguments)
        process, log = self.process(*command, variables=variables, name=name, piped=True)
        program = LabProgram(process, log)
        self._started.callback(program.end)
        program.hear("ready")
        return program

    def camera(self, node: str = "lab_camera", *, variables: Mapping[str, str] | None = None) -> LabProgram:
        """Start `camera.py` as the node named."""
        return self.program("camera", node, variables=variables)

    def listener(self, node: str = "lab_listener", *, variables: Mapping[str, str] | None = None) -> LabProgram:
        """Start `listener.py` as the node named."""
        return self.program("listener", node, variables=variables)

    def bridge(
        self, runtime: Path, *arguments: str, variables: Mapping[str, str] | None = None
    ) -> tuple[subprocess.Popen[bytes], Path]:
        """Start the node in the workspace, on the links of dlokit's folder `runtime`; also returns its log.

        `arguments` are ROS's, such as ``("-p", "link:=other")``.
        """
        ros = ("--ros-args", *arguments) if arguments else ()
        own = {"PYTHONPATH": str(BRIDGE), "DLOKIT_RUNTIME_DIR": str(runtime), **(variables or {})}
        return self.process(self.environment.python, "-m", "dlokit_ros.bridge", *ros, variables=own, name="bridge")

    def end(self) -> None:
        """End all that was started on it."""
        self._started.close()


def end_process(process: subprocess.Popen[bytes], *, asked: bool = False) -> None:
    """End a process, gently at first; `asked`: it already knows."""
    if process.poll() is None and not asked:
        process.terminate()
    try:
        process.wait(ENDS_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@cache
def why_no_namespace() -> str:
    """Why this machine gives no network of its own; empty where it does."""
    missing = [name for name in ("unshare", "nsenter", "mount", "ip") if shutil.which(name) is None]
    if missing:
        return f"{', '.join(missing)} not installed"
    with subprocess.Popen(_KEEPER, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as keeper:
        out, said = keeper.communicate()
    return "" if out == b"ready\n" else f"this kernel or container allows none: {said.decode().strip()}"


_KEEPER = ("unshare", "--map-root-user", "--net", "--mount", "sh", "-ec", NETWORK)


@contextmanager
def ros_network(environment: RosEnvironment, folder: Path, *, namespace: bool = True) -> Generator[RosNetwork]:
    """Provide a network within the context, of namespaces, or of this machine's own loopback."""
    if not namespace:
        network = RosNetwork(environment, folder, (), local=True)
        try:
            yield network
        finally:
            network.end()
        return
    # It keeps the namespaces, and ends when its input does: also when pytest is killed.
    with subprocess.Popen(_KEEPER, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as keeper:
        assert keeper.stdout is not None
        assert keeper.stdout.readline() == b"ready\n"
        join = ("nsenter", "--target", str(keeper.pid), "--user", "--net", "--mount", "--preserve-credentials")
        network = RosNetwork(environment, folder, join, local=False)
        try:
            yield network
        finally:
            network.end()
            assert keeper.stdin is not None
            keeper.stdin.close()


def why_silent(environment: RosEnvironment, folder: Path, *, namespace: bool) -> str:
    """Why two nodes on such a network do not hear each other; empty where they do."""
    with ros_network(environment, folder, namespace=namespace) as network:
        try:
            camera, listener = network.camera(), network.listener()
            camera.order("topic", topic="/try", type="std_msgs/msg/Empty", transient_local=True)
            camera.order("bytes", b"\0\1\0\0\0", topic="/try")
            listener.order("subscribe", topic="/try", type="std_msgs/msg/Empty", transient_local=True)
            listener.hear("message")
        except (AssertionError, BrokenPipeError) as error:
            return f"nodes of this machine do not find each other: {error}"
    return ""
