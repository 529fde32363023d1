"""Files of shapes: `.csv` and `.npy` with points in metres, as `--goal` takes and runs write them."""

import io
import re
from pathlib import Path

import numpy as np

from dlokit.description import shapes
from dlokit.errors import ShapeError
from dlokit.types.arrays import Float64Array

_MILLIMETRES_OVER_M = 5.0  # on a table of 0.7 m, a rope longer than this was not given in metres
_SUFFIXES = frozenset({".npy", ".csv"})
_INDEXED = re.compile(r"^(?P<path>.+\.npy):(?P<index>-?\w*)$", re.IGNORECASE)


def csv_of(nodes_world: Float64Array) -> bytes:
    """Nodes (K, 3) [m] as a `.csv` file that `points_of_csv` reads."""
    text = io.BytesIO()
    np.savetxt(text, nodes_world, fmt="%.6f", delimiter=",", header="x,y,z", comments="")
    return text.getvalue()


def points_of_csv(data: bytes, name: str) -> Float64Array:
    """The points (K, 3) or (K, 2) [m] of a `.csv` file's content; `name` is for errors. Raises `ShapeError`."""
    return _check_points(_rows(data, name), name)


def is_file_name(text: str) -> bool:
    """Whether the name of a shape is a file name, with or without an index, existing or not."""
    indexed = _INDEXED.match(text)
    return Path(indexed["path"] if indexed else text).suffix.lower() in _SUFFIXES


def read_points(text: str) -> Float64Array:
    """The unmodified points of ``FILE`` or ``FILE:3``, (K, 3) or (K, 2) [m], K ≥ 2. Raises `ShapeError`."""
    indexed = _INDEXED.match(text)
    path = Path(indexed["path"] if indexed else text).expanduser()
    if path.suffix.lower() not in _SUFFIXES:
        raise ShapeError(f"Shape file {path} ends in {path.suffix!r}; .npy and .csv are allowed: convert it.")
    if not path.is_file():
        raise ShapeError(f"Shape file {path} does not exist (looked in {Path.cwd()}): check the path.")
    if path.stat().st_size == 0:
        raise ShapeError(f"Shape file {path} is empty: it must hold at least two points (x, y[, z]) in metres.")
    array = _read_npy(path) if path.suffix.lower() == ".npy" else _read_csv(path)
    return _check_points(_pick(array, path, indexed["index"] if indexed else None), text)


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
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ShapeError(f"Shape file {path} cannot be read ({error.strerror}): check its permissions.") from error
    return _rows(data, str(path))


def _rows(data: bytes, name: str) -> Float64Array:
    """Rows of numbers split by commas, semicolons or blanks; one header line and ``#`` comments are skipped."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ShapeError(f"Shape file {name} is not text: save it as CSV in UTF-8, one point x,y[,z] a line.") from None
    rows: list[list[float]] = []
    header_seen = False
    for number, line in enumerate(text.splitlines(), start=1):
        fields = [field for field in re.split(r"[,;\s]+", line.split("#")[0].strip()) if field]
        if not fields:
            continue
        if re.search(r"\d,\d+\s*;", line):
            raise ShapeError(
                f"Shape file {name}, line {number}: {line.strip()!r} has decimal commas; write points, as in 0.5."
            )
        try:
            rows.append([float(field) for field in fields])
        except ValueError:
            if rows or header_seen:
                raise ShapeError(
                    f"Shape file {name}, line {number}: {line.strip()!r} is not a row of numbers x,y[,z]; correct it."
                ) from None
            header_seen = True
    if len({len(row) for row in rows}) > 1:
        raise ShapeError(f"Shape file {name} has rows of different length: each point needs x,y or x,y,z.")
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
        hint = " Save its transpose: a row for each point." if points.ndim == 2 and len(points) in (2, 3) else ""
        raise ShapeError(
            f"Shape {text} has the shape {points.shape}: allowed are (K, 3), (K, 2), or (G, K, 3) with FILE:INDEX."
            f"{hint}"
        )
    if len(points) < 2:
        raise ShapeError(f"Shape {text} has {len(points)} point(s): a curve needs at least two.")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise ShapeError(
            f"Shape {text} has NaN or infinity in {len(bad)} of {len(points)} points, first in point {bad[0]}: "
            "remove these points or fill them in."
        )
    if len(points) > 2 and np.array_equal(points[:, 0], np.arange(len(points)) + points[0, 0]):
        raise ShapeError(f"Shape {text} counts its points in the first column: save the coordinates alone, in metres.")
    arc_m = shapes.length(points)
    if arc_m == 0.0:
        raise ShapeError(f"Shape {text} has zero length: all its {len(points)} points are the same; give a curve.")
    if arc_m > _MILLIMETRES_OVER_M:
        raise ShapeError(
            f"Shape {text} is {arc_m:.4g} m long, which looks like millimetres: points must be in metres; "
            "divide them by 1000."
        )
    return points
