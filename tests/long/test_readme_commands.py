"""The commands of README run as written, with the outcome that README describes: about ten minutes."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
(USE,) = re.findall(r"## Use it\n\n```sh\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
LINES = [line.split("  #")[0].strip() for line in USE.splitlines()]
NEEDS_A_PERSON_OR_A_SYSTEM = (
    "interactive",
    "my_curve.csv",
    "cloud.pcd",
    "realsense",
    "certs",
    "record",
    "call",
    "stop",
    "enable",
    "ps",
    "view",
)
"""Commands that wait for a person, a device, a running system, or a file of the reader."""
LONG_BENCHES = ("dlokit bench", "dlokit resume")
OF_A_RUN = "runs/<run>"
LIMIT_S = 900.0


def is_run_here(line: str) -> bool:
    words = shlex.split(line)
    waits = any(word in NEEDS_A_PERSON_OR_A_SYSTEM for word in words)
    return line.startswith("dlokit ") and not waits and not line.startswith(LONG_BENCHES)


SHAPE = [line for line in LINES if is_run_here(line) and line.startswith("dlokit shape") and OF_A_RUN not in line]
OTHERS = [line for line in LINES if is_run_here(line) and line not in SHAPE]


def dlokit(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    if not (folder / "examples").exists():
        (folder / "examples").symlink_to(ROOT / "examples")
    command = [sys.executable, "-m", "dlokit", *shlex.split(line)[1:]]
    return subprocess.run(
        command, cwd=folder, env=os.environ, capture_output=True, text=True, timeout=LIMIT_S, check=False
    )


@pytest.mark.parametrize("line", SHAPE)
def test_a_shape_command_converges(line: str, tmp_path: Path) -> None:
    done = dlokit(f"{line} --headless", tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    (run,) = (tmp_path / "runs").iterdir()
    for name in ("report.html", "result.json", "config.toml", "recording.mcap", "truth.npz"):
        assert (run / name).is_file()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one run of README's example with another DLO."""
    made = tmp_path_factory.mktemp("readme")
    (line,) = [line for line in SHAPE if "silicone" in line]
    assert dlokit(f"{line} --headless --out {OF_A_RUN.replace('<run>', 'one')}", made).returncode == 0
    return made


@pytest.mark.parametrize("line", OTHERS)
def test_a_command_that_only_reads_succeeds(line: str, folder: Path) -> None:
    done = dlokit(line.replace("<run>", "one"), folder)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_command_of_readme_is_run_or_listed_as_not_runnable() -> None:
    assert len(SHAPE) >= 5
    assert len(OTHERS) >= 6
