"""The first step of `dlokit stop`: press the stop sockets before the process imports anything large.

An arm must not wait for imports, which take seconds on a busy machine. This module therefore uses the standard library
only. `dlokit.app.operate.stop` reads the answers afterwards, and ends the tasks.
"""

import contextlib
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from dlokit.errors import MachineError
from dlokit.system.processes.runtime_folder import is_held, sockets_begin_with, user_folder

STOP = b"stop\n"


class FirstPress(NamedTuple):
    """The stop sockets that were pressed, and the systems that ran then."""

    links: dict[Path, socket.socket]
    """Connections over which the robot processes will answer, by the paths of their sockets."""
    notes: dict[Path, bytes]
    """Contents of the notes of the systems that ran; a system may end before its note is read again."""


def press_first(arguments: Sequence[str]) -> FirstPress | None:
    """Press the sockets for the command line `stop [--run DIR]`; None for any other, which is parsed first."""
    match list(arguments):
        case ["stop"]:
            pattern = "*.stop"
        case ["stop", "--run", run]:
            pattern = f"{sockets_begin_with(Path(run))}*.stop"
        case ["stop", word] if word.startswith("--run="):
            pattern = f"{sockets_begin_with(Path(word.removeprefix('--run=')))}*.stop"
        case _:
            return None
    try:
        folder = user_folder()
    except MachineError:  # the command itself reports it
        return None
    links = {path: link for path in sorted(folder.glob(pattern)) if (link := _pressed(path)) is not None}
    return FirstPress(links, _held_notes(folder))


def _pressed(path: Path) -> socket.socket | None:
    """A connection on which the order is sent; None if none listens, or more callers wait than the socket admits."""
    link = socket.socket(socket.AF_UNIX)
    link.setblocking(False)  # a process that hangs must not delay the next arm
    try:
        link.connect(str(path))
        link.send(STOP)
    except OSError:
        link.close()
        return None
    return link


def _held_notes(folder: Path) -> dict[Path, bytes]:
    notes = dict[Path, bytes]()
    for path in folder.glob("*.json"):
        with contextlib.suppress(OSError):
            content = path.read_bytes()
            if is_held(path):
                notes[path] = content
    return notes
