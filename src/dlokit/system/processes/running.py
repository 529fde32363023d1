"""Which systems run on this machine: each leaves a note while it does, so that any shell finds it.

A system holds a lock on its note, which the operating system takes back when its process ends, however it ends. Neither
a number of a process that is used again nor a clock that is set hides a system from whoever wants to stop it.
"""

import fcntl
import os
import tempfile
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
import psutil

from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.errors import InputError, MachineError


class RunningSystem(msgspec.Struct, frozen=True, kw_only=True):
    """How to reach one running system."""

    pid: int
    """Of its decision process."""
    began_s: float
    """When that began, by the machine's clock [s since 1970]."""
    folder: str
    """Of the run."""
    namespace: str
    endpoint: str
    client: bool = False
    """Whether whoever joins goes through the endpoint alone: it is a host's door, in a run on several."""
    starting: bool = False
    """Whether its processes have not all begun yet: it can be stopped, and not be asked for anything else."""

    @property
    def bus(self) -> ZenohConfig:
        """How to join its bus from another process of this machine."""
        if self.client:
            return ZenohConfig(namespace=self.namespace, role="client", listen=(), connect=(self.endpoint,))
        return ZenohConfig(namespace=self.namespace, connect=(self.endpoint,))


def notes_folder() -> Path:
    """Where this user's systems leave their notes. Raises `MachineError` when it is somebody else's."""
    folder = Path(tempfile.gettempdir()) / f"dlokit-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.stat().st_uid != os.getuid():
        raise MachineError(f"{folder} belongs to somebody else: remove it, or set another TMPDIR.")
    return folder


@contextmanager
def announced(
    run_dir: Path, namespace: str, endpoint: str, notes: Path | None = None, *, client: bool = False
) -> Generator[Callable[[], None]]:
    """Leave a note of this process's system meanwhile; `client` says that the endpoint is a host's door.

    It is noted as starting until the given function is called.
    """
    system = RunningSystem(
        pid=os.getpid(),
        began_s=psutil.Process().create_time(),
        folder=str(run_dir.resolve()),
        namespace=namespace,
        endpoint=endpoint,
        client=client,
        starting=True,
    )
    note = _note_of(system.pid, notes)
    with ExitStack() as held:
        held.callback(note.unlink, missing_ok=True)
        _write(note, system, held)
        yield lambda: _write(note, msgspec.structs.replace(system, starting=False), held)


def _write(note: Path, system: RunningSystem, held: ExitStack) -> None:
    """Put a note in the place of the one before; its lock is held until `held` ends."""
    part = note.with_suffix(".part")
    file = held.enter_context(part.open("wb"))
    file.write(msgspec.json.encode(system))
    file.flush()
    fcntl.flock(file, fcntl.LOCK_EX)  # before anybody can see the note
    part.replace(note)


def running_systems(notes: Path | None = None, *, starting: bool = False) -> list[RunningSystem]:
    """Those that run, and with `starting` those that still start; notes of systems that were killed are removed."""
    found: list[RunningSystem] = []
    for note in sorted((notes or notes_folder()).glob("*.json")):
        try:
            system = msgspec.json.decode(note.read_bytes(), type=RunningSystem)
        except (msgspec.DecodeError, FileNotFoundError):
            continue
        if _is_held(note):
            found += [system] * (starting or not system.starting)
        else:
            note.unlink(missing_ok=True)
    return found


def the_running_system(run: Path | None, notes: Path | None = None, *, starting: bool = False) -> RunningSystem:
    """The only one, or that of the folder `run`. Raises `InputError` when there is none, or no telling which.

    With `starting` one that still starts counts.
    """
    systems = running_systems(notes, starting=starting)
    if run is not None:
        systems = [system for system in systems if system.folder == str(run.resolve())]
    if len(systems) == 1:
        return systems[0]
    if not systems:
        if run is not None:
            raise InputError(
                f"no system runs in {run}: it has ended, or is still starting; dlokit ps lists those that run."
            )
        raise InputError("no system runs: start one, e.g. dlokit shape --runtime live.")
    raise InputError("several systems run; say which with --run: " + ", ".join(system.folder for system in systems))


def still_runs(system: RunningSystem, notes: Path | None = None) -> bool:
    """Whether its decision process is there."""
    return _is_held(_note_of(system.pid, notes))


def _note_of(pid: int, notes: Path | None) -> Path:
    return (notes or notes_folder()) / f"{pid}.json"


def _is_held(note: Path) -> bool:
    try:
        with note.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    return False
