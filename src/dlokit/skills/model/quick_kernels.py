"""Compiled code of the rod of planning: made once on a machine, kept on disk, and loaded before a decision needs it."""

import time

import numpy as np

from dlokit.skills.model.config import ModelConfig
from dlokit.skills.model.quick_rollout import Motion, QuickRod, play
from dlokit.types.action import VelocityProfile

_STEP_S = 0.02
_SMALL = ModelConfig(nodes=5, length_m=0.08)


def warm() -> float:
    """Play one short motion on a small rod; the seconds that took.

    At the first call after an installation Numba compiles, which takes some twenty seconds, and keeps what it made
    beside the modules, or in the user's cache folder where it may not write there. Later it loads that.
    """
    began = time.perf_counter()
    lying = np.column_stack((np.linspace(0.0, _SMALL.length_m, _SMALL.nodes), np.zeros((_SMALL.nodes, 2))))
    there_and_up = np.array([[0.04, 0.0, 0.011, 1.5], [0.04, 0.0, 0.03, 1.5], [0.06, 0.0, 0.03, 1.6]])
    motion = Motion(node=2, waypoints=there_and_up, velocity=VelocityProfile())
    play(_SMALL, lying, (QuickRod(),), (motion,), _STEP_S, threads=1)
    return time.perf_counter() - began
