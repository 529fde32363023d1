"""Notes of running systems: any shell can find them, and they vanish with their system."""

import fcntl
import os
import stat
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from dlokit.errors import InputError
from dlokit.system.processes.running import announced, is_ending, running_systems, still_runs, the_running_system
from dlokit.system.processes.sockets import LocalBus

BUS = LocalBus(namespace="dlokit/mine", folder=Path("/run/mine"))


def test_a_system_is_found_while_it_runs_and_not_after(tmp_path: Path) -> None:
    with announced(Path("runs/mine"), BUS, tmp_path) as note:
        note.ready()
        system = the_running_system(None, tmp_path)
        assert system == the_running_system(Path("runs/mine"), tmp_path)
        assert system.bus.namespace == "dlokit/mine"
        assert system.bus.connect == ("unixsock-stream//run/mine/bus",)
        assert system.bus.login == BUS.login
        assert BUS.key not in repr(system)
        assert BUS.key not in repr(system.bus)
        (file,) = tmp_path.glob("*.json")
        assert stat.S_IMODE(file.stat().st_mode) == 0o600  # it has the key
        with pytest.raises(InputError, match="no system runs in"):
            the_running_system(Path("runs/other"), tmp_path)
    with pytest.raises(InputError, match="no system runs"):
        the_running_system(None, tmp_path)


def test_a_starting_system_can_only_be_stopped(tmp_path: Path) -> None:
    with announced(Path("runs/mine"), BUS, tmp_path) as note:
        assert running_systems(tmp_path) == []
        with pytest.raises(InputError, match="no system runs"):
            the_running_system(None, tmp_path)
        assert the_running_system(None, tmp_path, starting=True).starting
        note.ready()
        assert not the_running_system(None, tmp_path).starting


def test_a_system_that_stops_its_processes_is_ending_and_one_that_has_ended_too(tmp_path: Path) -> None:
    with announced(Path("runs/mine"), BUS, tmp_path) as note:
        (system,) = running_systems(tmp_path, starting=True)
        assert not is_ending(system, tmp_path)
        note.ready()
        assert not is_ending(system, tmp_path)
        note.ending()
        assert is_ending(system, tmp_path)
        assert the_running_system(None, tmp_path).ending
    assert is_ending(system, tmp_path)


def test_the_note_of_a_killed_system_is_removed(tmp_path: Path) -> None:
    with announced(Path("runs/mine"), BUS, tmp_path) as note:
        note.ready()
        (system,) = running_systems(tmp_path)
        # Its process id is that of a running process: the parent of this one.
        left = msgspec.structs.replace(system, pid=os.getppid())
        file = tmp_path / f"{left.pid}.json"
        file.write_bytes(msgspec.json.encode(left))
        assert not still_runs(left, tmp_path)
        assert running_systems(tmp_path) == [system]
        assert not file.exists()
        assert still_runs(system, tmp_path)


@pytest.mark.live
def test_a_killed_system_leaves_a_note_without_a_lock(tmp_path: Path) -> None:
    script = (
        "import sys, time\nfrom pathlib import Path\nfrom dlokit.system.processes.running import announced\n"
        "from dlokit.system.processes.sockets import LocalBus\n"
        "with announced(Path('x'), LocalBus(namespace='dlokit/x', folder=Path('y')), Path(sys.argv[1])) as note:\n"
        "    note.ready()\n"
        "    print('there', flush=True)\n    time.sleep(60.0)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script, str(tmp_path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"there\n"
        assert [system.pid for system in running_systems(tmp_path)] == [process.pid]
        process.kill()
    assert running_systems(tmp_path) == []


def test_with_several_systems_one_must_be_named(tmp_path: Path) -> None:
    with announced(Path("runs/mine"), BUS, tmp_path) as note:
        note.ready()
        (system,) = running_systems(tmp_path)
        other = msgspec.structs.replace(system, folder="/elsewhere/theirs")
        file = tmp_path / "other.json"
        file.write_bytes(msgspec.json.encode(other))
        with file.open("rb") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            with pytest.raises(InputError, match="/elsewhere/theirs"):
                the_running_system(None, tmp_path)
            assert the_running_system(Path("/elsewhere/theirs"), tmp_path).folder == "/elsewhere/theirs"
