"""`dlokit.live`: a system whose skills a script calls, and what a script sees when it fails."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

import dlokit
from dlokit.app.library import live_skills
from dlokit.app.operate.skills import all_skills
from dlokit.errors import ProcessFailure

SCRIPT = """
import asyncio
import time

import dlokit


async def notebook():
    with dlokit.live(start="I", out="run", progress=False) as system:
        cloud = system.perception.look()
        system.observer.initialise()
        assert len(cloud.points_world) > 100
        until = time.monotonic() + 10.0
        while system.state is None and time.monotonic() < until:
            time.sleep(0.05)
        assert system.state.nodes_world.shape == (31, 3)
        verdict = system.planning.judge_goal(system.model.set_goal(system.state.nodes_world), 0.01)
        assert verdict.standing.value == "holds", verdict
        assert system.robot.home().duration_s >= 0.0
        try:
            system.robot.release(width_m=-0.01)
        except dlokit.SkillRejected as error:
            assert error.reason == "bad_width"
        else:
            raise AssertionError("not rejected")
    return system


system = asyncio.run(notebook())
assert system.recording().state.nodes_world.shape[1:] == (31, 3)
try:
    system.perception.look()
except dlokit.DlokitError as error:
    print(error)
"""


def test_a_script_without_a_main_guard_calls_skills_inside_a_running_loop(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=180, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "inside the `with` block" in done.stdout
    assert done.stderr == ""


def test_the_death_of_a_process_is_an_error_by_name(tmp_path: Path) -> None:
    def lose_the_cell() -> None:
        with dlokit.live(out=tmp_path / "run", progress=False) as system:
            (cell,) = (child for child in started_processes() if "cell" in child.cmdline())
            os.kill(cell.pid, signal.SIGKILL)
            system.robot.home()

    with pytest.raises(ProcessFailure, match="cell"):
        lose_the_cell()
    assert not started_processes()


def started_processes() -> list[psutil.Process]:
    """The processes of the system's table, without workers."""
    children = psutil.Process().children()
    return [child for child in children if any("dlokit" in word for word in child.cmdline())]


def test_every_skill_that_people_call_is_a_method() -> None:
    methods = {
        method.skill.key
        for skills in vars(live_skills).values()
        if isinstance(skills, type) and issubclass(skills, live_skills.Skills)
        for method in vars(skills).values()
        if isinstance(method, live_skills.SkillMethod)
    }
    own = {"robot.renew_lease", "robot.release_lease", "robot.confirm_start"}  # the system's
    assert methods == {key for key in all_skills() if not key.startswith("cell.")} - own
