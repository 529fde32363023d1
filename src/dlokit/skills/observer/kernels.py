"""Compiled code of the observers: compiled once per installation, cached on disk, and loaded before the first frame."""

import logging
import time
from collections.abc import Sequence

import numpy as np

from dlokit.cache_folder import compiled_code_folder
from dlokit.errors import raise_interrupt
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import chain
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.config import OURS
from dlokit.types.dlo import DloState
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import GripperPin, Observation, Occlusion
from dlokit.types.pose import Pose

log = logging.getLogger(__name__)

_NODES, _POINTS = 31, 600
_LENGTH_M = 0.3


def load_kernels(observers: Sequence[ObserverStrategyConfig] | None = None) -> float:
    """Run these observers, or all observers of dlokit, once on a small cloud; returns the elapsed time [s].

    At the first call after an installation Numba compiles, which takes some ten seconds, and caches the code beside
    the modules, or in the user's cache folder if it cannot write there. Later calls load it.

    Raises `MachineError` if no folder for the code can be written.
    """
    compiled_code_folder()
    began = time.perf_counter()
    seen, prior = _scene()
    for config in observers if observers is not None else [ours() for ours in OURS]:
        try:
            config.build(BelievedDlo(nodes=_NODES, length_m=_LENGTH_M)).estimate(seen, prior)
        except Exception as error:  # a strategy may be external; its errors are reported when it is used
            raise_interrupt(error)
            log.exception("the observer %s failed on the cloud with which its code is loaded", config.name)
    return time.perf_counter() - began


def _scene() -> tuple[Observation, DloState]:
    """A rod with a part that the cloud does not show, seen by a camera from above with something in the picture.

    It exercises every part of a cloud that an observer uses.
    """
    t = np.linspace(0.0, 1.0, _POINTS)
    curve = np.column_stack([_LENGTH_M * t, 0.02 * np.sin(3.0 * t), 0.0 * t])
    shown = curve[(t < 0.4) | (t > 0.6)]
    points = shown + np.random.default_rng(0).normal(0.0, 0.002, shown.shape)
    above = CameraCalibration(
        width_px=640,
        height_px=480,
        fx_px=500.0,
        fy_px=500.0,
        cx_px=320.0,
        cy_px=240.0,
        T_world_camera=Pose(position_m=np.array([0.15, 0.0, 1.0]), wxyz=np.array([0.0, 1.0, 0.0, 0.0])),
    )
    depth_m = np.full((60, 80), np.inf, dtype=np.float32)
    depth_m[:20] = 0.5
    seen = Observation(
        stamp_ns=1,
        points_world=points.astype(np.float32),
        calibration=above,
        occlusion=Occlusion(depth_m=depth_m, scale=8),
        pins=(GripperPin(robot="hand", node=0, position_world=curve[0].astype(np.float32)),),
    )
    prior = DloState(
        stamp_ns=0,
        nodes_world=curve[np.linspace(0, _POINTS - 1, _NODES).astype(np.int64)] + np.array([0.0, 0.01, 0.0]),
        topology=chain(_NODES, _LENGTH_M),
    )
    return seen, prior
