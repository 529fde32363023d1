"""A run on two machines without a cell: arm and camera on one, whose clock the other follows.

The machines are network namespaces; that of the arm also has a monotonic clock of its own, as another machine has.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import own_lab
import pytest
from installed_packages import install
from lab_network import lab_network, why_not

from dlokit.description import shapes
from dlokit.extras.hosts.certificates import hosts_from_words, make_certificates
from dlokit.recording.reader import read_recording
from dlokit.types.system import ClockTick

AHEAD_S = 500_000
"""By how much the clock of the arm's machine is ahead."""
OTHER_CLOCK = ("unshare", "--time", f"--monotonic={AHEAD_S}", "--boottime=0")
DLOKIT = str(Path(sys.executable).with_name("dlokit"))
LIMIT_S = 600.0  # a minute on two idle cores


def _no_clocks() -> str:
    if shutil.which("unshare") is None:
        return "clocks of their own need util-linux"
    tried = subprocess.run((*OTHER_CLOCK, "true"), capture_output=True)
    return "" if tried.returncode == 0 else "this kernel or container allows no time namespaces"


WHY_NOT = why_not() or _no_clocks()
pytestmark = [pytest.mark.skipif(WHY_NOT != "", reason=WHY_NOT)]

LAB = """
runtime = "live"
headless = true
goal = "S"

[camera]
kind = "own-camera"

[driver]
kind = "own-arm"

[hosts]
endpoint = "tls/{address}:7447"
certificates = "{folder}"
wait_s = 120.0

[hosts.runs]
desk = ["decision", "simulation"]
lab = ["robot", "camera", "observer"]
"""


def test_a_task_runs_by_the_clock_of_the_machine_with_arm_and_camera(tmp_path: Path) -> None:
    for entry, group, target in (
        ("own-camera", "dlokit.cameras", "own_lab:OwnCameraConfig"),
        ("own-arm", "dlokit.robots", "own_lab:OwnArmConfig"),
    ):
        install(tmp_path / entry, entry, group, {entry: target}, {})
    np.save(tmp_path / "table.npy", shapes.builtin_shape("I", 0.5, 101))
    packages = (tmp_path / "own-camera", tmp_path / "own-arm", Path(own_lab.__file__).parent)
    env = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(map(str, packages)),
        own_lab.TABLE: str(tmp_path / "table.npy"),
    }
    with lab_network("desk", "lab") as network:
        hosts = hosts_from_words((f"desk={network.address('desk')}", "lab"))
        make_certificates(tmp_path / "certificates", hosts)
        config = tmp_path / "lab.toml"
        config.write_text(LAB.format(address=network.address("desk"), folder=tmp_path / "certificates"))
        serve = (*OTHER_CLOCK, DLOKIT, "host", "lab", "--config", str(config))
        with (
            (tmp_path / "host.log").open("w") as log,
            subprocess.Popen(
                network.inside("lab", *serve), cwd=tmp_path, env=env, stdout=log, stderr=log, start_new_session=True
            ) as host,
        ):
            try:
                done = subprocess.run(
                    network.inside(
                        "desk", DLOKIT, "shape", "--config", str(config), "--operator-confirms", "--out", "run"
                    ),
                    cwd=tmp_path,
                    env=env,
                    capture_output=True,
                    text=True,
                    timeout=LIMIT_S,
                    check=False,
                )
            finally:
                host.terminate()
                host.wait(60.0)

    assert done.returncode == 0, done.stdout + done.stderr + (tmp_path / "host.log").read_text()
    result = msgspec.json.decode((tmp_path / "run" / "result.json").read_bytes())
    assert result["outcome"] == "converged"
    assert result["true_rmse_m"] is None
    ticks = [one.message for one in read_recording(tmp_path / "run" / "recording.mcap", {"cell/clock"})]
    assert ticks
    assert all(isinstance(tick, ClockTick) and tick.stamp_ns > AHEAD_S * 10**9 for tick in ticks)
