"""Each study beside the package starts, measures with its smallest input, and writes its figures."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import msgspec
import psutil
import pytest
from genicam_cameras import why_not

FOLDER = Path(__file__).parents[3] / "benchmarks"
LIMIT_S = 400.0  # for a live run to start and end on a busy machine
QUICK = {
    "bus": ("--repeats", "2", "--slow-s", "0.1"),
    "calibration": ("--seeds", "2", "--poses", "12"),
    "camera_latency": ("--seeds", "1"),
    "environments": ("--parts", "expert", "--episodes", "1"),
    "feasibility": ("--seeds", "1", "--dlos", "soft_rope"),
    "fixture_costs": ("--repeats", "2"),
    "fixtures_seen": ("--seeds", "1"),
    "franka_tracking": ("--repeats", "1"),
    "gate_values": ("--values", "20", "--calls", "1"),
    "genicam_driver": ("--pairs", "5"),
    "hops": (),
    "lay_downs": ("--count", "1"),
    "page": ("--seconds", "1"),
    "post_motions": ("--count", "1"),
    "realsense_driver": ("--frames", "6"),
    "robot_at_exposure": ("--speed-m-s", "0.5"),
    "shown_goals": ("--seeds", "1"),
    "simulation": ("--repeats", "1"),
    "stopped_carries": ("--seeds", "1"),
    "tracker_overhead": ("--clouds", "3"),
    "tuning": ("cpd", "--budget", "1", "--frames", "3"),
    "verdict_rounding": ("--goals", "1"),
    "video_export": (str(FOLDER.parent / "tests" / "replay" / "references" / "farthest.mcap"), "--times", "1"),
    "wrong_fixtures": ("--seeds", "1"),
}
STILL = ("--kills", "0", "--freezes", "0", "--feedback-losses", "0")
LIVE = {
    "faults": ("--faults", "kill-viewer", "--runs", "1", "--out", "runs"),
    "franka_twin": ("--starts", "S", "--seeds", "1"),
    "latency": ("--goal", "I", "--limit-s", "60"),
    "no_false_brakes": ("--minutes", "0.01", "--busy", "0", "--pages", "0"),
    "soak": ("0.02",),
    "stop_press": ("--times", "1"),
    "stops": (*STILL, "--quiet-s", "2", "--presses", "1", "--busy", "0"),
}
"""These run `dlokit shape` live, or are live runs themselves."""


WITH_ROS = {"ros2_pictures", "ros2_runs"}
"""These need an installed ROS 2: `make test-ros`."""
OPTIONAL = {"realsense_driver": "pyrealsense2", "franka_tracking": "franky_sim", "franka_twin": "franky_sim"}
"""The optional package that a study needs."""


@pytest.mark.parametrize("name", QUICK)
def test_a_study_runs_and_writes_its_figures(name: str, tmp_path: Path) -> None:
    if name in OPTIONAL:
        pytest.importorskip(OPTIONAL[name], reason=f"{OPTIONAL[name]} is not installed")
    if name == "genicam_driver" and (reason := why_not()):
        pytest.skip(reason)
    _runs(name, QUICK[name], tmp_path)


@pytest.mark.parametrize("name", LIVE)
def test_a_study_of_live_runs_runs_and_writes_its_figures(name: str, tmp_path: Path) -> None:
    if name in OPTIONAL:
        pytest.importorskip(OPTIONAL[name], reason=f"{OPTIONAL[name]} is not installed")
    _runs(name, LIVE[name], tmp_path)


def test_every_study_is_run_here_and_listed_on_the_page() -> None:
    studies = {path.stem for path in FOLDER.glob("*.py")}
    assert studies == QUICK.keys() | LIVE.keys() | WITH_ROS
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert [name for name in sorted(studies) if f"`python benchmarks/{name}.py" not in page] == []


def test_an_invalid_argument_is_refused_in_one_line() -> None:
    ended = subprocess.run(
        (sys.executable, FOLDER / "bus.py", "--repeats", "0"), capture_output=True, text=True, timeout=LIMIT_S
    )
    assert ended.returncode == 2
    assert ended.stderr == "bus.py: --repeats 0 must be at least 1, and --slow-s 5.0 not negative.\n"


def test_ctrl_c_ends_a_study_and_the_system_that_it_started() -> None:
    command = (sys.executable, FOLDER / "stops.py", *STILL, "--quiet-s", str(LIMIT_S), "--presses", "0", "--busy", "0")
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as study:
        assert study.stdout is not None
        assert "quiet motion left" in study.stdout.readline()
        started = psutil.Process(study.pid).children(recursive=True)
        study.send_signal(signal.SIGINT)
        _, said = study.communicate(timeout=LIMIT_S)
    assert (study.returncode, said) == (130, "")
    assert psutil.wait_procs(started, timeout=LIMIT_S)[1] == []


def _runs(name: str, smallest: tuple[str, ...], folder: Path) -> None:
    figures = folder / "figures.json"
    ended = subprocess.run(
        (sys.executable, FOLDER / f"{name}.py", *smallest, "--json", figures),
        cwd=folder,
        env={**os.environ, "TERM": "dumb"},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert msgspec.json.decode(figures.read_bytes())["rows"]
