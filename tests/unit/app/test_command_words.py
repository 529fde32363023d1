"""The first words of the command line: the version, a misspelt command, other ways to start, completion."""

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from dlokit.app.commands import execute, parse
from dlokit.app.shape.demo import DemoArgs
from dlokit.errors import InputError


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, timeout=60.0, check=False)


@pytest.mark.parametrize("module", ["dlokit", "dlokit.app.main"])
def test_python_runs_the_package_as_the_command_does(module: str) -> None:
    assert python("-m", module, "--version").stdout == f"dlokit {version('dlokit')}\n"
    assert python("-m", module, "nonsense").returncode == 2


def test_the_version_loads_no_large_library() -> None:
    listing = python(
        "-c",
        "import sys; sys.argv = ['dlokit', '--version']; from dlokit.app.main import main; main(); print(*sys.modules)",
    ).stdout
    assert not set(listing.split()) & {"numpy", "mujoco", "scipy", "zenoh", "numba", "matplotlib"}


@pytest.mark.parametrize(("typed", "meant"), [(["shpae"], "shape"), (["bench", "shapin"], "shaping")])
def test_a_misspelt_command_is_refused_with_the_most_similar_one(typed: list[str], meant: str) -> None:
    with pytest.raises(InputError, match=f"'{typed[-1]}'.*'{meant}'"):
        execute(typed)


def test_the_viewers_port_has_one_name() -> None:
    demo = parse(["demo", "--port", "8090"])
    assert isinstance(demo, DemoArgs)
    assert demo.port == 8090
    assert parse(["shape", "--port", "8090"]).run.viewer.port == 8090
    assert parse(["doctor", "--port", "8090"]).port == 8090


COMPLETED = {
    "shap": ["shape"],
    "shape --thresh": ["--threshold-m"],
    "bench obs": ["observers"],
    "doctor fr": ["franka"],
    "doctor franka --driver.addr": ["--driver.address"],
    "doctor --viewer": ["--viewer-host"],
}


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `dlokit completion bash` prints."""
    path = tmp_path_factory.mktemp("completion") / "dlokit.bash"
    path.write_text(python("-m", "dlokit", "completion", "bash").stdout, encoding="utf-8")
    return path


@pytest.mark.parametrize("typed", COMPLETED)
def test_a_shell_completes_commands_and_options(typed: str, script: Path) -> None:
    words = ["dlokit", *typed.split()]
    asked = (
        f"source {script}; function_of() {{ complete -p dlokit | sed 's/.*-F \\([^ ]*\\) .*/\\1/'; }}; "
        f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; $(function_of); echo ${{COMPREPLY[@]}}"
    )
    done = subprocess.run(["bash", "-c", asked], capture_output=True, text=True, timeout=60.0, check=False)
    assert done.stdout.split() == COMPLETED[typed], done.stderr
