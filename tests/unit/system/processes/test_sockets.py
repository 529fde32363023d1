"""The folder of a user's sockets: for nobody else, and short enough for the path of a socket."""

import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from dlokit.errors import MachineError
from dlokit.system.processes import runtime_folder
from dlokit.system.processes.runtime_folder import LONGEST_SOCKET, ROOM, RUNTIME_DIR, private_folder, user_folder
from dlokit.system.processes.sockets import local_bus, remove_sockets


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a short name, in which the user's folder is made instead of in /tmp."""
    folder = Path(tempfile.mkdtemp(prefix="dlk"))
    monkeypatch.setattr(runtime_folder, "PARENT", folder)
    return folder


def test_every_shell_of_a_user_finds_the_same_folder_which_is_only_for_this_user(
    short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = short / "other"
    other.mkdir(mode=0o700)
    for variable in ("XDG_RUNTIME_DIR", "TMPDIR", "TEMP", "TMP", "HOME"):
        monkeypatch.setenv(variable, str(other))
    monkeypatch.delenv(RUNTIME_DIR)
    monkeypatch.setattr(tempfile, "tempdir", None)  # read again
    found = user_folder(os.environ)
    assert found == user_folder({}) == short / f"dlokit-{os.getuid()}"
    assert stat.S_IMODE(found.stat().st_mode) == 0o700


def test_sockets_fit_into_the_folder_of_every_user() -> None:
    assert len(os.fsencode(runtime_folder.PARENT / f"dlokit-{2**32 - 1}")) + ROOM <= LONGEST_SOCKET


def test_a_user_chooses_a_folder_apart_from_that_of_his_other_systems(short: Path) -> None:
    chosen = {RUNTIME_DIR: str(short / "own"), "XDG_RUNTIME_DIR": "/proc/1"}
    assert user_folder(chosen) == short / "own"
    assert stat.S_IMODE((short / "own").stat().st_mode) == 0o700


def test_a_chosen_folder_that_is_too_long_is_refused_by_the_name_of_its_variable(short: Path) -> None:
    with pytest.raises(MachineError, match=f"{RUNTIME_DIR} is .* too long .* name a shorter one"):
        user_folder({RUNTIME_DIR: str(short / ("r" * 80))})


def test_the_sockets_of_a_process_fit_into_the_path_of_a_socket() -> None:
    with local_bus("x") as bus:
        (path,) = bus.process("simulation", ("simulation",)).listen
        assert len(path.removeprefix("unixsock-stream/")) <= LONGEST_SOCKET


def test_a_bus_has_a_folder_and_a_key_of_its_own_until_its_end() -> None:
    with local_bus("x") as one, local_bus("x") as other:
        assert one.folder != other.folder
        assert one.key != other.key
        assert stat.S_IMODE(one.folder.stat().st_mode) == 0o700
        assert one.key not in repr(one)
        assert one.key not in repr(one.process("robot", ("robot",)))
    assert not one.folder.exists()


def test_what_a_killed_system_has_left_is_removed_and_nothing_elsewhere(short: Path) -> None:
    left, elsewhere = user_folder() / "left", short / "elsewhere"
    left.mkdir()
    elsewhere.mkdir()
    remove_sockets(f"unixsock-stream/{left}/bus")
    remove_sockets(f"unixsock-stream/{elsewhere}/bus")
    assert not left.exists()
    assert elsewhere.exists()


def a_link(path: Path) -> None:
    target = path.with_name("theirs")
    target.mkdir(mode=0o700)
    path.symlink_to(target)


def a_file(path: Path) -> None:
    path.touch(mode=0o600)


def an_open_folder(path: Path) -> None:
    path.mkdir()
    path.chmod(0o770)


@pytest.mark.parametrize(
    ("made", "said"), [(a_link, "is not a folder"), (a_file, "is not a folder"), (an_open_folder, "has mode 770")]
)
def test_a_folder_that_another_user_could_have_prepared_is_refused(
    tmp_path: Path, made: Callable[[Path], None], said: str
) -> None:
    made(tmp_path / "dlokit-1")
    with pytest.raises(MachineError, match=f"{said}.*remove it, or set {RUNTIME_DIR}"):
        private_folder(tmp_path / "dlokit-1")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may give a folder to another user")
def test_a_folder_of_another_user_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "dlokit-1"
    folder.mkdir(mode=0o700)
    os.chown(folder, 65534, 65534)
    with pytest.raises(MachineError, match="belongs to another user"):
        private_folder(folder)
