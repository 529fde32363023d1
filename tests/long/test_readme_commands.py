"""The commands of README and of the page of all commands run as written, with the outcome that is described there.

About ten minutes.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = ("README.md", "docs/reference/commands.md")
OF_A_RUN = "runs/<run>"
LIMIT_S = 900.0

NOT_RUN = {
    "make": "installs dlokit, or runs the tests",
    "dlokit shape --runtime live --goal interactive": "waits for a person",
    "dlokit shape --goal my_curve.csv": "a file of the reader",
    "dlokit track cloud.pcd": "a file of the reader",
    "dlokit track --camera realsense": "a device",
    "dlokit track --camera recorded --camera.path my_bag": "a bag of the reader",
    "python -m dlokit.testing camera realsense": "a device",
    "dlokit view": "stays until Ctrl-C",
    "dlokit record": "needs a running system, and stays until Ctrl-C",
    "dlokit call": "needs a running system",
    "dlokit stop": "would stop other systems of this user",
    "dlokit enable": "would enable the arms of other systems of this user",
    "dlokit ps": "needs a running system",
    "dlokit certs": "for several machines",
    "dlokit resume": "needs a run that was cut off",
    "dlokit bench": "takes too long",
    'eval "$(dlokit completion bash)"': "for a shell",
}
"""How commands begin that are not run here, and why."""


def lines_of(page: str) -> list[str]:
    """The commands of a page, without their comments."""
    fences = re.findall(r"^```sh\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    lines = [re.split(r"\s+# ", line)[0].strip() for fence in fences for line in fence.splitlines()]
    return [line for line in lines if line]


def is_listed(line: str) -> bool:
    return any(line == begin or line.startswith(f"{begin} ") for begin in NOT_RUN)


LINES = list(dict.fromkeys(line for page in PAGES for line in lines_of(page)))
RUN_HERE = [line for line in LINES if line.startswith("dlokit ") and not is_listed(line)]
SHAPE = [line for line in RUN_HERE if line.startswith("dlokit shape") and OF_A_RUN not in line]
OTHERS = [line for line in RUN_HERE if line not in SHAPE]


def dlokit(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    if not (folder / "examples").exists():
        (folder / "examples").symlink_to(ROOT / "examples")
    (folder / "mine.toml").write_text("task.threshold_m = 0.008\n", encoding="utf-8")  # the page's example of a file
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
    """A folder with one run of the pages' example with another DLO."""
    made = tmp_path_factory.mktemp("readme")
    (line,) = [line for line in SHAPE if "silicone" in line]
    assert dlokit(f"{line} --headless --out {OF_A_RUN.replace('<run>', 'one')}", made).returncode == 0
    return made


@pytest.mark.parametrize("line", OTHERS)
def test_a_command_that_only_reads_succeeds(line: str, folder: Path) -> None:
    done = dlokit(line.replace("<run>", "one").replace("<other>", "one"), folder)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_command_of_the_pages_is_run_or_listed_as_not_runnable() -> None:
    assert [line for line in LINES if line not in RUN_HERE and not is_listed(line)] == []
    assert [begin for begin in NOT_RUN if not any(f"{line} ".startswith(f"{begin} ") for line in LINES)] == []
    assert len(SHAPE) >= 5
    assert len(OTHERS) >= 6


def test_readme_has_no_command_that_the_page_of_all_commands_lacks() -> None:
    readme, page = (lines_of(name) for name in PAGES)
    assert [line for line in readme if line not in page and not line.startswith("make ")] == []
