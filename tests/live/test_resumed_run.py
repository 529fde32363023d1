"""The decision process is killed during a run: no process remains, and another run resumes it."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil

from dlokit.errors import InputError
from dlokit.system.results.journal_file import read_journal
from dlokit.system.results.run_result import read_result
from dlokit.types.flow import RunOutcome

WAIT_S = 300.0  # a live run takes half a minute of two idle cores
DLOKIT = str(Path(sys.executable).with_name("dlokit"))


def has_looked(folder: Path) -> bool:
    try:
        return bool(read_journal(folder).errors_m)
    except InputError:
        return False


def resume(*arguments: str) -> "subprocess.CompletedProcess[str]":
    command = (DLOKIT, "resume", *arguments)
    return subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)


def test_a_run_whose_decision_process_is_killed_resumes_to_its_goal(tmp_path: Path) -> None:
    killed, resumed = tmp_path / "killed", tmp_path / "resumed"
    command = (DLOKIT, "shape", "--runtime", "live", "--headless", "--out", str(killed))
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        end_s = time.monotonic() + WAIT_S
        while not has_looked(killed):
            assert time.monotonic() < end_s
            assert run.poll() is None
        children = psutil.Process(run.pid).children(recursive=True)
        run.kill()
    _, alive = psutil.wait_procs(children, timeout=WAIT_S)
    assert not alive

    planned = resume(str(killed), "--dry-run", "--out", str(tmp_path / "planned"))
    assert planned.returncode == 0, planned.stdout + planned.stderr
    assert read_result(tmp_path / "planned").outcome is RunOutcome.DRY_RUN
    with np.load(tmp_path / "planned" / "truth.npz") as truth:
        assert np.abs(truth["nodes_world"][-1] - truth["nodes_world"][0]).max() < 1e-3  # it settles, nobody touches it

    done = resume(str(killed), "--out", str(resumed))
    assert done.returncode == 0, done.stdout + done.stderr
    assert read_result(resumed).outcome is RunOutcome.CONVERGED
    # A run that has ended normally cannot be resumed.
    again = resume(str(resumed))
    assert again.returncode == 2
    assert "ended as converged" in " ".join(again.stderr.split())
