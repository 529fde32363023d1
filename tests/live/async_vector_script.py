"""Environments in processes of their own: equal to one in this process, and nothing is left of a killed one."""

import os
import signal
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))  # as for tests

from quick_environments import NEAR, NOWHERE, shape_env

import dlokit.gym
from dlokit.errors import MachineError

if __name__ == "__main__":
    arguments: dict[str, Any] = {**NEAR, "grasp": "place", "planner": "farthest"}
    envs = gymnasium.make_vec(
        dlokit.gym.SHAPE,
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": sys.argv[1]},
        wrappers=None,
        **arguments,
    )
    assert isinstance(envs, gymnasium.vector.AsyncVectorEnv)
    seen, _ = envs.reset(seed=4)
    actions = np.stack([NOWHERE, NOWHERE])
    after, *_ = envs.step(actions)
    alone = shape_env(grasp="place")
    for number in range(2):
        expected, _ = alone.reset(seed=4 + number)
        assert np.array_equal(expected["nodes"], seen["nodes"][number])
    alone.close()
    if os.fork() == 0:  # this process has taken pictures: the forked one would wait for its first for ever
        try:
            shape_env().reset(seed=0)
        except MachineError as error:
            os._exit(0 if "spawn" in str(error) else 2)
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.wait()[1]) == 0
    workers = [process.pid for process in envs.processes if process.pid is not None]
    below = [child for pid in workers for child in psutil.Process(pid).children(recursive=True)]
    assert below == [], below
    os.kill(workers[0], signal.SIGKILL)
    envs.close(terminate=True)
    gone, left = psutil.wait_procs([psutil.Process(pid) for pid in workers if psutil.pid_exists(pid)], timeout=10)
    assert left == []
    print("nothing left")
