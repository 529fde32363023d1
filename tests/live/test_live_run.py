"""Live runs with all processes: the rope is shaped although one dies, and Ctrl-C and a stop leave no process."""

import asyncio
import itertools
import os
import signal
import subprocess
import time
from pathlib import Path

import psutil
import pytest
from live_systems import DLOKIT, HANGS_S, LOOK_S, has_looked, started_by, wait_until

from dlokit.communication.topics import DEPTH_IMAGES, OBSERVER_EVENT, PROTECTION, SEGMENTATION, TOPICS
from dlokit.errors import EXIT_INTERRUPTED
from dlokit.evaluation.judged_run import judged_run
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.summary import summarise
from dlokit.system.config import RunConfig
from dlokit.system.job import job_from_config
from dlokit.system.processes.first_press import STOP
from dlokit.system.processes.report import read_report
from dlokit.system.processes.running import the_running_system
from dlokit.system.processes.stop_socket import Answer, press, stop_socket
from dlokit.system.results.run_result import read_result
from dlokit.system.shaping import Watcher
from dlokit.types.flow import FlowStatus, RunOutcome

LIVE = RunConfig(runtime="live", headless=True)


class Killer(Watcher):
    """Kills one child process once, during an action."""

    def __init__(self, victim: str) -> None:
        self._victim = victim
        self.done = False

    def step(self, status: FlowStatus) -> None:
        if status.step == "move_to_goal" and not self.done:
            self.done = True
            started_by(psutil.Process().pid)[self._victim].kill()


@pytest.mark.parametrize(
    "victim",
    [
        pytest.param("observer", marks=pytest.mark.smoke),
        *(pytest.param(name, marks=pytest.mark.long) for name in ("camera", "simulation")),
    ],
)
def test_the_rope_is_shaped_by_all_processes_together_although_one_is_killed_and_restarted(
    tmp_path: Path, victim: str
) -> None:
    killer = Killer(victim)
    record = judged_run(LIVE, job_from_config(LIVE), tmp_path, killer)
    assert killer.done
    result = record.result
    assert result.outcome is RunOutcome.CONVERGED, result
    assert result.rmse_m is not None
    assert result.rmse_m < result.threshold_m
    # The bound of the shaping task: the estimated error is correct within 2 mm.
    assert result.true_rmse_m is not None
    assert result.true_rmse_m < 0.014
    assert not started_by(psutil.Process().pid)
    report = read_report(tmp_path)
    assert report is not None
    assert {process.name: process.restarts for process in report.processes if process.restarts} == {victim: 1}
    recorded = summarise(tmp_path / FILE_NAME)
    assert not recorded.missing
    assert set(recorded.channels) >= {topic.name for topic in TOPICS if topic.publisher != "viewer"} - {
        OBSERVER_EVENT.name,  # the DLO was not lost
        DEPTH_IMAGES.name,  # the camera is a stereo pair
        SEGMENTATION.name,  # no call changed it
        PROTECTION.name,  # the arm is a simulated one
    }
    # Every action that held the DLO carried it; one whose grasp missed, as may happen on a busy machine, did not.
    carried = sum(action.grasp_ok and action.ended_by is None for action in result.history)
    assert carried >= 1
    assert recorded.calls["robot.follow_path"].outcomes["succeeded"] == carried
    assert recorded.last_step is not None
    assert recorded.last_step.outcome is RunOutcome.CONVERGED


def test_a_run_opens_only_the_viewers_port_shows_its_key_nowhere_and_ctrl_c_leaves_its_result_and_no_process(
    tmp_path: Path,
) -> None:
    command = (DLOKIT, "shape", "--runtime", "live", "--port", "0", "--out", str(tmp_path))
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as run:
        try:
            wait_until(lambda: has_looked(tmp_path), run)
            system = the_running_system(tmp_path)
            children = started_by(run.pid)
            processes = [psutil.Process(run.pid), *psutil.Process(run.pid).children(recursive=True)]
            listening = {
                connection.laddr.port: process.cmdline()[-1]
                for process in processes
                for connection in process.net_connections(kind="inet")
                if connection.status == psutil.CONN_LISTEN
            }
            assert list(listening.values()) == ["viewer"]
            for process in processes:
                shown = itertools.chain(process.cmdline(), process.environ().values())
                assert not any(system.key in text for text in shown)
        finally:
            run.send_signal(signal.SIGINT)
            output, _ = run.communicate(timeout=HANGS_S)
    assert run.returncode == 3, output.decode()
    result = read_result(tmp_path)
    assert result.outcome is RunOutcome.CANCELLED
    assert result.reason == "stopped by SIGINT (Ctrl-C)"
    assert (tmp_path / "report.html").is_file()
    assert {"cell", "robot", "camera", "observer", "simulation", "viewer"} <= set(children)
    _, alive = psutil.wait_procs(processes, timeout=HANGS_S)
    assert not alive
    written = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()]
    assert any(b"\x89MCAP" in data for data in written)
    assert not any(system.key.encode() in data for data in (*written, output))
    assert not Path(system.endpoint.removeprefix("unixsock-stream/")).parent.exists()


class Presser(Watcher):
    """Stops the arm once, at its stop socket, when it begins to approach the rope."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.pressing: asyncio.Task[Answer | None] | None = None
        self.stopped: list[bool] = []

    def arms_stopped(self, stopped: bool) -> None:
        self.stopped.append(stopped)

    def step(self, status: FlowStatus) -> None:
        if status.step == "approach" and self.pressing is None:
            self.pressing = asyncio.create_task(press(stop_socket(self._folder, ""), STOP, HANGS_S))


def test_a_run_whose_arm_is_stopped_in_a_motion_ends_as_cancelled_by_the_process_that_pressed(tmp_path: Path) -> None:
    presser = Presser(tmp_path)
    result = judged_run(LIVE, job_from_config(LIVE), tmp_path, presser).result
    assert presser.pressing is not None
    assert presser.pressing.done()
    assert presser.stopped == [True]
    assert result.outcome is RunOutcome.CANCELLED
    assert result.reason is not None
    assert f"by process {os.getpid()} (" in result.reason
    assert result.true_rmse_m is not None  # of the shape at the end: nothing was released
    assert not started_by(psutil.Process().pid)


def test_of_an_ending_run_a_second_ctrl_c_says_what_a_third_costs_which_ends_it_at_once(tmp_path: Path) -> None:
    command = (DLOKIT, "shape", "--runtime", "live", "--headless", "--out", str(tmp_path))
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as run:
        assert run.stdout is not None
        wait_until(lambda: has_looked(tmp_path), run)
        processes = started_by(run.pid)
        processes["camera"].suspend()  # the run waits some seconds for its end
        try:
            run.send_signal(signal.SIGINT)
            lines = iter(run.stdout.readline, "")
            first, limit = next(line for line in lines if "the arms brake" in line), next(lines)
            run.send_signal(signal.SIGINT)
            assert any("Ctrl-C again ends the program at once" in line for line in lines)
            while run.poll() is None:  # the key is held until the sentence can have been read
                run.send_signal(signal.SIGINT)
                time.sleep(LOOK_S)
            rest = run.stdout.read()
        finally:
            processes["camera"].resume()
    assert run.returncode == EXIT_INTERRUPTED, rest
    assert first.startswith("SIGINT (Ctrl-C): ")
    assert "at most" in limit
    assert "ended at once: arms that still move brake on their own" in rest
    assert not (tmp_path / "result.json").exists()
    assert summarise(tmp_path / FILE_NAME).channels
    _, alive = psutil.wait_procs(list(processes.values()), timeout=HANGS_S)
    assert not alive
