"""The decision process of a run freezes and is killed: its arm is stopped, no process remains, another run resumes."""

import asyncio
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import psutil
from live_systems import DLOKIT, HANGS_S, has_looked, wait_until

from dlokit.app.operate.stop import stop_all
from dlokit.communication import topics
from dlokit.system.processes.bus import join_bus
from dlokit.system.processes.running import the_running_system
from dlokit.system.results.run_result import read_result
from dlokit.system.table import TimeBase
from dlokit.types.flow import RunOutcome

KEPT = Path(__file__).parents[1] / "replay" / "kept"
MOVING_RAD_S = 0.2
FOUND_WITHIN_S = 10.0
"""A stop waits for as long for the answer of the decision process, which is frozen [s]."""
OUTLIVES_S = 1.0
"""The cell runs on for 2 s after its parent has died, so that its arm can brake [s]."""


async def stopped_while_frozen(run: "subprocess.Popen[bytes]", folder: Path) -> list[str]:
    """Freeze the decision process in a motion, and stop the arm; what `dlokit stop` says."""
    async with asyncio.timeout(HANGS_S):
        system = the_running_system(folder)
        async with join_bus(system.bus, TimeBase.MACHINE) as bus:
            async for state in bus.transport.stream(topics.ROBOT_STATE):
                if np.abs(state.dq_rad_s).max() > MOVING_RAD_S:
                    break
            run.send_signal(signal.SIGSTOP)
            said = list[str]()
            (stopped,) = await stop_all([system], FOUND_WITHIN_S, HANGS_S, say=said.append)
            assert not stopped.confirmed, "nobody said that the task ends"
            async for state in bus.transport.stream(topics.ROBOT_STATE):
                assert state.stop_latched
                break
    return said


def test_a_run_whose_decision_process_is_frozen_stopped_and_killed_resumes_to_its_goal(tmp_path: Path) -> None:
    killed, resumed = tmp_path / "killed", tmp_path / "resumed"
    command = (DLOKIT, "shape", "--runtime", "live", "--headless", "--out", str(killed))
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        try:
            wait_until(lambda: has_looked(killed), run)
            said = asyncio.run(stopped_while_frozen(run, killed))
            children = psutil.Process(run.pid).children(recursive=True)
            killed_s = time.time()
        finally:
            run.kill()
    # The arm's line does not wait for the frozen process.
    assert said[0] == f"{killed}: the first arm stands, and is stopped until dlokit enable"
    assert len(said) == 2
    _, alive = psutil.wait_procs(children, timeout=HANGS_S)
    assert not alive
    assert (killed / "logs" / "cell.log").stat().st_mtime - killed_s > OUTLIVES_S

    done = resume(killed, "--out", str(resumed))
    assert done.returncode == 0, done.stdout + done.stderr
    assert read_result(resumed).outcome is RunOutcome.CONVERGED
    # A run that has ended normally cannot be resumed.
    again = resume(resumed)
    assert again.returncode == 2
    assert "ended as converged" in " ".join(again.stderr.split())


def test_a_run_that_an_earlier_version_left_is_resumed(tmp_path: Path) -> None:
    killed = shutil.copytree(KEPT / "killed", tmp_path / "killed")
    done = resume(killed, "--out", str(tmp_path / "resumed"))
    assert done.returncode == 0, done.stdout + done.stderr
    assert read_result(tmp_path / "resumed").outcome is RunOutcome.CONVERGED


def resume(run: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    command = (DLOKIT, "resume", str(run), *arguments)
    return subprocess.run(command, capture_output=True, text=True, timeout=HANGS_S, check=False)
