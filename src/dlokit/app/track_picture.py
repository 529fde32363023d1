"""The picture of `dlokit track`: each cloud with the nodes that were found in it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_PANELS = 12


def draw_tracks(
    clouds: Sequence[Array],
    nodes_world: Array,
    visible: NDArray[np.bool_],
    edges: NDArray[np.int64],
    names: Sequence[str],
    path: Path,
) -> None:
    """Draw F clouds (N, 3) [m] with nodes (F, M, 3) [m], seen along the axis in which they extend least.

    More than 12 clouds are shown by 12 of them, evenly spaced.
    """
    shown = np.unique(np.linspace(0, len(clouds) - 1, min(len(clouds), MOST_PANELS)).astype(np.int64))
    columns = min(len(shown), 3)
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(5.0 * columns, 4.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    extent = np.ptp(np.concatenate([nodes_world.reshape(-1, 3), *clouds]), axis=0)
    across, up = sorted(np.argsort(extent)[1:].tolist())
    for place, number in enumerate(shown, start=1):
        axes = figure.add_subplot(rows, columns, place)
        cloud, nodes, seen = clouds[number], nodes_world[number], visible[number]
        axes.scatter(cloud[:, across], cloud[:, up], s=2, color="0.7", label="cloud")
        for a, b in edges:
            axes.plot(nodes[[a, b], across], nodes[[a, b], up], color="tab:blue", linewidth=1)
        axes.scatter(nodes[seen, across], nodes[seen, up], s=12, color="tab:blue", zorder=3, label="visible node")
        axes.scatter(nodes[~seen, across], nodes[~seen, up], s=12, color="tab:red", zorder=3, label="hidden node")
        axes.scatter(nodes[:1, across], nodes[:1, up], s=60, facecolors="none", edgecolors="black", label="node 0")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(names[int(number)])
        axes.set_xlabel(f"{'xyz'[across]} [m]")
        axes.set_ylabel(f"{'xyz'[up]} [m]")
        if place == 1:
            axes.legend(fontsize="small")
    figure.savefig(path, dpi=110)
