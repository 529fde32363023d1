"""`dlokit.Tracker`: the nodes of a DLO in a stream of point clouds, without a bus, processes or a robot."""

from __future__ import annotations  # or `help` spells out every member of `ArrayLike`

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, cast

import msgspec
import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from dlokit.app.data.cloud_files import FARTHEST_M, as_points
from dlokit.errors import InputError, SkillFailure
from dlokit.geometry.camera import back_project, intrinsics
from dlokit.geometry.poses import pose, rigid_pose, transform
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.anchored import chain, chain_lengths
from dlokit.skills.observer.base import ObserverStrategy, ObserverStrategyConfig, prior_from
from dlokit.skills.observer.config import OBSERVERS, Adapted, ObserverConfig, OwnObserver
from dlokit.skills.observer.following import cleaned, followed
from dlokit.skills.observer.initialise.first_shape import initial_targets
from dlokit.skills.observer.initialise.skeleton import spanning_tree
from dlokit.skills.observer.kernels import load_kernels
from dlokit.skills.perception.cloud import OUTLIER_NEIGHBOURS, lonely, thin
from dlokit.skills.perception.config import CloudConfig
from dlokit.types.arrays import BoolArray, Float32Array, Float64Array, as_numbers
from dlokit.types.dlo import DloState, TargetPoints, Topology
from dlokit.types.image import CameraCalibration
from dlokit.types.observation import DistrustReason, Observation, Occlusion
from dlokit.types.pose import Pose

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    """Uncertainty of each node; None if the observer does not estimate it."""
    health: float
    """Confidence of the observer, from 0 (the DLO is lost) to 1."""
    distrust: DistrustReason | None
    """Reason not to trust the positions; None if they are reliable."""
    topology: Topology
    """The edges between the nodes, and their rest lengths [m]."""

    def plot(self, path: Path | str | None = None) -> Figure:
        """Draw the nodes from above, hidden ones in red; save the figure where a `path` is given."""
        from dlokit.app.library.plots import (  # Matplotlib takes as long to load as everything else
            draw_nodes,
            new_figure,
            saved,
        )

        figure, (axes,) = new_figure(columns=1)
        draw_nodes(axes, self.positions_world, self.visible, self.topology.edges)
        axes.legend(frameon=False)
        return saved(figure, path)

    @property
    def doubt(self) -> NoReturn:
        """The earlier name of `distrust`. Raises `AttributeError`."""
        raise AttributeError("Nodes.doubt is called Nodes.distrust now")

    def __repr__(self) -> str:
        distrust = "" if self.distrust is None else f", not trusted: {self.distrust.value}"
        shown = f"{np.count_nonzero(self.visible)} of {len(self.visible)} visible"
        return f"<Nodes at {self.stamp_ns} ns: {shown}, health {self.health:.2f}{distrust}>"


class Tracker:
    """Follows the nodes of one DLO from cloud to cloud.

    The first cloud is ordered into nodes along the rod; each further cloud corrects them. Trackers are independent of
    one another: make one for each DLO. They run the same code as the observer component of a full system.
    """

    def __init__(
        self,
        *,
        length_m: float | None = None,
        radius_m: float | None = None,
        nodes: int = BelievedDlo.nodes,
        observer: str | ObserverStrategyConfig | OwnObserver = "map",
        initial_nodes_world: ArrayLike | None = None,
        camera_matrix: ArrayLike | None = None,
        voxel_m: float = CloudConfig.voxel_m,
    ) -> None:
        """Make a tracker; the first one on a machine compiles its kernels, which takes about 20 s.

        `length_m` is the DLO's length [m]; without it, the length that the first cloud shows, which is less accurate:
        measure the DLO where you can. `radius_m` is its radius
        [m]; without it, 4 mm, or the radius of a thicker DLO if the first cloud shows one. `nodes` is their number M.
        `observer` is the name of an installed strategy (map, anchored, cpd, spr, som), the settings of one, or an
        object with `estimate(seen, prior)`, as `OwnObserver` describes it, which may keep a state from cloud to cloud.
        `initial_nodes_world` (M, 3) [m] are the nodes before the first cloud, which is then not ordered without a
        prior; they may form a branched DLO. `camera_matrix` (3, 3) [px] is needed for depth images alone. `voxel_m` is
        the side of the cubes that each keep the mean of their points [m]; isolated points are omitted then. 0 keeps all
        points, of a cloud that is filtered already or has points farther apart than 5 mm.

        Raises `InputError` if a value is not usable.
        """
        if length_m is not None:
            _check_metres(length_m, "length_m", 0.01, 100.0)
        if radius_m is not None:
            _check_metres(radius_m, "radius_m", 1e-4, 1.0)
        _check_metres(voxel_m, "voxel_m", 0.0, 1.0)
        self._voxel_m = voxel_m
        initial = None if initial_nodes_world is None else as_points(initial_nodes_world, "initial_nodes_world")
        if initial is not None and not np.all(np.abs(initial) <= FARTHEST_M):
            raise InputError(f"initial_nodes_world: a node is not finite or beyond {FARTHEST_M:.0f} m; give metres")
        count = _whole(nodes, "nodes", "of nodes") if initial is None else len(initial)
        if count < 3:
            raise InputError(f"there are {count} nodes; at least 3 are needed, {BelievedDlo.nodes} are usual.")
        self._length_m, self._radius_given = length_m, radius_m is not None
        self._dlo = BelievedDlo(
            nodes=count,
            length_m=length_m or BelievedDlo.length_m,
            radius_m=radius_m or BelievedDlo.radius_m,
        )
        self._config = ObserverConfig()
        self._observer = observer
        self._strategy = self._built()
        self._initial = initial
        self._intrinsics = None if camera_matrix is None else _intrinsics(camera_matrix)
        self._given_topology = None if length_m is None else chain(count, length_m)
        if initial is not None:
            self._given_topology = topology_of(initial)
        self._topology = self._given_topology
        self._last: TargetPoints | None = None

    @property
    def topology(self) -> Topology | None:
        """The edges and their rest lengths; None before the first cloud of a DLO of unknown length."""
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

        - `points` (N, 3) [m], or an array with columns named x, y and z. They are in the world's frame or, where
          `T_world_camera` is given, in the camera's (x right, y down, z forward); those at (0, 0, 0) are then omitted,
          as depth cameras mark pixels without depth so.
        - `stamp_ns`: when the cloud was taken, in whole nanoseconds; without it, 1/30 s after the previous one.
        - `T_world_camera`: the camera's pose, a `Pose` or a matrix (4, 4), p_world = T_world_camera p_camera.
        - `depth` (height, width) [m]: the depth image of the same moment, 0 or NaN where unknown. Nodes behind
          something nearer than them count as hidden, not as moved. It needs `camera_matrix` in `Tracker(...)`.

        A cloud that does not show the DLO is no error: the nodes stay, with `health` 0 and the reason in `distrust`. A
        stamp older than the previous one gives the reason `clock_jumped`; the next cloud is followed by the new clock.
        Raises `InputError` where an argument is not usable, and where the first cloud cannot be ordered into nodes.
        """
        seen = self._observation(points, stamp_ns, T_world_camera, depth)
        if self._last is None and self._initial is None:
            return self._first(seen)
        answer = followed(self._strategy, seen, self._prior(), self._config, self._dlo.radius_m)
        if (
            answer.distrust is DistrustReason.OLD_STAMP
            and self._last is not None
            and seen.stamp_ns < self._last.stamp_ns
        ):
            targets = msgspec.structs.replace(answer.targets, stamp_ns=seen.stamp_ns)
            return self._nodes(targets, DistrustReason.CLOCK_JUMPED)
        return self._nodes(answer.targets, answer.distrust)

    def reset(self) -> None:
        """Forget the DLO: the next cloud is the first one. Your own observer's `reset()` is called, if it has one."""
        self._last, self._topology = None, self._given_topology
        if callable(forget := getattr(self._observer, "reset", None)):
            forget()
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
            targets = initial_targets(
                cleaned(seen),
                self._dlo.nodes,
                self._length_m,
                radius_m=self._dlo.radius_m,
                given=self._radius_given,
            )
        except SkillFailure as failure:
            raise InputError(
                f"the first cloud ({_described(seen.points_world)}) cannot be ordered into nodes ({failure.reason}): "
                f"{failure.detail}; or give the nodes before the first cloud as initial_nodes_world"
            ) from failure
        if self._topology is None:
            self._topology = chain_lengths(targets.nodes_world)
        return self._nodes(targets, None)

    def _nodes(self, targets: TargetPoints, distrust: DistrustReason | None) -> Nodes:
        """Keep the targets for the next cloud, and return them as `Nodes`."""
        assert self._topology is not None
        self._last = targets
        return Nodes(
            stamp_ns=targets.stamp_ns,
            positions_world=targets.nodes_world,
            visible=targets.visible,
            covariance=targets.covariance,
            health=targets.health,
            distrust=distrust,
            topology=self._topology,
        )

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
        cloud = as_points(points, "points")
        T = _pose(T_world_camera)
        if T is not None:
            cloud = in_world(cloud, T)
        _check_unit(np.abs(cloud).max(axis=1), "points")
        if stamp_ns is None:
            stamp_ns = CLOUD_PERIOD_NS if self._last is None else self._last.stamp_ns + CLOUD_PERIOD_NS
        else:
            stamp_ns = _whole(stamp_ns, "stamp_ns", "of nanoseconds: round(seconds * 1e9)")
        calibration = occlusion = None
        if depth is not None:
            if self._intrinsics is None:
                raise InputError("depth needs a camera: make the Tracker with camera_matrix, (3, 3) in pixels.")
            depth_m = _depth(depth)
            calibration = _calibration(self._intrinsics, depth_m, pose(np.zeros(3)) if T is None else T)
            occlusion = Occlusion(depth_m=depth_m, scale=1)
        kept = filtered(cloud, self._voxel_m)
        if self._last is None and len(kept) < 2 <= len(cloud):
            raise InputError(
                f"points: the first cloud ({_described(cloud)}) has no points with {OUTLIER_NEIGHBOURS} others near "
                f"them after thinning to cubes of {self._voxel_m:g} m: check that it is in metres, or keep all points "
                "of a sparse cloud with Tracker(voxel_m=0)"
            )
        points_world = kept.astype(np.float32)
        return Observation(stamp_ns=stamp_ns, points_world=points_world, calibration=calibration, occlusion=occlusion)


def in_world(points: Float64Array, T_world_camera: Pose) -> Float64Array:
    """Points (N, 3) [m] of a camera in the world's frame, without those at (0, 0, 0): pixels without depth."""
    return transform(T_world_camera, points[np.any(points != 0.0, axis=1)])


def filtered(points: Float64Array, voxel_m: float) -> Float64Array:
    """The finite points (N, 3) [m] as an observer gets them: thinned to cubes of `voxel_m`, without isolated ones.

    0 keeps all points.
    """
    if voxel_m == 0.0:
        return points
    thinned = thin(points[np.isfinite(points).all(axis=1)], voxel_m)
    return thinned[~lonely(thinned, voxel_m)]


def points_from_depth(depth: ArrayLike, mask: ArrayLike, camera_matrix: ArrayLike) -> Float64Array:
    """The points (N, 3) [m] of the DLO in a depth image, in the camera's frame: x right, y down, z forward.

    - `depth` (height, width) [m], 0 or NaN where unknown.
    - `mask` (height, width): true, or another number than 0, where the image shows the DLO.
    - `camera_matrix` (3, 3) [px] of the depth image.

    Pass them to `Tracker.update(points, T_world_camera=T)`. Raises `InputError` if an argument is not usable.
    """
    depth_m, shown = _depth(depth), np.asanyarray(mask)
    if shown.shape != depth_m.shape or shown.dtype.kind not in "bfiu":
        raise InputError(
            f"mask has the shape {shown.shape} and holds {shown.dtype}; needed are yes or no for each pixel of the "
            f"depth image, {depth_m.shape}"
        )
    rows, columns = np.nonzero((shown != 0) & np.isfinite(depth_m))
    camera = _calibration(_intrinsics(camera_matrix), depth_m, pose(np.zeros(3)))
    return back_project(np.column_stack([columns, rows]), depth_m[rows, columns], camera)


def topology_of(nodes: Float64Array) -> Topology:
    """The topology of nodes (M, 3) [m] as their minimum spanning tree. Raises `InputError`.

    Edges run from the smaller index to the larger, sorted, so that nodes in order along a rod give its chain.
    """
    tree = spanning_tree(nodes, float(np.linalg.norm(np.ptp(nodes, axis=0))) + 1e-9).tocoo()
    edges = np.sort(np.column_stack([tree.row, tree.col]).astype(np.int64), axis=1)
    edges = edges[np.lexsort((edges[:, 1], edges[:, 0]))]
    if len(edges) != len(nodes) - 1:
        raise InputError("two of the initial nodes have the same position; give each node once")
    lengths = np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)
    return Topology(edges=edges, rest_lengths_m=lengths)


def _described(points: Float32Array | Float64Array) -> str:
    """Text with the number, extent and density of the points (N, 3) [m]."""
    finite = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    if len(finite) < 2:
        return f"{len(finite)} points"
    extent = " x ".join(f"{side:.3g}" for side in np.ptp(finite, axis=0))
    apart_m, _ = scipy.spatial.KDTree(finite).query(finite[:: max(len(finite) // 200, 1)], 2)
    return f"{len(finite)} points, {extent} m large, {np.median(apart_m[:, 1]) * 1000:.2g} mm apart"


def _check_metres(value: Any, name: str, least: float, most: float) -> None:
    if not isinstance(value, (int, float, np.integer, np.floating)) or not least <= value <= most:
        raise InputError(f"{name} is {value!r}; it is given in metres, a number from {least:g} to {most:g}.")


def _whole(value: Any, name: str, what: str) -> int:
    if not isinstance(value, (int, np.integer)) or isinstance(value, (bool, np.timedelta64)):
        raise InputError(f"{name} is {value!r}; give a whole number {what}.")
    return int(value)


def _check_unit(lengths_m: NDArray[np.floating], name: str) -> None:
    """Raise `InputError` if most lengths (N,) are too large for metres."""
    sample = lengths_m[:: max(len(lengths_m) // 1000, 1)]
    sample = sample[np.isfinite(sample)]
    if len(sample) and np.median(sample) > FARTHEST_M:
        raise InputError(
            f"{name}: half of the values are larger than {np.median(sample):.4g}; metres are at most "
            f"{FARTHEST_M:.0f}: divide millimetres by 1000"
        )


def _intrinsics(values: ArrayLike) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy [px] of a camera matrix (3, 3), or of its nine numbers row by row, as in ROS messages."""
    K = as_numbers(values, "camera_matrix")
    if K.shape not in ((3, 3), (9,)) or not np.isfinite(K).all():
        raise InputError(f"camera_matrix has the shape {K.shape}; needed is (3, 3), finite numbers in pixels.")
    if (K.reshape(3, 3).diagonal() <= 0.0).any():
        raise InputError(f"camera_matrix is {K.tolist()}; its focal lengths, and the 1 after them, must be above 0.")
    return intrinsics(K.reshape(3, 3))


def _calibration(
    optics: tuple[float, float, float, float], depth_m: Float32Array, T_world_camera: Pose
) -> CameraCalibration:
    (height, width), (fx, fy, cx, cy) = depth_m.shape, optics
    return CameraCalibration(
        width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, T_world_camera=T_world_camera
    )


def _pose(T: ArrayLike | Pose | None) -> Pose | None:
    if T is None:
        return None
    T_world_camera = T if isinstance(T, Pose) else rigid_pose(T, "T_world_camera")
    _check_unit(np.abs(T_world_camera.position_m).max(keepdims=True), "T_world_camera")
    return T_world_camera


def _depth(values: ArrayLike) -> Float32Array:
    """The depth image (height, width) [m]; unknown depths become infinite, so that they hide no node."""
    depth_m = as_numbers(values, "depth").astype(np.float32)
    if depth_m.ndim != 2 or 0 in depth_m.shape:
        raise InputError(f"depth has the shape {depth_m.shape}; needed is (height, width), in metres.")
    depth_m[~(depth_m > 0.0)] = np.inf
    _check_unit(depth_m[np.isfinite(depth_m)], "depth")
    return depth_m
