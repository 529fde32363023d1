"""The example packages are installed as a user would install them, and work through their entry points."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
PACKAGES = ("observer_package", "planner_package", "robot_package", "speed_package")
DLOKIT = str(Path(sys.executable).with_name("dlokit"))


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment in a separate folder, in which the packages are installed."""
    folder = tmp_path_factory.mktemp("installed")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-index", "--no-deps", "--no-build-isolation", "--target", str(folder)]
    packages = [str(EXAMPLES / package) for package in PACKAGES]
    subprocess.run([*pip, *offline, *packages], check=True, timeout=120, capture_output=True)
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    return os.environ | {"PYTHONPATH": path}


def run(environment: dict[str, str], *command: str) -> str:
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.mark.parametrize(
    ("package", "passed"),
    [("observer_package", "8 passed"), ("planner_package", "4 passed"), ("robot_package", "4 passed")],
)
def test_its_own_tests_pass(environment: dict[str, str], tmp_path: Path, package: str, passed: str) -> None:
    config = ("-c", os.devnull, "--rootdir", str(tmp_path), "-p", "no:cacheprovider")
    ended = run(environment, sys.executable, "-m", "pytest", *config, str(EXAMPLES / package / "tests"))
    assert passed in ended or "3 passed, 1 skipped" in ended  # without the description of the UR5e


def test_it_tracks_recorded_clouds(environment: dict[str, str], tmp_path: Path) -> None:
    line = np.column_stack([np.linspace(0.0, 0.5, 800), np.zeros(800), np.full(800, 0.004)])
    for number in range(2):
        np.save(tmp_path / f"{number}.npy", line + np.array([0.0, 0.01 * number, 0.0]))
    clouds = [str(tmp_path / f"{number}.npy") for number in range(2)]
    run(environment, DLOKIT, "track", *clouds, "--observer", "pulled", "--out", str(tmp_path / "out"))
    nodes = np.load(tmp_path / "out" / "nodes.npy")
    # Half of the noise-free shift would show an observer that lags.
    np.testing.assert_allclose((nodes[1] - nodes[0])[:, 1], 0.01, atol=0.005)


def test_it_shapes_in_lockstep_with_settings_that_the_run_keeps(environment: dict[str, str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    choice = ("--observer", "pulled", "--observer.strategy.steps", "12")
    run(environment, DLOKIT, "shape", "--headless", "--start", "I", "--goal", "I", *choice, "--out", str(out))
    assert json.loads((out / "result.json").read_text())["outcome"] == "converged"
    assert 'kind = "pulled"\nsteps = 12\n' in (out / "config.toml").read_text()


@pytest.mark.parametrize("runtime", ["lockstep", "live"])
def test_an_observer_with_a_memory_shapes_and_its_recording_has_the_memory(
    environment: dict[str, str], tmp_path: Path, runtime: str
) -> None:
    out = str(tmp_path / "out")
    shape = ("shape", "--headless", "--start", "I", "--goal", "I", "--observer", "kalman", "--runtime", runtime)
    run(environment, DLOKIT, *shape, "--out", out)
    if runtime == "lockstep":  # of a live run it is not recorded which state the observer had when a cloud came
        replayed = run(environment, DLOKIT, "replay", out, "--into", "observer")
        assert "memory.velocity_m_s" in replayed
        assert "observer reproduces the recording" in replayed
    run(environment, DLOKIT, "export", out, "--to", "npz", "--out", str(tmp_path / "tables"))
    with np.load(tmp_path / "tables" / "observer_targets.npz") as table:
        assert "memory.covariance" in table.files


def test_it_is_benchmarked_with_the_built_in_observers(environment: dict[str, str], tmp_path: Path) -> None:
    found = run(
        environment,
        sys.executable,
        "-c",
        "from dlokit.extras.bench.observers.methods import choose; "
        "print([method.name for method in choose(('pulled', 'anchored')).methods])",
    )
    assert "'pulled', 'pulled, pinned'" in found


def test_its_planner_is_chosen_with_settings_that_the_run_keeps(environment: dict[str, str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    choice = ("--planner", "along", "--planning.strategy.reach-m", "0.1")
    run(environment, DLOKIT, "shape", "--headless", "--start", "I", "--goal", "I", *choice, "--out", str(out))
    assert json.loads((out / "result.json").read_text())["outcome"] == "converged"
    assert 'kind = "along"\nreach_m = 0.1\n' in (out / "config.toml").read_text()


def test_its_driver_is_found_and_says_that_no_controller_answers(environment: dict[str, str], tmp_path: Path) -> None:
    check = (sys.executable, "-m", "dlokit.testing", "robot", "lab-arm", "--driver.port", "1", "--operator-confirms")
    ended = subprocess.run(
        check, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False
    )
    assert ended.returncode == 1
    assert "the controller at 127.0.0.1:1 does not answer" in ended.stdout


@pytest.mark.parametrize("runtime", ["lockstep", "live"])
def test_a_component_runs_along_and_a_command_reads_what_it_published(
    environment: dict[str, str], tmp_path: Path, runtime: str
) -> None:
    run_folder = str(tmp_path / "run")
    shape = ("shape", "--headless", "--start", "I", "--goal", "I", "--runtime", runtime, "--out", run_folder)
    run(environment, DLOKIT, *shape)
    assert "speeds, at most" in run(environment, DLOKIT, "speed", run_folder)
    assert "speed/node" in run(environment, DLOKIT, "info", run_folder)
