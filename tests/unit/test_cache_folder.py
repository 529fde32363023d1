"""Libraries find a folder for what they keep, on machines whose home or sources cannot be written too."""

import os
import stat
import tempfile
from pathlib import Path

import pytest

from dlokit.cache_folder import compiled_code_folder, prepare_libraries
from dlokit.errors import MachineError


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


@pytest.fixture
def sealed(tmp_path: Path) -> str:
    """A place where nobody may write, root neither: a file, under which no folder can be."""
    file = tmp_path / "file"
    file.touch()
    return str(file / "folder")


def test_a_cache_folder_that_can_be_written_stays(temporary: Path) -> None:
    environ = {"HOME": str(temporary / "home-to-be")}
    prepare_libraries(environ)
    assert environ == {"HOME": str(temporary / "home-to-be")}


@pytest.mark.parametrize("home", ["sealed", "~", "XDG_CACHE_HOME"])
def test_without_a_home_that_can_be_written_libraries_keep_their_files_in_a_private_folder(
    home: str, temporary: Path, sealed: str
) -> None:
    environ = {"HOME": "~"} if home == "~" else {"HOME": sealed}  # "~": as Python says for a user who is in no list
    if home == "XDG_CACHE_HOME":
        environ = {"HOME": str(temporary), "XDG_CACHE_HOME": sealed}
    prepare_libraries(environ)

    folder = Path(environ["XDG_CACHE_HOME"])
    assert folder.parent == temporary
    assert (stat.S_IMODE(folder.stat().st_mode), folder.stat().st_uid) == (0o700, os.getuid())
    assert environ["MPLCONFIGDIR"] == str(folder / "matplotlib")
    assert compiled_code_folder(environ, sources=sealed) == str(folder / "numba")
    again = {"HOME": sealed}
    prepare_libraries(again)
    assert again["XDG_CACHE_HOME"] == str(folder)


def test_a_private_folder_that_others_may_write_or_have_linked_is_not_used(
    temporary: Path, sealed: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    name = temporary / f"dlokit-cache-{os.getuid()}"
    name.mkdir()
    name.chmod(0o770)
    for _ in range(2):
        environ = {"HOME": sealed}
        prepare_libraries(environ)
        assert environ == {"HOME": sealed}
        name.rmdir() if not name.is_symlink() else name.unlink()
        name.symlink_to(tmp_path_factory.mktemp("of-another-user"))


def test_the_users_own_folder_comes_first_then_the_sources_then_the_cache_folder(tmp_path: Path, sealed: str) -> None:
    sources, own, cache = (str(tmp_path / name) for name in ("sources", "own", "cache"))
    environ = {"NUMBA_CACHE_DIR": own, "XDG_CACHE_HOME": cache}
    assert compiled_code_folder(environ, sources) == own
    environ["NUMBA_CACHE_DIR"] = sealed
    assert compiled_code_folder(environ, sources) == sources
    assert compiled_code_folder(environ, sealed) == str(Path(cache, "numba"))


def test_no_folder_at_all_is_said_with_what_was_tried_and_what_to_set(sealed: str) -> None:
    with pytest.raises(MachineError, match=rf"none of {sealed}, {sealed}/numba can be written. Set NUMBA_CACHE_DIR"):
        compiled_code_folder({"XDG_CACHE_HOME": sealed}, sealed)


def test_the_backend_of_a_notebook_that_is_not_installed_here_is_replaced(temporary: Path) -> None:
    installed, missing = "module://matplotlib.backends.backend_agg", "module://no_such_package.backend_inline"
    for backend, used in {installed: installed, missing: "agg", "svg": "svg"}.items():
        environ = {"HOME": str(temporary), "MPLBACKEND": backend}
        prepare_libraries(environ)
        assert environ["MPLBACKEND"] == used
