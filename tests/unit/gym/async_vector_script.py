"""Environments in processes of their own: equal to one in this process, and nothing is left of a killed one."""

import os
import signal
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).parents[2] / "helpers"))  # as for tests

from quick_environments import NEAR, NOWHERE, shape_env

import dlokit.gym

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
    workers = [process.pid for process in envs.processes if process.pid is not None]
    below = [child for pid in workers for child in psutil.Process(pid).children(recursive=True)]
    assert below == [], below
    os.kill(workers[0], signal.SIGKILL)
    envs.close(terminate=True)
    gone, left = psutil.wait_procs([psutil.Process(pid) for pid in workers if psutil.pid_exists(pid)], timeout=10)
    assert left == []
    print("nothing left")
