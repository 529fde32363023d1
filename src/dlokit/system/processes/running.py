"""The systems that run on this machine: each keeps a locked note file, by which its user finds it from any shell.

The note has the key of the system's bus; only its owner may read it.
The operating system always releases the lock when the process ends, so that `dlokit stop` finds a system despite a
reused process id or a changed clock.
"""

import fcntl
import os
from collections.abc import Generator, Iterable
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import msgspec
import psutil

from dlokit.communication.zenoh.access import OWN_USER
from dlokit.communication.zenoh.session import Login, ZenohConfig
from dlokit.errors import InputError
from dlokit.system.processes.runtime_folder import is_held, user_folder
from dlokit.system.processes.sockets import LocalBus, endpoints_of_system, remove_sockets
from dlokit.system.table import TimeBase


class RunningSystem(msgspec.Struct, frozen=True, kw_only=True):
    """Connection data of one running system."""

    pid: int
    """Process id of its decision process."""
    began_s: float
    """Start time of that process, on the wall clock [s since 1970]."""
    folder: str
    """Folder of the run."""
    namespace: str
    endpoint: str
    key: str = ""
    """Key that admits a process to the bus; empty if the bus requires none."""
    client: bool = False
    """Whether other processes connect only through the endpoint: the router of a host in a multi-machine run."""
    starting: bool = False
    """Whether some processes have not started yet: the system can be stopped, but serves no other request."""
    ending: bool = False
    """Whether its processes are being stopped: its tasks have ended."""
    time_base: TimeBase = TimeBase.CELL
    """The clock of its components."""

    @property
    def bus(self) -> ZenohConfig:
        """Configuration with which another process of this machine joins the bus."""
        return ZenohConfig(
            namespace=self.namespace,
            role="client" if self.client else "peer",
            connect=(self.endpoint,) if self.client else endpoints_of_system(self.endpoint),
            login=Login(user=OWN_USER, password=self.key) if self.key else None,
        )

    def __repr__(self) -> str:
        """Without the key, which must not appear in logs."""
        return f"RunningSystem(pid={self.pid}, folder={self.folder!r}, starting={self.starting})"


class Announcement:
    """The note of this process's system."""

    def __init__(self, system: RunningSystem, note: Path, held: ExitStack) -> None:
        """Write the note; its lock is held until `held` ends."""
        self._system, self._note, self._held = system, note, held
        _write(note, system, held)

    def ready(self) -> None:
        """Note that all processes have started."""
        _write(self._note, msgspec.structs.replace(self._system, starting=False), self._held)

    def ending(self) -> None:
        """Note that the processes are being stopped."""
        with suppress(OSError):  # on a full disk the system ends all the same
            _write(self._note, msgspec.structs.replace(self._system, starting=False, ending=True), self._held)


@contextmanager
def announced(
    run_dir: Path,
    bus: LocalBus,
    notes: Path | None = None,
    *,
    client: bool = False,
    time_base: TimeBase = TimeBase.CELL,
) -> Generator[Announcement]:
    """Keep a note of this process's system; `client`: its first process is a host's router.

    The note marks the system as starting until `ready` of the yielded announcement is called.
    """
    system = RunningSystem(
        pid=os.getpid(),
        began_s=psutil.Process().create_time(),
        folder=str(run_dir.resolve()),
        namespace=bus.namespace,
        endpoint=bus.endpoint,
        key=bus.key,
        client=client,
        starting=True,
        time_base=time_base,
    )
    running_systems(notes)  # removes what killed systems have left
    note = _note_of(system.pid, notes)
    with ExitStack() as held:
        held.callback(note.unlink, missing_ok=True)
        yield Announcement(system, note, held)


def _write(note: Path, system: RunningSystem, held: ExitStack) -> None:
    """Replace the note; its lock is held until `held` ends."""
    part = note.with_suffix(".part")
    part.unlink(missing_ok=True)
    file = held.enter_context(os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb"))
    file.write(msgspec.json.encode(system))
    file.flush()
    fcntl.flock(file, fcntl.LOCK_EX)  # before another process can see the note
    part.replace(note)


def running_systems(notes: Path | None = None, *, starting: bool = False) -> list[RunningSystem]:
    """The running systems, with `starting` also those that still start; notes of killed systems are removed."""
    found: list[RunningSystem] = []
    for note in sorted((notes or user_folder()).glob("*.json")):
        system = _read(note)
        if system is None:
            continue
        if is_held(note):
            found += [system] * (starting or not system.starting)
        else:
            note.unlink(missing_ok=True)
            remove_sockets(system.endpoint)
    return found


def the_running_system(run: Path | None, notes: Path | None = None, *, starting: bool = False) -> RunningSystem:
    """The only running system, or the one of folder `run`. Raises `InputError` unless there is exactly one.

    With `starting`, a system that still starts counts too.
    """
    systems = running_systems(notes, starting=starting)
    if run is not None:
        systems = [system for system in systems if system.folder == str(run.resolve())]
    if len(systems) == 1:
        return systems[0]
    if not systems:
        if run is not None:
            raise InputError(
                f"no system runs in {run}: it has ended, or is still starting; dlokit ps lists the running systems."
            )
        raise InputError("no system runs: start one, e.g. dlokit shape --runtime live.")
    raise InputError("several systems run; choose one with --run: " + ", ".join(system.folder for system in systems))


def still_runs(system: RunningSystem, notes: Path | None = None) -> bool:
    """Whether its decision process still runs."""
    return is_held(_note_of(system.pid, notes))


def is_ending(system: RunningSystem, notes: Path | None = None) -> bool:
    """Whether a system stops its processes, or has ended since its note was read."""
    note = _note_of(system.pid, notes)
    now = _read(note)
    return now is None or now.ending or not is_held(note)


def systems_of(notes: Iterable[bytes]) -> list[RunningSystem]:
    """The systems of notes that were read before."""
    return [system for note in notes if (system := _decoded(note)) is not None]


def _read(note: Path) -> RunningSystem | None:
    """The system of a note; None if there is no such note, or an unreadable one."""
    try:
        return _decoded(note.read_bytes())
    except FileNotFoundError:
        return None


def _decoded(note: bytes) -> RunningSystem | None:
    try:
        return msgspec.json.decode(note, type=RunningSystem)
    except msgspec.DecodeError:
        return None


def _note_of(pid: int, notes: Path | None) -> Path:
    return (notes or user_folder()) / f"{pid}.json"
