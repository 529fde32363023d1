"""A commander of a Franka that can be killed or frozen: it moves the arm to and fro through the driver until it ends.

franka_commander.py ADDRESS FOLDER PACE, as a process of its own. Its first line of output names the processes.
"""

import asyncio
import contextlib
import ctypes
import json
import os
import signal
import sys
from pathlib import Path

import numpy as np

from dlokit.communication.timing.pulse import ThreadPulse
from dlokit.description.arm.franka import FR3
from dlokit.description.arm.model import ArmModel
from dlokit.description.arm.mounts import ArmMount
from dlokit.errors import SkillFailure
from dlokit.extras.franka.driver import FrankaRobot, FrankaRobotConfig
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move
from dlokit.types.robot import FIRST_ROBOT, Lease

AWAY_RAD = FR3.home_q_rad + np.array([0.9, 0.4, -0.5, 0.6, 0.4, 0.5, -0.6])
LEASE_S = 0.2
HANG = signal.SIGUSR1
"""Makes a process that was started with `hanging_environment` hold its interpreter's lock."""
HANG_S = 2.0
_HANGING = """
import ctypes, signal
# A call through PyDLL keeps the interpreter's lock, unlike one through CDLL.
signal.signal(signal.SIGUSR1, lambda *_: ctypes.PyDLL(None).usleep({microseconds}))
"""


def hanging_environment(folder: Path) -> dict[str, str]:
    """An environment whose Python processes hang at the signal `HANG`, by a module written into `folder`."""
    (folder / "sitecustomize.py").write_text(_HANGING.format(microseconds=round(HANG_S * 1e6)), encoding="utf-8")
    return {**os.environ, "PYTHONPATH": str(folder)}


def franka(address: str, folder: Path, model: ArmModel = FR3) -> FrankaRobot:
    """The driver for a simulated controller, its shared memory in `folder`."""
    config = FrankaRobotConfig(address=address, real_time=False)
    return FrankaRobot(config, ArmMount(robot=FIRST_ROBOT, model=model), ThreadPulse(), folder)


async def command(address: str, folder: Path, pace: float) -> None:
    """Connect and move until the arm does no more, then stay."""
    async with franka(address, folder) as robot:
        print(json.dumps(robot.pids), flush=True)
        with contextlib.suppress(SkillFailure):
            while True:
                for target in (AWAY_RAD, FR3.home_q_rad):
                    move = joint_move(robot.state().q_rad, target, FR3.limits)
                    await robot.follow(scaled(move, pace), Lease(holder="bench", duration_s=LEASE_S))
        await asyncio.sleep(60.0)


if __name__ == "__main__":
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: not longer than the study
    asyncio.run(command(sys.argv[1], Path(sys.argv[2]), float(sys.argv[3])))
