"""The folder in which the systems of a user announce themselves; it uses the standard library only.

Every shell, cron job and service of a user must find the same folder, because `dlokit stop` reaches only the systems in
it. The folder therefore depends on the user's number alone: `XDG_RUNTIME_DIR` and `TMPDIR` differ between shells, and
`/run/user/UID` begins and ends with the user's logins.
"""

import fcntl
import hashlib
import os
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from dlokit.errors import MachineError

RUNTIME_DIR = "DLOKIT_RUNTIME_DIR"
"""Environment variable that names another folder; systems of different folders do not find one another."""
PARENT = Path("/tmp")  # the folder in it is checked: kind, owner, mode
"""Where the folder is made: every system has this directory, and its path is short enough for sockets."""
LONGEST_SOCKET = 107
"""Maximum length of the path of a Unix socket on Linux [bytes]; other systems allow 103."""
ROOM = 60
"""Bytes of the path that are reserved for names inside the user's folder."""
_CHOOSE = f"set {RUNTIME_DIR} to another folder"


def user_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """The folder of this user's sockets and notes of running systems, of mode 0700.

    `DLOKIT_RUNTIME_DIR` names it; without the variable it is `/tmp/dlokit-UID`. Systems of different folders do not
    find one another: `dlokit stop` reaches only the systems of its folder. Raises `MachineError` when the path is too
    long for a socket, and when another user created the folder first, or may enter it.
    """
    return private_folder(user_folder_path(environment))


def user_folder_path(environment: Mapping[str, str] = os.environ) -> Path:
    """The path of that folder, which may not exist yet. Raises `MachineError` when it is too long for a socket."""
    if not (chosen := environment.get(RUNTIME_DIR)):
        return PARENT / f"dlokit-{os.getuid()}"
    path = Path(chosen).absolute()
    if len(os.fsencode(path)) + ROOM > LONGEST_SOCKET:
        raise MachineError(f"{RUNTIME_DIR} is {path}, which is too long for the path of a socket: name a shorter one.")
    return path


def private_folder(path: Path) -> Path:
    """Make a folder for this user only, or check that it is one. Raises `MachineError`."""
    try:
        with suppress(FileExistsError):
            path.mkdir(mode=0o700)
        facts = path.lstat()
    except OSError as error:
        raise MachineError(f"{path} cannot be made: {error}; {_CHOOSE} that you may write to.") from error
    why = ""
    if not stat.S_ISDIR(facts.st_mode):
        why = "is not a folder"
    elif facts.st_uid != os.getuid():
        why = "belongs to another user"
    elif stat.S_IMODE(facts.st_mode) & 0o077:
        why = f"has mode {stat.S_IMODE(facts.st_mode):o}, so that other users may enter it; it must be 700"
    if why:
        raise MachineError(f"{path} {why}: remove it, or {_CHOOSE}.")
    return path


def sockets_begin_with(run_dir: Path) -> str:
    """The beginning of the names of a run's stop sockets; the address of an arm follows."""
    return hashlib.sha256(str(run_dir.resolve()).encode()).hexdigest()[:16] + "-"


def is_held(note: Path) -> bool:
    """Whether the process that wrote a note still runs: it holds a lock on the note."""
    try:
        with note.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    return False
