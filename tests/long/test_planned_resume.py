"""`dlokit resume --dry-run` of a run whose decision process was killed: the next action is planned, nothing moves."""

import subprocess
from pathlib import Path

import numpy as np
from live_systems import DLOKIT, HANGS_S, has_looked, wait_until

from dlokit.system.results.run_result import read_result
from dlokit.types.flow import RunOutcome


def test_a_dry_run_of_a_killed_run_leaves_its_dlo_untouched(tmp_path: Path) -> None:
    killed, planned = tmp_path / "killed", tmp_path / "planned"
    command = (DLOKIT, "shape", "--runtime", "live", "--headless", "--out", str(killed))
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        try:
            wait_until(lambda: has_looked(killed), run)
        finally:
            run.kill()
    again = (DLOKIT, "resume", str(killed), "--dry-run", "--out", str(planned))
    done = subprocess.run(again, capture_output=True, text=True, timeout=HANGS_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert read_result(planned).outcome is RunOutcome.DRY_RUN
    with np.load(planned / "truth.npz") as truth:
        assert np.abs(truth["nodes_world"][-1] - truth["nodes_world"][0]).max() < 1e-3  # it settles, nobody touches it
