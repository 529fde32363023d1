"""Files of points: `.csv` and `.npy` of shapes, as `--goal` takes and runs write them, and of clouds and nodes."""

import io
import re
import zipfile
from pathlib import Path

import numpy as np

from dlokit import geometry
from dlokit.errors import InputError, ShapeError
from dlokit.types.arrays import Float64Array

_MILLIMETRES_OVER_M = 5.0  # on a table of 0.7 m, a rope longer than this was not given in metres
_SUFFIXES = frozenset({".npy", ".csv"})
_INDEXED = re.compile(r"^(?P<path>.+\.(?:npy|csv)):(?P<index>-?\w*)$", re.IGNORECASE)
_AXIS = re.compile(r"[^a-z]*([xyz])(?:[ _]*[\[(]?(m|mm|cm|um|µm|in|inch|ft)[\])]?)?")
"""The heading of a column of coordinates, with its unit."""
_NUMBER = re.compile(r"[-+.\d]")
"""First characters of cells with numbers; a heading never begins with them."""
_FRAMES = ("cloud", "stamp_ns")
"""Headings of the column that numbers the clouds in the nodes.csv of `dlokit track`."""


def read_npy(path: Path) -> np.ndarray:
    """The array of numbers, or of named columns, in a `.npy` file. Raises `InputError`."""
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)  # mapped: a shape that the file cannot hold is found
    except (ValueError, EOFError, OSError, OverflowError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path} is not an array: {error}; write it with numpy.save, a row x, y, z in metres for each point"
        ) from error
    if not isinstance(array, np.ndarray) or (array.dtype.kind not in "fiu" and array.dtype.names is None):
        raise InputError(
            f"{path} contains no numbers; write real numbers with numpy.save, a row x, y, z in metres for each point"
        )
    return np.array(array)


def rows_of_csv(data: bytes, name: str) -> Float64Array:
    """The rows (N, K) of a `.csv` file; x, y and z alone (N, 3) where a heading names them.

    Nodes of T clouds, as `dlokit track` writes them, are (T, M, 3). `name` is for errors. Raises `InputError`.
    """
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{name} is not text: {error}; a .csv has x, y, z in metres on each line") from error
    columns: list[int] = []  # columns of x, y, z and of the cloud's number; empty: all, in this order
    width = 0
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        cells = _cells(line.lstrip("# ").partition("#")[0])
        if not cells:
            continue
        if line.lstrip().startswith("#") or not (rows or any(map(_NUMBER.match, cells))):
            if not columns and (columns := _coordinates(cells, name)):
                width = len(cells)
            continue  # a comment, or the heading
        width = width or len(cells)
        if len(cells) != width:
            raise InputError(f"{name}, line {number} has {len(cells)} columns, the first has {width}")
        try:
            rows.append([float(cells[at]) for at in columns or range(width)])
        except ValueError:
            raise InputError(
                f"{name}, line {number}: {line.strip()[:60]!r} is not a row of numbers x, y, z in metres"
            ) from None
    if not rows:
        raise InputError(f"{name} contains no numbers; a .csv has x, y, z in metres on each line")
    points = np.array(rows, dtype=np.float64)
    if len(columns) < 4:
        return points
    clouds = np.split(points[:, :3], np.flatnonzero(np.diff(points[:, 3])) + 1)
    if len({len(nodes) for nodes in clouds}) > 1:
        raise InputError(f"{name}: its clouds differ in their number of nodes; it was cut or edited, write it again")
    return np.stack(clouds)


def _cells(line: str) -> list[str]:
    """The cells of a line, cut at semicolons, tabs, commas or blanks; decimal commas become points."""
    cut = next((mark for mark in ";\t," if mark in line), None)
    cells = [cell.strip(" '\"") for cell in line.split(cut)]
    return cells if cut == "," else [cell.replace(",", ".") for cell in cells]


def _coordinates(heading: list[str], name: str) -> list[int]:
    """Columns of x, y, z, and of the cloud's number if present; empty if the heading does not name them.

    Raises `InputError` for another unit than metres.
    """
    titles = [cell.lower() for cell in heading]
    axes = sorted((match[1], at, match[2]) for at, title in enumerate(titles) if (match := _AXIS.fullmatch(title)))
    if [axis for axis, _, _ in axes] != ["x", "y", "z"]:
        return []
    if any(unit not in (None, "m") for _, _, unit in axes):
        raise InputError(
            f"{name}: the heading is {', '.join(heading)}; convert to metres, and write x, y, z above them"
        )
    return [*(at for _, at, _ in axes), *(at for at, title in enumerate(titles) if title in _FRAMES)]


def csv_of(nodes_world: Float64Array) -> bytes:
    """Nodes (K, 3) [m] as a `.csv` file that `points_of_csv` reads."""
    text = io.BytesIO()
    np.savetxt(text, nodes_world, fmt="%.6f", delimiter=",", header="x,y,z", comments="")
    return text.getvalue()


def points_of_csv(data: bytes, name: str) -> Float64Array:
    """The points (K, 3) or (K, 2) [m] of a `.csv` file's content; `name` is for errors. Raises `ShapeError`."""
    try:
        rows = rows_of_csv(data, name)
    except InputError as error:
        raise ShapeError(f"Shape file {error}") from error
    return _check_points(rows, name)


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
    try:
        array = read_npy(path) if path.suffix.lower() == ".npy" else rows_of_csv(path.read_bytes(), str(path))
    except (InputError, OSError) as error:
        raise ShapeError(f"Shape file {error}") from error
    return _check_points(_pick(array, path, indexed["index"] if indexed else None), text).astype(np.float64)


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
    arc_m = float(geometry.arc_lengths(points)[-1])
    if arc_m == 0.0:
        raise ShapeError(f"Shape {text} has zero length: all its {len(points)} points are the same; give a curve.")
    if arc_m > _MILLIMETRES_OVER_M:
        raise ShapeError(
            f"Shape {text} is {arc_m:.4g} m long, which looks like millimetres: points must be in metres; "
            "divide them by 1000."
        )
    return points
