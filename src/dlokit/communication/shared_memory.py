"""The shared memory of this machine, over which processes exchange pictures and by which they wait for one another."""

import signal
import sys
import tempfile
from typing import Any

from dlokit.errors import MachineError


def start_tracker(tracker: Any) -> None:
    """Start what cleans up after a pool of loky: a closed terminal (SIGHUP), like Ctrl-C, must not end it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    tracker.ensure_running()
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
