"""Read start and goal shapes of the command line: ``I``, ``S``, ``random``, a file, ``FILE:3``."""

import re
from pathlib import Path

import numpy as np

from dlokit import geometry
from dlokit.description import shapes
from dlokit.description.shapes import LENGTH_TOLERANCE
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.errors import ShapeError
from dlokit.types.arrays import Float64Array

RANDOM = "random"
MAX_LIFT_M = 0.05
"""Maximum height above the table of a shape that lies on it [m]."""
_MILLIMETRES_OVER_M = 5.0  # on a table of 0.7 m, a rope longer than this was not given in metres
_SAMPLES = ("I, S, random", "a .npy or .csv file with (K, 3) or (K, 2) points in metres")
_SUFFIXES = frozenset({".npy", ".csv"})
_INDEXED = re.compile(r"^(?P<path>.+\.npy):(?P<index>-?\w*)$", re.IGNORECASE)


def shape_from_text(
    text: str,
    *,
    length_m: float,
    count: int,
    radius_m: float,
    rng: np.random.Generator,
    fit_length: bool = False,
    middle_m: tuple[float, float] | None = None,
    on_table: bool = True,
) -> Float64Array:
    """The shape that the user names, for a rope of `length_m` and `radius_m`.

    Without `on_table` it may be anywhere. `middle_m` is the position on the table (x, y) [m] to which the centre of the
    shape's extent is moved, if given. `rng` is used only for ``random`` shapes. Returns nodes (count, 3) [m] in the
    world frame, equally spaced by arc length, with exactly the length of the rope. Raises `ShapeError`.
    """
    name = text.strip()
    if name in shapes.BUILTIN_SHAPES:
        nodes = shapes.builtin_shape(name, length_m, count, radius_m=radius_m)
    elif name == RANDOM:
        nodes = shapes.random_shape(rng, length_m, count, radius_m=radius_m)
    else:
        points = _on_rope_height(read_points(name), name, radius_m)
        nodes = _of_rope_length(points, name, length_m, count, fit_length=fit_length)
    if middle_m is not None:
        extent = (nodes[:, :2].min(axis=0) + nodes[:, :2].max(axis=0)) / 2.0
        nodes = shapes.moved(nodes, np.asarray(middle_m) - extent)
    if on_table:
        _require_on_table(nodes, name)
    return nodes


def is_file_name(text: str) -> bool:
    """Whether the name of a shape is a file name, with or without an index, existing or not."""
    indexed = _INDEXED.match(text)
    return Path(indexed["path"] if indexed else text).suffix.lower() in _SUFFIXES


def read_points(text: str) -> Float64Array:
    """The unmodified points of ``FILE`` or ``FILE:3``, (K, 3) or (K, 2) [m], K ≥ 2. Raises `ShapeError`."""
    indexed = _INDEXED.match(text)
    path = Path(indexed["path"] if indexed else text).expanduser()
    if path.suffix.lower() not in _SUFFIXES:
        raise _unknown(text, path)
    if not path.is_file():
        raise ShapeError(f"Shape file {path} does not exist (looked in {Path.cwd()}): check the path.")
    if path.stat().st_size == 0:
        raise ShapeError(f"Shape file {path} is empty: it must hold at least two points (x, y[, z]) in metres.")
    array = _read_npy(path) if path.suffix.lower() == ".npy" else _read_csv(path)
    return _check_points(_pick(array, path, indexed["index"] if indexed else None), text)


def _unknown(text: str, path: Path) -> ShapeError:
    allowed = f"Allowed are {_SAMPLES[0]}, or {_SAMPLES[1]}"
    for name in (*shapes.BUILTIN_SHAPES, RANDOM):
        if text.lower() == name.lower():
            return ShapeError(f"There is no shape {text!r}; did you mean {name!r}? {allowed}.")
    if path.suffix and path.is_file():
        return ShapeError(f"Shape file {path} ends in {path.suffix!r}. {allowed}: convert it to one of them.")
    return ShapeError(f"There is no shape {text!r}. {allowed}.")


def _read_npy(path: Path) -> Float64Array:
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ShapeError(
            f"Shape file {path} cannot be read ({error}): save an array of numbers with numpy.save."
        ) from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise ShapeError(
            f"Shape file {path} holds {getattr(array, 'dtype', type(array))}: save real numbers, in metres."
        )
    return array.astype(np.float64)


def _read_csv(path: Path) -> Float64Array:
    """Rows of numbers split by commas, semicolons or blanks; one header line and ``#`` comments are skipped."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise ShapeError(f"Shape file {path} cannot be read ({error.strerror}): check its permissions.") from error
    except UnicodeDecodeError:
        raise ShapeError(f"Shape file {path} is not text: save it as CSV in UTF-8, one point x,y[,z] a line.") from None
    rows: list[list[float]] = []
    header_seen = False
    for number, line in enumerate(lines, start=1):
        fields = [field for field in re.split(r"[,;\s]+", line.split("#")[0].strip()) if field]
        if not fields:
            continue
        try:
            rows.append([float(field) for field in fields])
        except ValueError:
            if rows or header_seen:
                raise ShapeError(
                    f"Shape file {path}, line {number}: {line.strip()!r} is not a row of numbers x,y[,z]; correct it."
                ) from None
            header_seen = True
    if len({len(row) for row in rows}) > 1:
        raise ShapeError(f"Shape file {path} has rows of different length: each point needs x,y or x,y,z.")
    return np.array(rows, dtype=np.float64) if rows else np.empty((0, 2))


def _pick(array: Float64Array, path: Path, index: str | None) -> Float64Array:
    """Select the shape (K, d) from a file that may contain several (G, K, d)."""
    if array.ndim == 3:
        last = len(array) - 1
        if index is None:
            raise ShapeError(f"Shape file {path} holds {len(array)} shapes: name one, from {path}:0 to {path}:{last}.")
        if not index.isdecimal() or int(index) > last:
            raise ShapeError(f"There is no shape {index!r} in {path}: allowed are {path}:0 to {path}:{last}.")
        return array[int(index)]
    if index is not None:
        raise ShapeError(f"Shape file {path} holds a single shape of {array.shape}: omit ':{index}'.")
    return array


def _check_points(points: Float64Array, text: str) -> Float64Array:
    if points.ndim != 2 or (points.size and points.shape[1] not in (2, 3)):
        raise ShapeError(
            f"Shape {text} has the shape {points.shape}: allowed are (K, 3), (K, 2), or (G, K, 3) with FILE:INDEX."
        )
    if len(points) < 2:
        raise ShapeError(f"Shape {text} has {len(points)} point(s): a curve needs at least two.")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise ShapeError(
            f"Shape {text} has NaN or infinity in {len(bad)} of {len(points)} points, first in point {bad[0]}: "
            "remove these points or fill them in."
        )
    arc_m = shapes.length(points)
    if arc_m == 0.0:
        raise ShapeError(f"Shape {text} has zero length: all its {len(points)} points are the same; give a curve.")
    if arc_m > _MILLIMETRES_OVER_M:
        raise ShapeError(
            f"Shape {text} is {arc_m:.4g} m long, which looks like millimetres: points must be in metres; "
            "divide them by 1000."
        )
    return points


def _on_rope_height(points: Float64Array, text: str, radius_m: float) -> Float64Array:
    """Points (K, 2) or (K, 3) as (K, 3); planar points get the height of a rope on the table."""
    if points.shape[1] == 2:
        return np.column_stack([points, np.full(len(points), radius_m)])
    if points[:, 2].min() < -MAX_LIFT_M or points[:, 2].max() > MAX_LIFT_M:
        raise ShapeError(
            f"Shape {text} has heights z from {points[:, 2].min():.3f} to {points[:, 2].max():.3f} m; the rope lies "
            f"on the table at z = {radius_m} m and {MAX_LIFT_M} m is allowed. Correct z, or give (K, 2) points."
        )
    # A rope on the table has one height; deviations within the tolerance are measurement errors of the file.
    return np.column_stack([points[:, :2], np.full(len(points), radius_m)])


def _of_rope_length(points: Float64Array, text: str, length_m: float, count: int, *, fit_length: bool) -> Float64Array:
    """Resample points (K, 3) to nodes (count, 3) with the length of the rope."""
    arc_m = shapes.length(points)
    if arc_m == 0.0:
        raise ShapeError(f"Shape {text} has zero length in the table plane: its points are above one another.")
    if abs(arc_m - length_m) > LENGTH_TOLERANCE * length_m and not fit_length:
        raise ShapeError(
            f"Shape {text} is {arc_m:.3f} m long, the rope {length_m:.3f} m; a difference of {LENGTH_TOLERANCE:.0%} is "
            "allowed. Give a curve of the rope's length, or scale it with --fit-length."
        )
    return geometry.resample(shapes.fit_length(points, length_m), count)


def _require_on_table(nodes: Float64Array, text: str) -> None:
    (x0, x1), (y0, y1) = TABLE_X_M, TABLE_Y_M
    x, y = nodes[:, 0], nodes[:, 1]
    if x.min() < x0 or x.max() > x1 or y.min() < y0 or y.max() > y1:
        raise ShapeError(
            f"Shape {text} is outside the table: it spans x {x.min():.3f} to {x.max():.3f} m and y {y.min():.3f} to "
            f"{y.max():.3f} m (world frame, on the table); allowed are x {x0} to {x1} m and y {y0} to {y1} m. "
            "Move it there; a goal is moved by --goal-at-m 0.52 0, or to the nearest place by --infeasible project."
        )
