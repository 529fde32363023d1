"""The table of commands is correct, and a command loads no library that it does not use."""

import inspect
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from dlokit import app
from dlokit.app.commands import COMMANDS, GROUPS, CliCommand

LARGE = ("matplotlib", "viser", "numba", "scipy.stats", "pandas", "pyarrow")


def command_of(name: str) -> CliCommand[object]:
    return import_module(f"dlokit.app.{COMMANDS[name].module}").COMMAND


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_has_each_commands_own_summary(name: str) -> None:
    help_page = inspect.getdoc(command_of(name).arguments)
    assert help_page is not None
    assert help_page.split("\n\n")[0].replace("\n", " ") == COMMANDS[name].summary


def test_every_module_with_a_command_is_in_the_table() -> None:
    (folder,) = app.__path__
    modules = (path for path in Path(folder).rglob("*.py") if "\nCOMMAND = " in path.read_text(encoding="utf-8"))
    holding = {".".join(path.relative_to(folder).with_suffix("").parts) for path in modules}
    assert holding == {row.module for row in COMMANDS.values()}


def test_a_command_of_two_words_begins_with_a_group_or_with_the_command_that_it_goes_on() -> None:
    assert {name.split()[0] for name in COMMANDS if " " in name} == {*GROUPS, "doctor"}
    assert not set(GROUPS) & set(COMMANDS)


def imported_by(statement: str) -> set[str]:
    listing = subprocess.run(
        [sys.executable, "-c", f"import sys\n{statement}\nprint(*sys.modules)"],
        check=True,
        capture_output=True,
        text=True,
        timeout=60.0,
    )
    return set(listing.stdout.split())


def test_the_list_of_commands_loads_no_large_library() -> None:
    assert not imported_by("import dlokit.app.main") & {*LARGE, "numpy", "mujoco", "zenoh"}


@pytest.mark.parametrize(
    "line", [["skills"], ["call"], ["ps"], ["stop"], ["enable"], ["shape", "--help"]], ids=" ".join
)
def test_commands_that_only_look_something_up_load_no_library_of_the_running_system(
    line: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("TMPDIR", "XDG_RUNTIME_DIR"):  # the folder of the notes of running systems: `stop` must find none
        monkeypatch.setenv(name, str(tmp_path))
    statement = (
        f"import contextlib, io; sys.argv = ['dlokit', *{line}]\n"
        "from dlokit.app.main import main\n"
        "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n    main()\n"
    )
    assert not imported_by(statement) & {"mujoco", "numba", "viser", "cv2", "mink"}
