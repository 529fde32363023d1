"""How much processor time passes between the start of `dlokit stop` and its press, and what it has imported by then."""

import os
import socket
import subprocess
import sys
import tempfile
from dataclasses import dataclass

FORBIDDEN = frozenset(("numpy", "zenoh", "tyro", "psutil", "rich", "mujoco", "msgspec", "asyncio"))
"""Modules that an arm must not wait for."""
HANGS_S = 60.0
_SCRIPT = """
import sys, time
def note(event, arguments):
    if event == "socket.connect" and not noted:
        noted.append(True)
        print(time.process_time(), *sorted(sys.modules), file=sys.stderr, flush=True)
noted = []
sys.addaudithook(note)
sys.argv = ["dlokit", "stop"]
from dlokit.app.main import main
main()
"""
_PASS = "import sys, time; print(time.process_time(), file=sys.stderr)"


@dataclass(frozen=True, kw_only=True)
class MeasuredPress:
    """One `dlokit stop`."""

    cpu_s: float
    """Processor time from the start of the process to the press [s]."""
    modules: tuple[str, ...]
    """The modules that were imported by then."""
    received: bytes
    """What the stop socket received."""


def measured_press() -> MeasuredPress:
    """Run `dlokit stop` in a folder of sockets of its own, in which one socket listens."""
    with tempfile.TemporaryDirectory(prefix="dlk") as folder, socket.socket(socket.AF_UNIX) as server:
        server.bind(f"{folder}/0123456789abcdef-robot.stop")
        server.listen()
        server.settimeout(HANGS_S)
        environment = os.environ | {"DLOKIT_RUNTIME_DIR": folder}
        command, pipe = [sys.executable, "-c", _SCRIPT], subprocess.PIPE
        with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=pipe) as process:
            caller, _ = server.accept()
            with caller:
                received = caller.recv(100)
                caller.sendall(b'{"confirmed": true, "text": "stands"}\n')
            _, said = process.communicate(timeout=HANGS_S)
    cpu_s, *modules = said.decode().splitlines()[0].split()
    return MeasuredPress(cpu_s=float(cpu_s), modules=tuple(modules), received=received)


def measured_pass() -> float:
    """Processor time of `python -c pass` [s]."""
    done = subprocess.run([sys.executable, "-c", _PASS], stderr=subprocess.PIPE, text=True, check=True, timeout=HANGS_S)
    return float(done.stderr)
