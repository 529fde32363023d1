"""Notes of running systems: found by any shell, gone with their system."""

from pathlib import Path

import msgspec
import pytest

from dlokit.errors import InputError
from dlokit.system.running import announced, running_systems, the_running_system


def test_a_system_is_found_while_it_runs_and_not_after(tmp_path: Path) -> None:
    with announced(Path("runs/mine"), "dlokit/mine", "tcp/127.0.0.1:7447", tmp_path):
        system = the_running_system(None, tmp_path)
        assert system == the_running_system(Path("runs/mine"), tmp_path)
        assert system.bus.namespace == "dlokit/mine"
        assert system.bus.connect == ("tcp/127.0.0.1:7447",)
        with pytest.raises(InputError, match="no system runs in"):
            the_running_system(Path("runs/other"), tmp_path)
    with pytest.raises(InputError, match="no system runs"):
        the_running_system(None, tmp_path)


def test_the_note_of_a_killed_system_is_removed_though_its_number_is_used_again(tmp_path: Path) -> None:
    with announced(Path("runs/mine"), "dlokit/mine", "tcp/127.0.0.1:7447", tmp_path):
        (note,) = tmp_path.glob("*.json")
        (system,) = running_systems(tmp_path)
        note.write_bytes(msgspec.json.encode(msgspec.structs.replace(system, began_s=system.began_s - 10.0)))
        assert running_systems(tmp_path) == []
        assert not note.exists()


def test_several_systems_are_named_and_one_must_be_said(tmp_path: Path) -> None:
    with announced(Path("runs/mine"), "dlokit/mine", "tcp/127.0.0.1:7447", tmp_path):
        (system,) = running_systems(tmp_path)
        other = msgspec.structs.replace(system, folder="/elsewhere/theirs")
        (tmp_path / "other.json").write_bytes(msgspec.json.encode(other))
        with pytest.raises(InputError, match="/elsewhere/theirs"):
            the_running_system(None, tmp_path)
        assert the_running_system(Path("/elsewhere/theirs"), tmp_path).folder == "/elsewhere/theirs"
