"""The commands that errors advise."""

import importlib.util
import shlex
import sys
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from dlokit import errors
from dlokit.app.commands import name_of
from dlokit.communication import strategies
from dlokit.errors import MachineError, install_command, missing_extra, pip_command, require_cell

CLONE = Path(__file__).parents[2]


@pytest.fixture
def path_with_a_blank(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/home/a person/venv/bin/python")


@pytest.mark.usefixtures("path_with_a_blank")
def test_an_extra_of_a_wheel_is_installed_by_its_name_into_the_python_that_runs(tmp_path: Path) -> None:
    command = shlex.split(install_command("cell", tmp_path))
    assert command == ["/home/a person/venv/bin/python", "-m", "pip", "install", "dlokit[cell]"]


@pytest.mark.usefixtures("path_with_a_blank")
def test_an_extra_of_a_clone_is_installed_from_the_clone_which_no_index_has() -> None:
    command = shlex.split(install_command("cell"))
    assert command == ["/home/a person/venv/bin/python", "-m", "pip", "install", "-e", f"{CLONE}[cell]"]


def test_an_environment_without_pip_is_one_of_uv(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errors, "find_spec", lambda name: None if name == "pip" else importlib.util.find_spec(name))
    command = ["uv", "pip", "install", "--python", sys.executable, "ray[client]"]
    assert shlex.split(pip_command("ray[client]")) == command


def test_a_missing_module_of_the_cell_names_the_command_and_the_extra_but_not_the_module() -> None:
    error = missing_extra(
        ModuleNotFoundError(name="rtbdata.meshes"), f"dlokit {name_of(['bench', 'shaping', '--quick'])}"
    )
    assert str(error).startswith("dlokit bench shaping needs dlokit's extra `cell`, which is not installed: ")
    assert str(error).endswith("[cell]'")
    assert "rtb" not in str(error)
    assert missing_extra(ModuleNotFoundError(name="no_such_module"), "dlokit shape") is None


def test_a_part_of_a_package_that_needs_the_cell_is_skipped_with_the_extra_and_not_the_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "part_of_the_cell.py").write_text("import zenoh.no_such_part")
    monkeypatch.syspath_prepend(tmp_path)
    entry = EntryPoint("bags", "part_of_the_cell:FORMAT", "dlokit.exports")
    monkeypatch.setattr(strategies, "entry_points", lambda group: [entry])  # pyright: ignore[reportUnknownLambdaType]
    assert list(strategies.from_packages("dlokit.exports", lambda value: None, "a format")) == []
    assert "needs dlokit's extra `cell`, which is not installed: " in caplog.text
    assert "zenoh" not in caplog.text


def test_the_cell_is_required_by_the_name_of_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def found(name: str) -> ModuleSpec | None:
        return None if name == "trimesh" else importlib.util.find_spec(name)

    monkeypatch.setattr(errors, "find_spec", found)
    with pytest.raises(MachineError, match=r"^dlokit\.shape needs dlokit's extra `cell`, (?!.*trimesh).*\[cell\]"):
        require_cell("dlokit.shape")
