"""Tracking of recorded clouds, without a bus: filters, tracker, and the files of nodes."""

import csv
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from dlokit.app.library.plots import draw_nodes
from dlokit.app.library.tracker import Nodes, Tracker, filtered
from dlokit.errors import InputError
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.visibility import distance_to_dlo_m
from dlokit.skills.perception.cloud import inside_box
from dlokit.skills.perception.config import BoxConfig, CloudConfig
from dlokit.types.arrays import Float64Array

MOST_PANELS = 12
NODE_COLUMNS = ("node", "x_m", "y_m", "z_m", "visible", "distrust")
"""The columns of nodes.csv after the first, which says of which cloud the node is."""


@dataclass(frozen=True, kw_only=True)
class TrackSettings:
    """How clouds are filtered and tracked."""

    observer: ObserverStrategyConfig
    nodes: int = BelievedDlo.nodes
    length_m: float | None = None
    radius_m: float | None = None
    box: BoxConfig | None = None
    """None: no box."""
    voxel_m: float = CloudConfig.voxel_m


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackResult:
    """The results of tracking F clouds."""

    nodes: tuple[Nodes, ...]
    seconds: tuple[float, ...]
    """Time for filters and observer [s]."""
    clouds: tuple[Float64Array, ...]
    """The filtered clouds (N, 3) [m]."""

    @cached_property
    def nodes_world(self) -> Float64Array:
        """(F, M, 3) [m]."""
        return np.stack([nodes.positions_world for nodes in self.nodes])

    @cached_property
    def distance_m(self) -> Float64Array:
        """(F,) root mean square distance of a cloud's points to the DLO [m]; NaN where it has none."""
        both = zip(self.clouds, self.nodes, strict=True)
        apart = [distance_to_dlo_m(points, nodes.positions_world, nodes.topology) for points, nodes in both]
        return np.array([np.sqrt(np.mean(distances**2)) if len(distances) else np.nan for distances in apart])


def track_clouds(
    clouds: Sequence[Float64Array], initial: Float64Array | None, settings: TrackSettings, *, names: Sequence[str]
) -> TrackResult:
    """Track a DLO through clouds (N, 3) [m], from `initial` nodes (M, 3) [m] or the order of the first cloud.

    The result of each cloud is the prior of the next one. Errors use `names`. Raises `InputError`.
    """
    if not clouds:
        raise InputError("no cloud is given: name at least one .pcd, .ply, .npy or .csv file, or a --camera")
    tracker = Tracker(
        length_m=settings.length_m,
        radius_m=settings.radius_m,
        nodes=settings.nodes,
        observer=settings.observer,
        initial_nodes_world=initial,
        voxel_m=0.0,  # `filter_cloud` has thinned the clouds
    )
    found: list[Nodes] = []
    seen: list[Float64Array] = []
    seconds: list[float] = []
    for cloud, name in zip(clouds, names, strict=True):
        begin = time.perf_counter()
        try:
            points = filter_cloud(cloud, settings, name)
        except InputError:
            if not found:
                raise
            points = np.empty((0, 3))  # the DLO is not in this cloud, and may be in the next
        try:
            found.append(tracker.update(points))
        except InputError as error:
            raise InputError(f"{name}: {error} (--initial)") from error
        seconds.append(time.perf_counter() - begin)
        seen.append(points)
    return TrackResult(nodes=tuple(found), seconds=tuple(seconds), clouds=tuple(seen))


def filter_cloud(points: Float64Array, settings: TrackSettings, name: str) -> Float64Array:
    """Apply perception's filters for single clouds: box, thinning, isolated points. Raises `InputError`."""
    inside = points if settings.box is None else points[inside_box(points, settings.box)]
    kept = filtered(inside, settings.voxel_m)
    if len(kept) < 2:
        raise InputError(
            f"{name}: of {len(points)} points {len(inside)} are in the box, and in cubes of --voxel-m "
            f"{settings.voxel_m:g} {len(kept)} of these are not isolated; at least 2 are needed: widen the box, "
            "make the cubes smaller, keep all points of a sparse cloud with --voxel-m 0, or check that the cloud is in "
            "metres"
        )
    return kept


def write_result(result: TrackResult, names: Sequence[str], out: Path) -> None:
    """Write nodes.npy (F, M, 3), nodes.csv, edges.csv and track.png to a folder."""
    edges = result.nodes[0].topology.edges
    np.save(out / "nodes.npy", result.nodes_world)
    np.savetxt(out / "edges.csv", edges, fmt="%d", delimiter=",", header="node,node", comments="")
    with (out / "nodes.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("cloud", *NODE_COLUMNS))
        for number, nodes in enumerate(result.nodes):
            writer.writerows(node_rows(nodes, number))
    draw_tracks(result, names, out / "track.png")


def node_rows(nodes: Nodes, cloud: int) -> Iterator[tuple[object, ...]]:
    """The rows of nodes.csv: the cloud's number or stamp, and `NODE_COLUMNS`."""
    for node, (x, y, z) in enumerate(nodes.positions_world.tolist()):
        yield cloud, node, f"{x:.6f}", f"{y:.6f}", f"{z:.6f}", int(nodes.visible[node]), distrust_of(nodes)


def distrust_of(nodes: Nodes) -> str:
    """Why nodes are not to be trusted; empty where they are."""
    return "" if nodes.distrust is None else nodes.distrust.value


def draw_tracks(result: TrackResult, names: Sequence[str], path: Path) -> None:
    """Plot clouds with their nodes, projected along the axis of their smallest extent; of more than 12 clouds, 12."""
    clouds = result.clouds
    shown = np.unique(np.linspace(0, len(clouds) - 1, min(len(clouds), MOST_PANELS)).astype(np.int64)).tolist()
    columns = min(len(shown), 3)
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(5.0 * columns, 4.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    extent = np.ptp(np.concatenate([result.nodes_world.reshape(-1, 3), *clouds]), axis=0)
    across, up = sorted(np.argsort(extent)[1:].tolist())
    for place, number in enumerate(shown, start=1):
        axes = figure.add_subplot(rows, columns, place)
        cloud, nodes = clouds[number], result.nodes[number]
        axes.scatter(cloud[:, across], cloud[:, up], s=2, color="0.7", label="cloud")
        draw_nodes(axes, nodes.positions_world, nodes.visible, nodes.topology.edges, across, up)
        axes.set_title(names[int(number)])
        if place == 1:
            axes.legend(fontsize="small")
    figure.savefig(path, dpi=110)
