"""`dlokit.live`: a system whose skills a script calls."""

import subprocess
import sys
from pathlib import Path

from live_systems import HANGS_S

SCRIPT = f"""
import asyncio
import time

import dlokit


async def notebook():
    with dlokit.live(start="I", out="run", progress=False) as system:
        cloud = system.perception.look()
        system.observer.initialise()
        assert len(cloud.points_world) > 100
        until = time.monotonic() + {HANGS_S / 2}
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
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=HANGS_S, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "inside the `with` block" in done.stdout
    assert done.stderr == ""
