"""The skeleton of a cloud: its points contracted to a line, and the unbranched pieces of that line."""

import numpy as np
import scipy

from dlokit.geometry import arc_lengths
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array

_VOXEL_M = 0.004
"""Points are first averaged over cubes of this edge [m]."""
_RADIUS_M = 0.011
"""Radius within which points are contracted to their common line [m]."""
_ROUNDS = 3
"""Number of contractions."""
_LEAST_DENSITY = 0.2
"""A place on the line is dropped where the point density is below this fraction of the median."""
_SPACING_M = 0.004
"""Distance of the points kept along the line [m]."""
_MOST_POINTS = 1500
"""A skeleton with more points is an area, not a line; a rod of 5 m has 1000."""
_SPUR_M = 0.008
"""Side branches shorter than this are noise [m]."""
_JUNCTION_M = 0.006
"""The line is cut out within this distance of a place where it branches [m]."""
_CORNER_M = 0.012
"""The bend at a point is measured over this length to both sides [m]."""
_CORNER_TURN_RAD = 1.4
"""A line that turns by more than this at a point [rad] is split into two lines."""
_AHEAD_M = 0.03
"""A piece is split where the end of another points at it from within this distance [m]: one rod may cross there."""
_MEET_M = 0.006
"""An end points at a piece when its straight continuation comes this near to it [m]."""
_LEAST_PIECE_M = 0.004
"""Pieces shorter than this are dropped [m]."""


def skeleton(points: Float64Array) -> list[Float64Array]:
    """The unbranched pieces (K, 3) [m] of a cloud (N, 3) [m], each in order, in no order among themselves.

    A cloud that covers an area has none.
    """
    line = spaced(contracted(points), _SPACING_M)
    if len(line) > _MOST_POINTS:
        return []
    joined = _neighbours(spanning_tree(line, 3.0 * _SPACING_M), len(line))
    _prune(joined, _SPUR_M)
    branching = line[[len(near) > 2 for near in joined]]
    if len(branching) > 0:
        _cut(joined, np.flatnonzero(scipy.spatial.KDTree(branching).query(line)[0] < _JUNCTION_M).tolist())
    pieces: list[Float64Array] = []
    for chain in _chains(joined):
        corners = _corners(line[chain], _CORNER_M, _CORNER_TURN_RAD)
        pieces += [line[part] for part in np.split(np.array(chain), corners)]
    pieces = [piece for piece in pieces if len(piece) > 1 and arc_lengths(piece)[-1] >= _LEAST_PIECE_M]
    return _split_where_met(pieces)


def contracted(points: Float64Array) -> Float64Array:
    """Points (K, 3) [m] of the cloud (N, 3) [m], averaged over cubes and moved across the line to its middle.

    A moving least-squares line (Lee 2000): a point moves to the weighted mean of its neighbours, but only across their
    main direction, so that tips keep their positions.
    """
    line, weights = averaged(points, _VOXEL_M)
    for _ in range(_ROUNDS):
        pairs = scipy.spatial.KDTree(line).query_pairs(_RADIUS_M, output_type="ndarray")
        line = _round(line, weights, pairs, _RADIUS_M)
    around = np.array([weights[near].sum() for near in scipy.spatial.KDTree(line).query_ball_point(line, _SPACING_M)])
    return line[around > _LEAST_DENSITY * np.median(around)]


def _round(line: Float64Array, weights: Float64Array, pairs: Int64Array, radius_m: float) -> Float64Array:
    a = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(len(line))])
    b = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(len(line))])
    apart = line[b] - line[a]
    near = 1.0 - np.sum(apart**2, axis=1) / radius_m**2
    kernel = weights[b] * near**2
    graph = scipy.sparse.csr_matrix((kernel, (a, b)), shape=(len(line), len(line)))
    total = np.asarray(graph.sum(axis=1)).ravel()
    mean = (graph @ line) / total[:, None]
    squares = (line[:, :, None] * line[:, None, :]).reshape(-1, 9)
    spread = ((graph @ squares) / total[:, None]).reshape(-1, 3, 3) - mean[:, :, None] * mean[:, None, :]
    along = np.linalg.eigh(spread)[1][:, :, 2]
    shift = mean - line
    return line + shift - np.sum(shift * along, axis=1)[:, None] * along


def averaged(points: Float64Array, voxel_m: float) -> tuple[Float64Array, Float64Array]:
    """The mean (K, 3) of the points in each occupied cube, and their number (K,)."""
    cell = np.floor((points - points.min(axis=0)) / voxel_m).astype(np.int64)
    size = cell.max(axis=0) + 1
    _, cube, counts = np.unique(
        (cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2], return_inverse=True, return_counts=True
    )
    means = [np.bincount(cube, weights=points[:, axis]) / counts for axis in range(3)]
    return np.column_stack(means), counts.astype(np.float64)


def spaced(points: Float64Array, spacing_m: float) -> Float64Array:
    """A subset of the points (N, 3) [m] at least `spacing_m` apart, with every point within `spacing_m` of it."""
    neighbours = scipy.spatial.KDTree(points).query_ball_point(points, spacing_m)
    free = np.ones(len(points), dtype=np.bool_)
    kept: list[int] = []
    for index, near in enumerate(neighbours):
        if free[index]:
            kept.append(index)
            free[near] = False
    return points[kept]


def spanning_tree(points: Float64Array, longest_m: float) -> "scipy.sparse.csr_matrix":
    """The minimum spanning tree (K, K) of the points, or forest, by edges up to `longest_m`, weights [m]."""
    edges = scipy.spatial.KDTree(points).query_pairs(longest_m, output_type="ndarray")
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    graph = scipy.sparse.coo_matrix((lengths, (edges[:, 0], edges[:, 1])), shape=(len(points), len(points)))
    return scipy.sparse.csr_matrix(scipy.sparse.csgraph.minimum_spanning_tree(graph.tocsr()))


Neighbours = list[dict[int, float]]
"""For each point its neighbours, and their distances [m]."""


def _neighbours(tree: "scipy.sparse.csr_matrix", count: int) -> Neighbours:
    joined: Neighbours = [{} for _ in range(count)]
    entries = tree.tocoo()
    for a, b, length in zip(entries.row.tolist(), entries.col.tolist(), entries.data.tolist(), strict=True):
        joined[a][b] = joined[b][a] = length
    return joined


def _spur(joined: Neighbours, leaf: int) -> tuple[float, list[int], int]:
    """The path from a leaf to the first branching: its length [m] (infinite without a branching), points, branching."""
    path, length = [leaf], 0.0
    while True:
        onward = [point for point in joined[path[-1]] if len(path) < 2 or point != path[-2]]
        if not onward:
            return np.inf, path, -1
        length += joined[path[-1]][onward[0]]
        if len(joined[onward[0]]) > 2:
            return length, path, onward[0]
        path.append(onward[0])


def _prune(joined: Neighbours, spur_m: float) -> None:
    """Remove side branches shorter than `spur_m`, at each branching the shortest first."""
    while True:
        leaves = [index for index, near in enumerate(joined) if len(near) == 1]
        spurs = sorted(spur for spur in (_spur(joined, leaf) for leaf in leaves) if spur[0] < spur_m)
        if not spurs:
            return
        done: set[int] = set()
        for _, path, branching in spurs:
            if branching not in done:
                done.add(branching)
                _cut(joined, path)


def _cut(joined: Neighbours, points: list[int]) -> None:
    """Remove points with their edges."""
    for point in points:
        for other in joined[point]:
            del joined[other][point]
        joined[point] = {}


def _chains(joined: Neighbours) -> list[list[int]]:
    """The unbranched paths from leaf to leaf."""
    chains: list[list[int]] = []
    done: set[int] = set()
    for leaf in [index for index, near in enumerate(joined) if len(near) == 1]:
        if leaf in done:
            continue
        path = [leaf]
        while onward := [point for point in joined[path[-1]] if len(path) < 2 or point != path[-2]]:
            path.append(onward[0])
        done.add(path[-1])
        chains.append(path)
    return chains


def _corners(chain: Float64Array, reach_m: float, sharpest: float) -> list[int]:
    """Points where a path (K, 3) [m] turns by more than `sharpest` [rad] within `reach_m` to both sides."""
    s = arc_lengths(chain)
    found: list[tuple[float, int]] = []
    for index in range(1, len(chain) - 1):
        before = chain[index] - chain[np.searchsorted(s, max(s[index] - reach_m, 0.0))]
        after = chain[min(np.searchsorted(s, s[index] + reach_m), len(chain) - 1)] - chain[index]
        cosine = before @ after / max(float(np.linalg.norm(before) * np.linalg.norm(after)), 1e-12)
        if cosine < np.cos(sharpest):
            found.append((float(cosine), index))
    taken: list[int] = []
    for _, index in sorted(found):
        if all(abs(s[index] - s[other]) > reach_m for other in taken):
            taken.append(index)
    return sorted(taken)


def _split_where_met(pieces: list[Float64Array]) -> list[Float64Array]:
    """The pieces, each split where the end of a nearby piece points at it."""
    if len(pieces) == 0:
        return []
    owner = np.concatenate([np.full(len(piece), number) for number, piece in enumerate(pieces)])
    index = np.concatenate([np.arange(len(piece)) for piece in pieces])
    line = np.vstack(pieces)
    inside = np.concatenate([_inside(piece, _CORNER_M) for piece in pieces])
    tree = scipy.spatial.KDTree(line)
    cuts: list[set[int]] = [set() for _ in pieces]
    steps = np.arange(0.004, _AHEAD_M, 0.002)[:, None]
    for number, piece in enumerate(pieces):
        for directed in (piece, piece[::-1]):
            inner = directed[min(np.searchsorted(arc_lengths(directed), _CORNER_M), len(directed) - 1)]
            direction = (directed[0] - inner) / max(float(np.linalg.norm(directed[0] - inner)), 1e-9)
            distance, nearest = tree.query(directed[0] + steps * direction, distance_upper_bound=_MEET_M)
            found = np.asarray(nearest, dtype=np.int64)[np.isfinite(distance)]
            own = (owner == number) & (np.linalg.norm(line - directed[0], axis=1) < 3.0 * _CORNER_M)
            hit = found[~own[found] & inside[found]]
            if len(hit) > 0:
                cuts[owner[hit[0]]].add(int(index[hit[0]]))
    parts = [part for piece, at in zip(pieces, cuts, strict=True) for part in np.split(piece, sorted(at))]
    return [part for part in parts if len(part) > 1 and arc_lengths(part)[-1] >= _LEAST_PIECE_M]


def _inside(piece: Float64Array, margin_m: float) -> BoolArray:
    """Which points of a piece (K, 3) [m] are farther along it than a margin from both ends, (K,)."""
    s = arc_lengths(piece)
    return (s > margin_m) & (s < s[-1] - margin_m)
