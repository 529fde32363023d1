"""Observations of an environment: the observer's nodes, the cloud or the picture; the truth only on request."""

from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
from gymnasium import spaces

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.transport import Transport
from dlokit.decision.convergence import error_m
from dlokit.description.default_cameras import d435_calibration
from dlokit.errors import ConfigError
from dlokit.functional.cameras.simulated import SimulatedStereoConfig
from dlokit.system.config import RunConfig
from dlokit.types.arrays import Float32Array, Float64Array, UInt8Array
from dlokit.types.dlo import GoalShape
from dlokit.types.image import CameraCalibration

Sight = Literal["nodes", "cloud", "picture"]
"""Kinds of observations of the DLO."""
TRUE_NODES = "privileged_true_nodes"
"""Name of the true nodes among the observations. No camera sees them: a policy that needs them fails in a lab."""
_FAR_M = 10.0  # no coordinate is larger


class Observations:
    """The observation space, and the observations.

    ``goal`` and ``nodes`` (M, 3), ``cloud`` (N, 3) [m] are in the world, ``picture`` is the (first) camera's, RGB.
    ``privileged_true_nodes`` (M, 3) [m] are the cell's, in the order of the observer's nodes.
    """

    def __init__(
        self, config: RunConfig, sights: Sequence[Sight], *, cloud_points: int, privileged: bool, tool: bool = False
    ) -> None:
        """`cloud_points` is the number N of a cloud; `tool` adds the state of the arm's tool."""
        if unknown := [sight for sight in sights if sight not in get_args(Sight)]:
            raise ConfigError(f"observation has {', '.join(unknown)}; allowed are {', '.join(get_args(Sight))}.")
        if cloud_points < 1:
            raise ConfigError(f"cloud_points is {cloud_points}; it must be at least 1.")
        self._sights, self._cloud_points, self._privileged, self._tool = sights, cloud_points, privileged, tool
        nodes = _metres(config.model.nodes)
        parts: dict[str, spaces.Space[Any]] = {"goal": nodes}
        if "nodes" in sights:
            parts["nodes"] = nodes
        if "cloud" in sights:
            parts["cloud"] = _metres(cloud_points)
        if "picture" in sights:
            parts["picture"] = spaces.Box(0, 255, (*_picture_size(config), 3), np.uint8)
        if tool:
            parts["tool"] = spaces.Box(-_FAR_M, _FAR_M, (7,), np.float32)
        if privileged:
            parts[TRUE_NODES] = nodes
        self.space = spaces.Dict(parts)

    def of(self, transport: Transport, truth: "TrueNodes") -> dict[str, Any]:
        """The present observation. Call it on the episode's loop, after the first look."""
        goal, state = transport.latest(topics.GOAL).value, transport.latest(topics.STATE).value
        assert goal is not None
        assert state is not None, "an episode begins with a look"
        seen: dict[str, Any] = {"goal": goal.nodes_world.astype(np.float32)}
        if "nodes" in self._sights:
            seen["nodes"] = state.nodes_world.astype(np.float32)
        if "cloud" in self._sights:
            cloud = transport.latest(topics.OBSERVATION).value
            seen["cloud"] = _of_count(np.zeros((0, 3)) if cloud is None else cloud.points_world, self._cloud_points)
        if "picture" in self._sights:
            seen["picture"] = _picture(transport)
        if self._tool:
            seen["tool"] = tool_numbers(transport)
        if self._privileged:
            seen[TRUE_NODES] = truth.nodes_world(len(state.nodes_world)).astype(np.float32)
        return seen


class TrueNodes:
    """The cell's nodes in the system's order, which is determined once, as by the evaluator."""

    def __init__(self, nodes_world: Any, first_world: Float64Array) -> None:
        """`nodes_world` is a function of the cell, `first_world` (M, 3) [m] the system's first shape."""
        self._nodes_world = nodes_world
        self._reversed = False
        nodes = self.nodes_world(len(first_world))
        self._reversed = geometry.rmse_m(nodes[::-1], first_world) < geometry.rmse_m(nodes, first_world)

    def nodes_world(self, count: int) -> Float64Array:
        """The true nodes (count, 3) [m]."""
        nodes = geometry.resample(self._nodes_world(), count)
        return nodes[::-1].copy() if self._reversed else nodes

    def rmse_m(self, goal: GoalShape) -> float:
        """Their error to a goal [m], by the measure of task and evaluator."""
        return error_m(self.nodes_world(len(goal.nodes_world)), goal)


def tool_numbers(transport: Transport) -> Float32Array:
    """The tool (7,): x, y, z [m], cosine and sine of its yaw, width of the fingers [m], 1 where they hold the DLO."""
    state = transport.latest(topics.ROBOT_STATE).value
    assert state is not None, "an arm publishes its state from its start"
    T = geometry.matrix(state.T_world_tcp)
    across = float(np.hypot(T[0, 0], T[1, 0]))
    numbers = [*T[:3, 3], T[0, 0] / across, T[1, 0] / across, state.finger_width_m, float(state.holding)]
    return np.array(numbers, dtype=np.float32)


def calibration_of(transport: Transport) -> CameraCalibration | None:
    """The camera with its pose at the last look; None before the first."""
    seen = transport.latest(topics.OBSERVATION).value
    return None if seen is None else seen.calibration


def _metres(count: int) -> spaces.Box:
    return spaces.Box(-_FAR_M, _FAR_M, (count, 3), np.float32)


def _picture_size(config: RunConfig) -> tuple[int, int]:
    """Height and width of the camera's pictures [px]."""
    if isinstance(config.camera, SimulatedStereoConfig):
        return config.cell.height_px, config.cell.width_px
    camera = d435_calibration()
    return camera.height_px, camera.width_px


def _picture(transport: Transport) -> UInt8Array:
    images = transport.latest(topics.STEREO_IMAGES).value or transport.latest(topics.DEPTH_IMAGES).value
    assert images is not None, "an episode begins with a look"
    return np.array(images.reference, dtype=np.uint8)


def _of_count(points_world: Any, count: int) -> Float32Array:
    """Exactly `count` of the points (N, 3), evenly chosen, with repetitions if N is smaller; zeros if N is 0."""
    if len(points_world) == 0:
        return np.zeros((count, 3), dtype=np.float32)
    chosen = np.linspace(0, len(points_world) - 1, count).round().astype(np.int64)
    return np.asarray(points_world[chosen], dtype=np.float32)
