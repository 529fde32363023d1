"""The heart alone: with `dlokit/extras` removed a rope is shaped, and every annexe says by name that it is missing."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

import dlokit
from dlokit.app.commands import COMMANDS, all_commands


@pytest.fixture(scope="module")
def heart(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, str]:
    """An environment whose `dlokit` has no annexes."""
    folder = tmp_path_factory.mktemp("heart")
    (package,) = dlokit.__path__
    shutil.copytree(package, folder / "dlokit", ignore=shutil.ignore_patterns("extras"))
    return {**os.environ, "PYTHONPATH": str(folder)}


def called(heart: Mapping[str, str], folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = (sys.executable, "-m", "dlokit", *arguments)
    return subprocess.run(command, env=heart, cwd=folder, capture_output=True, text=True, timeout=600, check=False)


@pytest.mark.parametrize("runtime", ["lockstep", "live"])
def test_a_rope_is_shaped_recorded_and_replayed(heart: Mapping[str, str], tmp_path: Path, runtime: str) -> None:
    one_action = ("--headless", "--seed", "3", "--max-actions", "1", "--out", "run")
    shaped = called(heart, tmp_path, "shape", "--runtime", runtime, *one_action)
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["outcome"] in {"converged", "budget"}, shaped.stderr
    assert result["actions"]
    assert (tmp_path / "run" / "report.html").is_file()
    replayed = called(heart, tmp_path, "replay", "run", "--into", "observer")
    # Live, a message may reach the observer in another order than it was recorded in.
    assert replayed.returncode in ({0} if runtime == "lockstep" else {0, 1}), replayed.stderr
    assert "observer/targets" in replayed.stdout
    assert "skipped" not in shaped.stderr + replayed.stderr


def test_every_command_of_an_annexe_names_what_is_missing(heart: Mapping[str, str], tmp_path: Path) -> None:
    added = {name: module for name, module in all_commands().items() if name not in COMMANDS}
    assert len(added) > 10
    script = (
        "import sys; from dlokit.app.commands import execute; from dlokit.errors import MachineError\n"
        "for name in sys.stdin.read().splitlines():\n"
        "    try: execute(name.split())\n"
        "    except MachineError as error: print(error)"
    )
    said = subprocess.run(
        (sys.executable, "-c", script), input="\n".join(added), env=heart, cwd=tmp_path, capture_output=True, text=True,
        timeout=120, check=True,
    ).stdout.splitlines()  # fmt: skip
    assert said == [
        f"`dlokit {name}` needs {module}, which is missing: install its package again."
        for name, module in added.items()
    ]


@pytest.mark.parametrize("name", ["dlokit.gym", "dlokit.testing", "dlokit.bench"])
def test_a_public_name_of_an_annexe_names_what_is_missing(heart: Mapping[str, str], tmp_path: Path, name: str) -> None:
    command = (sys.executable, "-c", f"import {name}")
    said = subprocess.run(command, env=heart, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert said.returncode == 1
    assert "No module named 'dlokit.extras'" in said.stderr
