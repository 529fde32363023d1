"""The shared memory of this machine, over which processes exchange pictures and by which they wait for one another."""

import sys
import tempfile

from dlokit.errors import MachineError


def check_shared_memory(folder: str = "/dev/shm") -> None:
    """Raise `MachineError` with the cause where no shared memory can be had, e.g. in a read-only container."""
    if not sys.platform.startswith("linux"):  # other systems have it without a folder
        return
    try:
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            file.write(bytes(4096))  # an empty file fits on a full disk
    except OSError as error:
        raise MachineError(
            f"{folder} cannot be written ({error.strerror}), and several processes need it: mount a tmpfs "
            "there (docker run --shm-size 256m). `dlokit shape` in lockstep runs without it."
        ) from error
