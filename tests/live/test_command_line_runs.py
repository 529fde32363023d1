"""`dlokit shape` as a whole: concurrent runs repeat, a run can be repeated, and a signal stops it with a result."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from dlokit.system.results.run_result import read_result
from dlokit.types.flow import RunOutcome

DLOKIT = str(Path(sys.executable).with_name("dlokit"))
BACKGROUND = ("sh", "-c", 'trap "" INT; exec "$0" "$@"')
"""Starts a command as a script with & does: it ignores SIGINT."""
LIMIT_S = 180.0  # an action takes 3 s of an idle core
MACHINE_TIMES = ("wall_time_s", "planning_time_s")


def _start(*arguments: str, by: tuple[str, ...] = ()) -> subprocess.Popen[str]:
    command = (*by, DLOKIT, "shape", "--headless", *arguments)
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def _figures(folder: Path) -> dict[str, Any]:
    figures: dict[str, Any] = json.loads((folder / "result.json").read_text())
    for row in figures["history"]:
        del row["planning_time_s"]
    return {name: value for name, value in figures.items() if name not in MACHINE_TIMES}


def test_two_concurrent_runs_and_one_from_the_configuration_give_equal_results(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("one", "two", "again")]
    both = [
        _start("--max-actions", "1", "--seed", "7", "--threshold-m", "0.002", "--out", str(folder))
        for folder in folders[:2]
    ]
    for run in both:
        output, _ = run.communicate(timeout=LIMIT_S)
        assert run.returncode == 3, output
    again = _start("--config", str(folders[0] / "config.toml"), "--out", str(folders[2]))
    again.communicate(timeout=LIMIT_S)

    first = _figures(folders[0])
    assert first["outcome"] == "budget"
    assert first["actions"] == 1
    assert _figures(folders[1]) == first
    assert _figures(folders[2]) == first


def test_the_end_of_a_login_ends_a_run_in_the_background_as_cancelled_with_result_and_report(tmp_path: Path) -> None:
    goal = ("--threshold-m", "0.0001", "--infeasible", "try")
    with _start(*goal, "--out", str(tmp_path / "out"), by=BACKGROUND) as run:
        assert run.stdout is not None
        for line in run.stdout:
            if line.startswith("action 1"):
                break
        run.send_signal(signal.SIGTERM)
        run.send_signal(signal.SIGHUP)
        output, _ = run.communicate(timeout=LIMIT_S)

    assert run.returncode == 3, output
    result = read_result(tmp_path / "out")
    assert result.outcome is RunOutcome.CANCELLED
    assert result.actions >= 1
    assert (tmp_path / "out" / "report.html").is_file()
    assert result.reason in ("stopped by SIGTERM", "stopped by SIGHUP (terminal closed)")
    assert "stopped by" in output
    assert "operator" not in output


def test_a_live_run_that_is_stopped_while_its_processes_start_has_result_and_report(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with _start("--runtime", "live", "--out", str(out)) as run:
        while not (out / "start.npy").exists():  # which the processes read
            assert run.poll() is None
            time.sleep(0.05)
        run.send_signal(signal.SIGINT)
        output, _ = run.communicate(timeout=LIMIT_S)

    assert run.returncode == 3, output
    assert read_result(out).outcome is RunOutcome.CANCELLED
    assert "nothing has moved" in output
    assert "missing" not in output
    assert "Traceback" not in output
    assert (out / "report.html").is_file()


def test_a_recorded_run_is_shown_until_ctrl_c() -> None:
    recording = Path(__file__).parents[1] / "replay" / "references" / "wire.mcap"
    command = (sys.executable, "-m", "dlokit", "view", str(recording), "--port", "0")
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as showing:
        assert showing.stdout is not None
        try:
            assert "http://127.0.0.1:" in showing.stdout.readline()
            showing.send_signal(signal.SIGINT)
            assert showing.wait(timeout=LIMIT_S) == 0
            assert showing.stdout.read().strip() == "the page is closed"
        finally:
            showing.kill()
