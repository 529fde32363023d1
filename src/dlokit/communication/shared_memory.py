"""The shared memory of this machine, over which processes exchange pictures and by which they wait for one another."""

import os
import tempfile

from dlokit.errors import MachineError

_FOLDER = "/dev/shm"
_PAGE = b"\0" * 4096
FIX = "mount -t tmpfs tmpfs /dev/shm, or docker run --shm-size 256m (with --read-only: --tmpfs /dev/shm)"
"""What makes it writable."""


def check_shared_memory(folder: str = _FOLDER) -> None:
    """Raise `MachineError` with the cause where no shared memory can be had, e.g. in a read-only container."""
    if folder == _FOLDER and os.uname().sysname != "Linux":  # other systems have it without a folder
        return
    try:
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            file.write(_PAGE)  # an empty file fits on a full disk
    except OSError as error:
        raise MachineError(
            f"{folder} cannot be written ({error.strerror}), and several processes need it: {FIX}. `dlokit shape` in "
            "lockstep runs without it."
        ) from error
