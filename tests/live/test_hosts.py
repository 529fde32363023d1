"""A run on several hosts, each in a network namespace: what may pass, and a disconnected cable."""

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from lab_network import LabNetwork, lab_network, why_not

from dlokit.extras.hosts.certificates import hosts_from_words, make_certificates

WHY_NOT = why_not()
pytestmark = [pytest.mark.skipif(WHY_NOT != "", reason=WHY_NOT)]

PROGRAM = str(Path(__file__).with_name("host_process.py"))
PORT = 7447
WAIT_S = 60  # starting a process takes a second; many on a loaded machine take more


class Program:
    """A program of `host_process.py` on one machine of the network."""

    def __init__(self, popen: "subprocess.Popen[str]") -> None:
        self._popen = popen

    def tell(self, *orders: str) -> None:
        assert self._popen.stdin is not None
        self._popen.stdin.write("".join(f"{order}\n" for order in orders))
        self._popen.stdin.flush()

    def until(self, wanted: str) -> str:
        """The rest of the next line with this beginning; earlier lines are skipped."""
        assert self._popen.stdout is not None
        with killed_after(self._popen):
            for line in self._popen.stdout:
                if line.startswith(wanted):
                    return line.strip().removeprefix(wanted).strip()
        raise AssertionError(f"the program ended, or printed nothing for {WAIT_S} s, without {wanted!r}")

    def end(self) -> None:
        self._popen.send_signal(signal.SIGTERM)
        try:
            self._popen.communicate(timeout=WAIT_S)
        except subprocess.TimeoutExpired:
            self._popen.kill()
            self._popen.communicate()


@dataclass(frozen=True, kw_only=True)
class Lab:
    network: LabNetwork
    folder: Path

    @property
    def endpoint(self) -> str:
        return f"tls/{self.network.address('main')}:{PORT}"

    @property
    def certificates(self) -> Path:
        return self.folder / "certificates"

    def files(self, host: str, folder: Path | None = None) -> tuple[str, ...]:
        where = folder or self.certificates
        return (str(where / "ca.pem"), str(where / f"{host}.pem"), str(where / f"{host}.key"))

    @contextmanager
    def runs(self, host: str) -> Generator[Program]:
        """Run the host's program within the context."""
        here = self.folder / host
        here.mkdir(exist_ok=True)
        command = (sys.executable, PROGRAM, host, self.endpoint, str(self.certificates), str(here))
        with (
            (here / "errors.log").open("w") as errors,
            subprocess.Popen(
                self.network.inside(host, *command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                start_new_session=True,
            ) as popen,
        ):
            program = Program(popen)
            try:
                yield program
            finally:
                program.end()

    def look_in(self, machine: str, *attempts: tuple[str, tuple[str, ...]], within_s: float) -> list[object]:
        """What a client on that machine sees with these endpoints and files, tried one after another."""
        asked = [{"endpoint": endpoint, "files": files, "within_s": within_s} for endpoint, files in attempts]
        done = subprocess.run(
            self.network.inside(machine, sys.executable, PROGRAM, "look", json.dumps(asked)),
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=True,
        )
        return json.loads(done.stdout.splitlines()[-1])

    def log_of(self, host: str, process: str) -> str:
        return (self.folder / host / "logs" / f"{process}.log").read_text(encoding="utf-8")


@dataclass(frozen=True, kw_only=True)
class System:
    lab: Lab
    main: Program
    arm: Program
    eye: Program


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Generator[Lab]:
    folder = tmp_path_factory.mktemp("lab")
    with lab_network("main", "arm", "eye", "desk", "elsewhere") as network:
        hosts = hosts_from_words((f"main={network.address('main')}", "arm,eye,desk,guest"))
        make_certificates(folder / "certificates", hosts)
        yield Lab(network=network, folder=folder)


@pytest.fixture(scope="module")
def system(lab: Lab) -> Generator[System]:
    with ExitStack() as stack:
        main = stack.enter_context(lab.runs("main"))
        arm = stack.enter_context(lab.runs("arm"))
        eye = stack.enter_context(lab.runs("eye"))
        main.until("ready")
        yield System(lab=lab, main=main, arm=arm, eye=eye)


def test_a_system_on_two_hosts_calls_and_publishes_through_tls(system: System) -> None:
    system.main.tell("stop", "states")
    said = {system.main.until("") for _ in range(2)}
    assert said == {"stop: Succeeded(result=None)", "states: flow"}


def test_unknown_clients_cannot_connect_and_an_unlisted_host_sees_nothing(system: System, tmp_path: Path) -> None:
    lab = system.lab
    make_certificates(tmp_path, hosts_from_words(("main=10.77.0.1", "desk")))
    refused = lab.look_in(
        "elsewhere",
        (lab.endpoint, lab.files("desk", tmp_path)),
        (lab.endpoint, ()),
        (lab.endpoint.replace("tls/", "tcp/"), ()),
        within_s=2.0,
    )
    assert refused == ["refused", "refused", "refused"]
    (guest,) = lab.look_in("elsewhere", (lab.endpoint, lab.files("guest")), within_s=WAIT_S)
    assert guest == {"last/**": 0, "call/robot/*": 0, "call/**": 0, "**": 0}


def test_an_observing_host_may_read_and_brake_but_not_command(system: System) -> None:
    lab = system.lab
    (seen,) = lab.look_in("desk", (lab.endpoint, lab.files("desk")), within_s=WAIT_S)
    assert isinstance(seen, dict)
    assert seen["last/**"] > 0
    assert (seen["call/robot/*"], seen["call/**"], seen["**"]) == (0, 0, 0)
    with lab.runs("desk") as desk:
        desk.until("ready")
        desk.tell("states", "stop", "home", "claim")
        said = {desk.until("") for _ in range(4)}
        assert said == {
            "states: flow",
            "stop: Succeeded(result=None)",
            "home: Unreachable(component='robot')",
            "claim: published",
        }
    system.main.tell("claim")
    system.main.until("claim: published")
    system.main.tell("stop")
    system.main.until("stop: ")
    await_line(lab.folder / "arm" / "logs" / "robot.log", "heartbeat signed main")
    log = lab.log_of("arm", "robot")
    assert "heartbeat signed desk" not in log
    assert "moving" not in log


def test_a_disconnected_arm_brakes_and_topics_resume_after_reconnection(system: System) -> None:
    lab = system.lab
    robot_log = lab.folder / "arm" / "logs" / "robot.log"
    system.main.tell("home")
    await_line(robot_log, "moving")
    lab.network.cut("arm")
    try:
        await_line(robot_log, "braked")
    finally:
        lab.network.heal("arm")
    assert system.main.until("home: ").startswith("Failed(reason='lease_lost'")
    system.main.tell("states")
    assert system.main.until("states: ") == "flow"


def test_restartable_processes_are_restarted_when_their_host_returns(system: System) -> None:
    lab = system.lab
    lab.network.cut("eye")
    try:
        await_line(lab.folder / "main" / "errors.log", "host_lost: eye; its processes are started again")
    finally:
        lab.network.heal("eye")
    system.eye.until("the processes have ended")
    system.eye.until("ready")
    system.main.tell("echo")
    assert system.main.until("echo: ") == "Succeeded(result='here')"


def test_a_lost_host_of_the_arm_ends_the_run_by_name_and_serves_the_next_one(system: System) -> None:
    lab = system.lab
    lab.network.cut("arm")
    try:
        assert system.main.until("ended by") == "host_lost: arm"
    finally:
        lab.network.heal("arm")
    system.arm.until("the processes have ended")
    with lab.runs("main") as main:
        main.until("ready")
        main.tell("states")
        assert main.until("states: ") == "flow"


def await_line(path: Path, text: str) -> None:
    """Wait until a log has a line with the text; `tail` wakes when it grows."""
    with subprocess.Popen(("tail", "-F", "-n", "+1", str(path)), stdout=subprocess.PIPE, text=True) as tail:
        assert tail.stdout is not None
        try:
            with killed_after(tail):
                for line in tail.stdout:
                    if text in line:
                        return
        finally:
            tail.kill()
    raise AssertionError(f"{path} has no line with {text!r} after {WAIT_S} s")


@contextmanager
def killed_after(popen: "subprocess.Popen[str]") -> Generator[None]:
    """Kill a program that is waited for, so that a missing line fails the test instead of blocking it."""
    timer = threading.Timer(WAIT_S, popen.kill)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
