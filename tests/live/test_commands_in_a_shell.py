"""The command line in a shell: completion, libraries of OpenGL, and ports that other programs have."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from dlokit.app.commands import execute
from dlokit.errors import EXIT_BAD_INPUT, InputError

DLOKIT = str(Path(sys.executable).with_name("dlokit"))
HANGS_S = 120.0


def _run(*command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, env=os.environ | environment, capture_output=True, text=True, timeout=HANGS_S, check=False
    )


@pytest.mark.parametrize("runtime", ["lockstep", "live"])
def test_the_error_for_a_port_in_use_proposes_another_one(runtime: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=rf"port {port} .*--port"):
            execute(["shape", "--runtime", runtime, "--port", str(port)])


def test_a_run_without_opengl_ends_before_it_starts(tmp_path: Path) -> None:
    hidden = {"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent", "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent"}
    ended = _run(DLOKIT, "shape", "--headless", "--out", str(tmp_path / "run"), **hidden)
    assert ended.returncode == EXIT_BAD_INPUT, ended.stderr
    assert "OpenGL" in ended.stderr
    assert "`dlokit doctor` prints the command" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert ended.stdout == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("back_end", ["osmesa", "glfw", "nonsense"])
def test_the_back_end_that_the_shell_names_for_other_programs_does_not_matter(back_end: str) -> None:
    ended = _run(DLOKIT, "graph", "flow", MUJOCO_GL=back_end, PYOPENGL_PLATFORM=back_end)
    assert ended.returncode == 0, ended.stderr


COMPLETED = {
    "shap": ["shape"],
    "shape --thresh": ["--threshold-m"],
    "bench obs": ["observers"],
    "doctor fr": ["franka"],
    "doctor franka --driver.addr": ["--driver.address"],
    "doctor --viewer": ["--viewer-host"],
}
COMPLETING = """
source $0
function=$(complete -p dlokit | sed 's/.*-F \\([^ ]*\\) .*/\\1/')
for line in "$@"; do
    COMP_WORDS=(dlokit $line); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); COMPREPLY=()
    $function
    echo ${COMPREPLY[@]}
done
"""


@pytest.fixture(scope="module")
def completed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """What bash makes of each line, with the script that `dlokit completion bash` prints."""
    script = tmp_path_factory.mktemp("completion") / "dlokit.bash"
    script.write_text(_run(DLOKIT, "completion", "bash").stdout, encoding="utf-8")
    done = _run("bash", "-c", COMPLETING, str(script), *COMPLETED)
    assert done.stderr == ""
    return dict(zip(COMPLETED, map(str.split, done.stdout.splitlines()), strict=True))


@pytest.mark.parametrize("typed", COMPLETED)
def test_a_shell_completes_commands_and_options(typed: str, completed: dict[str, list[str]]) -> None:
    assert completed[typed] == COMPLETED[typed]
