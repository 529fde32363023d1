"""`dlokit.Tracker`: the nodes of a DLO in a stream of point clouds, without a bus, processes or a robot."""

from dataclasses import dataclass
from typing import Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from dlokit.errors import InputError, SkillFailure
from dlokit.geometry.poses import pose, pose_from_matrix, transform
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import chain, chain_lengths
from dlokit.skills.observer.base import ObserverStrategy, ObserverStrategyConfig, prior_from
from dlokit.skills.observer.config import ObserverConfig
from dlokit.skills.observer.following import cleaned, followed
from dlokit.skills.observer.initialise.first_shape import initial_targets
from dlokit.skills.observer.initialise.skeleton import spanning_tree
from dlokit.skills.observer.kernels import load_kernels
from dlokit.skills.observer.own import Adapted, OwnObserver
from dlokit.skills.observer.strategies import OBSERVERS
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import DistrustReason, Observation, Occlusion
from dlokit.types.pose import Pose

CLOUD_PERIOD_NS = 33_333_333
"""Time between two clouds without stamps [ns]: depth cameras record 30 per second."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """The nodes of the DLO in one cloud."""

    stamp_ns: int
    """Stamp of the cloud [ns]."""
    positions_world: Float64Array  # (M, 3) [m]
    """Positions of all nodes, in the order of the rod; hidden nodes are estimated."""
    visible: BoolArray  # (M,)
    """Whether the cloud shows the node."""
    covariance: Float64Array | None  # (M, 3, 3) [m²]
    """Uncertainty of each node; None where the observer does not estimate it."""
    health: float
    """Confidence of the observer, from 0 (the DLO is lost) to 1."""
    doubt: DistrustReason | None
    """Why the positions are not to be trusted; None when they are."""


@runtime_checkable
class Resettable(Protocol):
    """An observer with a state of its own, which can forget it."""

    def reset(self) -> object:
        """Forget."""
        ...


class Tracker:
    """Follows the nodes of one DLO from cloud to cloud.

    The first cloud is ordered into nodes along the rod; each further cloud corrects them. Trackers are independent of
    one another: make one for each DLO. They run the same code as the observer component of a full system.
    """

    def __init__(
        self,
        *,
        length_m: float | None = None,
        radius_m: float = BelievedDlo.radius_m,
        nodes: int = BelievedDlo.nodes,
        observer: str | ObserverStrategyConfig | OwnObserver = "map",
        initial_nodes_world: ArrayLike | None = None,
        camera_matrix: ArrayLike | None = None,
    ) -> None:
        """Make a tracker; the first one on a machine compiles its kernels, which takes about 20 s.

        `length_m` is the DLO's length [m]; without it, the length that the first cloud shows. `nodes` is their number
        M. `observer` is the name of an installed strategy (map, anchored, cpd, spr, som), the settings of one, or an
        object with `estimate(seen, prior)`, as `OwnObserver` describes it, which may keep a state from cloud to cloud.
        `initial_nodes_world` (M, 3) [m] are the nodes before the first cloud, which is then not ordered without a
        prior; they may form a branched DLO. `camera_matrix` (3, 3) [px] is needed for depth images alone.

        Raises `InputError` where a value is not usable.
        """
        if length_m is not None and not 0.01 <= length_m <= 100.0:
            raise InputError(f"length_m is {length_m}; the length is given in metres, from 0.01 to 100.")
        if not 1e-4 <= radius_m <= 1.0:
            raise InputError(f"radius_m is {radius_m}; the radius is given in metres, from 0.0001 to 1.")
        initial = None if initial_nodes_world is None else _points(initial_nodes_world, "initial_nodes_world")
        count = nodes if initial is None else len(initial)
        if count < 3:
            raise InputError(f"there are {count} nodes; at least 3 are needed, {BelievedDlo.nodes} are usual.")
        self._length_m = length_m
        self._dlo = BelievedDlo(nodes=count, length_m=length_m or BelievedDlo.length_m, radius_m=radius_m)
        self._config = ObserverConfig()
        self._observer = observer
        self._strategy = self._built()
        self._initial = initial
        self._intrinsics = None if camera_matrix is None else _matrix(camera_matrix, "camera_matrix", 3)
        self._topology = _known_topology(initial, length_m, count)
        self._last: TargetPoints | None = None

    @property
    def topology(self) -> Topology | None:
        """Which nodes are joined, and at which distances; None before the first cloud of a DLO of unknown length."""
        return self._topology

    def update(
        self,
        points: ArrayLike,
        *,
        stamp_ns: int | None = None,
        T_world_camera: ArrayLike | Pose | None = None,
        depth: ArrayLike | None = None,
    ) -> Nodes:
        """Estimate the nodes from the next cloud of the DLO.

        `points` (N, 3) [m] are in the camera's frame (x right, y down, z forward) where `T_world_camera` is given,
        which is a `Pose` or a matrix (4, 4), else in the world's. `stamp_ns` is when the cloud was taken [ns]; without
        it, 1/30 s after the previous one. `depth` (height, width) [m] is the depth image of the same moment, 0 or NaN
        where unknown: nodes behind something nearer than them count as hidden, not as moved.

        A cloud that does not show the DLO is no error: the nodes stay, with `health` 0 and the reason in `doubt`.
        Raises `InputError` where an argument is not usable, and where the first cloud cannot be ordered into nodes.
        """
        seen = self._observation(points, stamp_ns, T_world_camera, depth)
        if self._last is None and self._initial is None:
            return self._first(seen)
        answer = followed(self._strategy, seen, self._prior(), self._config)
        self._last = answer.targets
        return _nodes(answer.targets, answer.doubt)

    def reset(self) -> None:
        """Forget the DLO: the next cloud is the first one. An observer of your own is told, if it has `reset()`."""
        self._last = None
        if isinstance(self._observer, Resettable):
            self._observer.reset()
        self._strategy = self._built()

    def _built(self) -> ObserverStrategy:
        observer = self._observer
        if isinstance(observer, str):
            observer = OBSERVERS.named(observer, "observer")()
        if hasattr(observer, "estimate"):
            return Adapted(cast(OwnObserver, observer))
        config = cast(ObserverStrategyConfig, observer)
        load_kernels((config,))  # or the first clouds would wait for compiled code
        return config.build(self._dlo)

    def _first(self, seen: Observation) -> Nodes:
        try:
            targets = initial_targets(cleaned(seen), self._dlo.nodes, self._length_m, radius_m=self._dlo.radius_m)
        except SkillFailure as failure:
            raise InputError(
                f"the first cloud cannot be ordered into nodes ({failure.reason}): {failure.detail}; or give the nodes "
                "before the first cloud as initial_nodes_world"
            ) from failure
        if self._topology is None:
            self._topology = chain_lengths(targets.nodes_world)
        self._last = targets
        return _nodes(targets, None)

    def _prior(self) -> DloState:
        assert self._topology is not None
        if self._last is not None:
            return prior_from(self._last, self._topology)
        assert self._initial is not None
        return DloState(stamp_ns=0, nodes_world=self._initial, topology=self._topology)

    def _observation(
        self,
        points: ArrayLike,
        stamp_ns: int | None,
        T_world_camera: ArrayLike | Pose | None,
        depth: ArrayLike | None,
    ) -> Observation:
        cloud = _cloud(points)
        T = _pose(T_world_camera)
        if T is not None:
            cloud = transform(T, cloud)
        if stamp_ns is None:
            stamp_ns = CLOUD_PERIOD_NS if self._last is None else self._last.stamp_ns + CLOUD_PERIOD_NS
        seen = Observation(stamp_ns=stamp_ns, points_world=cloud.astype(np.float32))
        if depth is None:
            return seen
        depth_m = _depth(depth)
        return Observation(
            stamp_ns=stamp_ns,
            points_world=seen.points_world,
            calibration=self._calibration(depth_m, pose(np.zeros(3)) if T is None else T),
            occlusion=Occlusion(depth_m=depth_m, scale=1),
        )

    def _calibration(self, depth_m: Float32Array, T_world_camera: Pose) -> CameraCalibration:
        if self._intrinsics is None:
            raise InputError("depth is given without a camera: make the Tracker with camera_matrix, (3, 3) in pixels.")
        height_px, width_px = depth_m.shape
        K = self._intrinsics
        return CameraCalibration(
            width_px=width_px,
            height_px=height_px,
            fx_px=float(K[0, 0]),
            fy_px=float(K[1, 1]),
            cx_px=float(K[0, 2]),
            cy_px=float(K[1, 2]),
            T_world_camera=T_world_camera,
        )


def topology_of(nodes: Float64Array) -> Topology:
    """How nodes (M, 3) [m] of unknown topology are joined: their minimum spanning tree. Raises `InputError`.

    Edges run from the smaller index to the larger, sorted, so that nodes in order along a rod give its chain.
    """
    tree = spanning_tree(nodes, float(np.linalg.norm(np.ptp(nodes, axis=0))) + 1e-9).tocoo()
    edges = np.sort(np.column_stack([tree.row, tree.col]).astype(np.int64), axis=1)
    edges = edges[np.lexsort((edges[:, 1], edges[:, 0]))]
    if len(edges) != len(nodes) - 1:
        raise InputError("two of the initial nodes have the same position; give each node once")
    lengths = np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)
    return Topology(edges=edges, rest_lengths_m=lengths)


def _known_topology(initial: Float64Array | None, length_m: float | None, count: int) -> Topology | None:
    if initial is not None:
        return topology_of(initial)
    return None if length_m is None else chain(count, length_m)


def _nodes(targets: TargetPoints, doubt: DistrustReason | None) -> Nodes:
    return Nodes(
        stamp_ns=targets.stamp_ns,
        positions_world=targets.nodes_world,
        visible=targets.visible,
        covariance=targets.covariance,
        health=targets.health,
        doubt=doubt,
    )


def _cloud(points: ArrayLike) -> Float64Array:
    cloud = np.asarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3:
        raise InputError(f"points have the shape {cloud.shape}; needed is (N, 3), x, y and z in metres.")
    return cloud


def _points(values: ArrayLike, name: str) -> Float64Array:
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(f"{name} has the shape {points.shape}; needed is (M, 3), finite numbers in metres.")
    return points


def _matrix(values: ArrayLike, name: str, size: int) -> Float64Array:
    matrix = np.asarray(values, dtype=np.float64)
    if matrix.shape != (size, size) or not np.isfinite(matrix).all():
        raise InputError(f"{name} has the shape {matrix.shape}; needed is ({size}, {size}), finite numbers.")
    return matrix


def _pose(T: ArrayLike | Pose | None) -> Pose | None:
    if T is None or isinstance(T, Pose):
        return T
    return pose_from_matrix(_matrix(T, "T_world_camera", 4))


def _depth(values: ArrayLike) -> Float32Array:
    depth_m = np.array(values, dtype=np.float32)
    if depth_m.ndim != 2 or 0 in depth_m.shape:
        raise InputError(f"depth has the shape {depth_m.shape}; needed is (height, width), in metres.")
    depth_m[~(depth_m > 0.0)] = np.inf  # unknown: nothing is known to hide a node there
    return depth_m
