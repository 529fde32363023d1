"""What `import dlokit`, the configuration and the quick commands load: asked of one interpreter, step by step."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from dlokit.errors import EXIT_BAD_INPUT

pytestmark = pytest.mark.smoke

HANGS_S = 120.0
SCIPY = {f"scipy.{part}" for part in ("interpolate", "linalg", "ndimage", "optimize", "sparse", "spatial", "stats")}
"""`import scipy` alone is small: it loads each of these when it is first used."""
DRAWING = {"matplotlib", "viser", "numba", "scipy.stats", "pandas", "pyarrow"}
SETTINGS = (
    "settings must not wait for libraries: they stand beside the class that they build, whose module imports none that "
    "is large. Compiled functions have modules of their own (`compiled.py` beside `mixture.py`), imported where "
    "they are called; of SciPy write `import scipy` and, where it is used, `scipy.spatial.KDTree`; "
    "`python -X importtime -c 'import dlokit.system.config'` shows which it is"
)
COMMAND = """
import contextlib, io
from dlokit.app.main import run
sys.argv = ['dlokit', *{line!r}]
with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
    run({line!r})
"""


@dataclass(frozen=True)
class Step:
    """What is done next, and what has not been loaded after it."""

    statement: str
    forbidden: set[str]
    why: str = ""


def command(*line: str) -> Step:
    return Step(COMMAND.format(line=line), {"mujoco", "numba", "viser", "cv2", "mink"})


STEPS = {
    "import dlokit": Step("import dlokit; dir(dlokit)", {"numpy", "dlokit.errors"}),
    "--version": Step(COMMAND.format(line=["--version"]), {"numpy", "mujoco", "scipy", "zenoh", *DRAWING}),
    "the list of commands": Step("import dlokit.app.commands", {"numpy", "mujoco", "zenoh", *DRAWING}),
    "the configuration": Step(
        "from dlokit.system.config import RunConfig; RunConfig()",
        {"numba", "mujoco", "cv2", "matplotlib", "cryptography", "OpenGL", *SCIPY},
        SETTINGS,
    ),
    "skills": command("skills"),
    "call": command("call"),
    "ps": command("ps"),
    "stop": command("stop"),
    "enable": command("enable"),
    "shape --help": command("shape", "--help"),
}
"""Later steps may load more: a step that loads too much fails in its own name, and those after it too."""
SCRIPT = """
import json, sys
told = sys.stdout
for statement in json.loads(sys.argv[1]):
    exec(statement, {'sys': sys})
    print(json.dumps(sorted(sys.modules)), file=told)
"""


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[str]]:
    """The modules that are loaded after each step."""
    empty = str(tmp_path_factory.mktemp("no-systems"))  # the notes of running systems: `stop` must find none
    statements = json.dumps([step.statement for step in STEPS.values()])
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, statements],
        env=os.environ | {"DLOKIT_RUNTIME_DIR": empty},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        timeout=HANGS_S,
    )
    return {step: set(json.loads(line)) for step, line in zip(STEPS, done.stdout.splitlines(), strict=True)}


@pytest.mark.parametrize("name", STEPS)
def test_a_quick_command_loads_no_library_that_it_does_not_use(name: str, loaded: dict[str, set[str]]) -> None:
    step = STEPS[name]
    assert sorted(step.forbidden & loaded[name]) == [], step.why


def test_importing_dlokit_loads_no_other_module_of_it(loaded: dict[str, set[str]]) -> None:
    needed = {"dlokit.cache_folder"}  # it sets what libraries read when they are loaded
    assert {name for name in loaded["import dlokit"] if name.startswith("dlokit.")} == needed


def test_a_command_runs_in_that_interpreter(loaded: dict[str, set[str]]) -> None:
    assert {"numpy", "dlokit.app.operate.stop", "dlokit.app.shape.shape"} <= loaded["shape --help"]


@pytest.mark.parametrize("module", ["dlokit", "dlokit.app.main"])
def test_python_runs_the_package_as_the_command_does(module: str) -> None:
    by_name, by_module = (
        subprocess.run([*start, "nonsense"], capture_output=True, text=True, timeout=HANGS_S, check=False)
        for start in ([Path(sys.executable).with_name("dlokit")], [sys.executable, "-m", module])
    )
    assert by_name.returncode == by_module.returncode == EXIT_BAD_INPUT
    assert by_name.stderr == by_module.stderr
    assert "nonsense" in by_name.stderr


WITHOUT_CELL = """
import sys
from dlokit.errors import CELL_MODULES
sys.modules.update(dict.fromkeys(CELL_MODULES))  # importing one of them fails, as in a plain installation
import dlokit.app.doctor.doctor, dlokit.app.data.track, dlokit.app.data.info
"""


def test_doctor_and_what_tracks_need_nothing_of_the_cell() -> None:
    command = (sys.executable, "-c", WITHOUT_CELL)
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANGS_S, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["shape", "judge", "live", "bench"])
def test_what_needs_the_cell_names_the_extra_where_it_is_not_installed(name: str) -> None:
    command = (sys.executable, "-c", f"{WITHOUT_CELL}dlokit.{name}")
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANGS_S, check=False)
    assert f"dlokit.{name} needs dlokit's extra `cell`, which is not installed: " in done.stderr
