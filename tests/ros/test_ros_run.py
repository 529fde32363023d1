"""A live run in the cell that is published in real ROS 2, and stopped from there."""

import os
import signal
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import psutil
from live_systems import DLOKIT, HANGS_S, has_looked, started_by, wait_until
from ros_lab import RosNetwork

from dlokit.system.processes.stop_socket import CONFIRMED_STOP

RUNTIME = Path(os.environ["DLOKIT_RUNTIME_DIR"])
LASTING = {
    "/dlokit/goal": "nav_msgs/msg/Path",
    "/dlokit/markers": "visualization_msgs/msg/MarkerArray",
    "/dlokit/status": "diagnostic_msgs/msg/DiagnosticStatus",
}


@contextmanager
def shaping(run: Path) -> Generator["subprocess.Popen[bytes]"]:
    """`dlokit shape --runtime live --ros2` from I to S, beside the test, which kills what is left of it."""
    command = (DLOKIT, "shape", "--runtime", "live", "--headless", "--ros2", "--out", str(run))
    with run.with_suffix(".log").open("wb") as output:
        program = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
    try:
        yield program
    finally:
        with_children = [psutil.Process(program.pid), *psutil.Process(program.pid).children(recursive=True)]
        if program.poll() is None:
            program.send_signal(signal.SIGCONT)
            program.terminate()
        try:
            program.wait(HANGS_S)
        finally:
            for process in with_children:
                if process.is_running():
                    process.kill()


def test_a_run_is_published_and_its_arm_is_stopped_from_ros_while_its_other_processes_are_dead(
    lab: RosNetwork, tmp_path: Path, tf: None
) -> None:
    lab.bridge(RUNTIME)
    run, status = tmp_path / "run", lab.listener()
    status.order("subscribe", topic="/dlokit/status", type=LASTING["/dlokit/status"], transient_local=True)
    with shaping(run) as program:
        wait_until(lambda: has_looked(run), program)
        late = lab.listener("late")
        for topic, kind in LASTING.items():
            late.order("subscribe", topic=topic, type=kind, transient_local=True, depth=1)
        late.order("subscribe", topic="/tf_static", type="tf2_msgs/msg/TFMessage", transient_local=True, depth=10)
        late.order("subscribe", topic="/dlokit/joint_states", type="sensor_msgs/msg/JointState")
        heard = {topic: late.hear("message", topic=topic)["fields"] for topic in LASTING}
        assert len(heard["/dlokit/goal"]["poses"]) == 31
        assert {one["ns"] for one in heard["/dlokit/markers"]["markers"]} >= {"state", "goal", "workspace"}
        transforms = late.hear("message", topic="/tf_static")["fields"]["transforms"]
        children = {one["child_frame_id"]: one["header"]["frame_id"] for one in transforms}
        assert children == {"dlokit_world": "base_link", "dlokit_camera": "dlokit_world"}
        joints = late.hear("message", topic="/dlokit/joint_states")["fields"]["name"]
        assert joints[0] == "panda_joint1"

        process = started_by(program.pid)["ros"]
        process.kill()
        program.send_signal(signal.SIGSTOP)
        late.order("call", service="/dlokit/stop", within_s=HANGS_S)
        answer = late.hear("called", within_s=HANGS_S)

        assert answer["success"], answer
        assert CONFIRMED_STOP in answer["message"]
        program.send_signal(signal.SIGCONT)
        # The process starts again, and says so to the node, which has waited for it.
        stopped = ""
        while "stopped by a person" not in stopped:
            stopped = status.hear("message", topic="/dlokit/status", within_s=HANGS_S)["fields"]["message"]


def test_the_stop_is_answered_when_ros_and_decision_were_killed(lab: RosNetwork, tmp_path: Path) -> None:
    lab.bridge(RUNTIME)
    caller, run = lab.listener(), tmp_path / "run"
    with shaping(run) as program:
        wait_until(lambda: has_looked(run), program)
        robot = started_by(program.pid)["robot"]
        robot.suspend()  # it would end with its commander, and this is about one that has not yet
        started_by(program.pid)["ros"].kill()
        program.kill()
        caller.order("call", service="/dlokit/stop", within_s=HANGS_S)
        robot.resume()
        answer = caller.hear("called", within_s=HANGS_S)
    # Either the arm has confirmed its stop, or its process has ended by then, which brakes it first, and nothing else
    # is called a success.
    assert answer["success"] is (CONFIRMED_STOP in answer["message"])
    assert answer["success"] or "no robot process of dlokit runs" in answer["message"]
