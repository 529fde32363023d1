"""Compiled code of the observers: made once on a machine, kept on disk, and loaded before the first frame needs it."""

import logging
import time
from collections.abc import Sequence

import numpy as np

from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.strategies import OURS
from dlokit.types.dlo import DloState
from dlokit.types.observation import Observation

log = logging.getLogger(__name__)

_NODES, _POINTS = 12, 200
_LENGTH_M = 0.3


def warm(observers: Sequence[ObserverStrategyConfig] | None = None) -> float:
    """Let these observers, or all that ship with dlokit, look at a small cloud once; the seconds that took.

    At the first call after an installation Numba compiles, which takes some ten seconds, and keeps what it made
    beside the modules, or in the user's cache folder where it may not write there. Later it loads that.
    """
    began = time.perf_counter()
    t = np.linspace(0.0, 1.0, _POINTS)
    curve = np.column_stack([_LENGTH_M * t, 0.02 * np.sin(3.0 * t), 0.0 * t])
    points = curve + np.random.default_rng(0).normal(0.0, 0.002, curve.shape)
    prior = DloState(
        stamp_ns=0,
        nodes_world=curve[np.linspace(0, _POINTS - 1, _NODES).astype(np.int64)] + np.array([0.0, 0.01, 0.0]),
        topology=chain(_NODES, _LENGTH_M),
    )
    seen = Observation(stamp_ns=1, points_world=points.astype(np.float32))
    for config in observers if observers is not None else [ours() for ours in OURS]:
        try:
            config.build().estimate(seen, prior)
        except Exception:  # a strategy may be anybody's; what it cannot take is told when it matters
            log.exception("the observer %s did not take the cloud that warms it", config.name)
    return time.perf_counter() - began
