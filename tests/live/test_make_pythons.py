"""What `make` runs on the Pythons of a machine: it takes each of them, whatever its path, and a failure is its own."""

import shutil
import subprocess
from pathlib import Path

import pytest

MAKEFILE = Path(__file__).parents[2] / "Makefile"

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is missing")


def smoked(folder: Path, pythons: str, dlokit: str = "true") -> subprocess.CompletedProcess[str]:
    """Run `make smoke-pythons`, where a script of the shell finds the Pythons, and another one is their dlokit."""
    scripts = {
        ".ci/pythons": pythons,
        ".ci/environment": 'echo "on [$1]" >&2; echo environment',
        "environment/bin/python": "echo Python",
        "environment/bin/dlokit": f'echo "did $1"; {dlokit}',
    }
    for name, text in scripts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
        path.chmod(0o755)
    made = ("make", "--file", MAKEFILE, "--old-file", "setup", "smoke-pythons")
    return subprocess.run(made, cwd=folder, capture_output=True, text=True, timeout=60, check=False)


def test_every_python_is_taken_also_one_in_a_folder_with_blanks(tmp_path: Path) -> None:
    done = smoked(tmp_path, "echo '/a folder/python3.13'; echo /usr/bin/python3.11")

    assert done.returncode == 0
    assert done.stderr.splitlines() == ["on [/a folder/python3.13]", "on [/usr/bin/python3.11]"]


@pytest.mark.parametrize("command", ["shape", "info", "export", "replay"])
def test_a_command_that_fails_on_a_python_fails_with_what_it_said(tmp_path: Path, command: str) -> None:
    done = smoked(tmp_path, "echo python3.13", f'test "$1" != {command}')

    assert done.returncode != 0
    assert f"did {command}" in done.stdout


def test_a_machine_without_a_python_fails(tmp_path: Path) -> None:
    assert smoked(tmp_path, "exit 1").returncode != 0
