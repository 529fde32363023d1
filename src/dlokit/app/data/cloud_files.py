"""Recorded clouds: .pcd, .ply, .npy and .csv files as points in metres.

Only x, y and z are read. Memory use is bounded by the size of the file.
"""

import re
import zipfile
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dlokit.app.data.pcd_file import read_pcd
from dlokit.errors import InputError
from dlokit.types.arrays import Float64Array, as_numbers

LARGEST_FILE_BYTES = 1 << 30
FORMATS = (".pcd", ".ply", ".npy", ".csv")
FARTHEST_M = 100.0
"""Coordinates of a cloud are at most this large [m]; larger ones are in another unit."""
_AXIS = re.compile(r"[^a-z]*([xyz])(?:[ _]*[\[(]?(m|mm|cm|um|µm|in|inch|ft)[\])]?)?")
"""The heading of a column of coordinates, with its unit."""
_NUMBER = re.compile(r"[-+.\d]")
"""How the cells of points begin, and no heading does."""
_FRAMES = ("cloud", "stamp_ns")
"""Headings of the column that numbers the clouds in the nodes.csv of `dlokit track`."""


def as_points(values: ArrayLike, name: str) -> Float64Array:
    """What a caller gives as one set of points, as an array (N, 3) [m].

    Of an array with named columns x, y and z are read. Raises `InputError`, which names the points: columns are
    missing, the shape is another one, or all coordinates are whole numbers, as of millimetres.
    """
    if isinstance(values, np.ndarray) and values.dtype.names is not None:
        if not {"x", "y", "z"} <= set(values.dtype.names):
            raise InputError(
                f"{name}: the columns are {', '.join(values.dtype.names)}; x, y and z are needed, in metres"
            )
        values = np.stack([as_numbers(values[axis], name) for axis in "xyz"], axis=-1)
    points = as_numbers(values, name)
    points = points[0] if points.ndim == 3 and len(points) == 1 else points
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(
            f"{name}: the shape is {points.shape}; needed is (N, 3), x, y and z in metres: transpose (3, N), give the "
            "clouds of (T, N, 3) one by one, and reshape a picture (height, width, 3)"
        )
    sample = points[:: max(len(points) // 1000, 1)]
    sample = sample[np.isfinite(sample).all(axis=1) & sample.any(axis=1)]
    if len(sample) > 1 and np.array_equal(sample, np.round(sample)):
        raise InputError(
            f"{name}: all coordinates are whole numbers, the first are {sample[0]}; divide millimetres by 1000"
        )
    return points


def read_ply(path: Path) -> Float64Array:
    """The vertices (N, 3) of a .ply file. Raises `InputError`."""
    from trimesh.exchange.ply import load_ply  # importing trimesh takes a quarter of a second

    try:
        with path.open("rb") as file:
            read = load_ply(file)
        points, promised = np.asarray(read["vertices"], np.float64), read["metadata"]["_ply_raw"]["vertex"]["length"]
    except Exception as error:  # trimesh does not document its errors; the call only reads the file
        raise InputError(
            f"{path} is truncated or not a .ply file of points: {error}; each vertex needs x, y and z: record "
            "it again, or convert it"
        ) from error
    if len(points) != promised:
        raise InputError(
            f"{path} declares {promised} vertices and contains {len(points)}; it is truncated, record it again"
        )
    return points.reshape(-1, 3)


def read_cloud(path: Path) -> Float64Array:
    """The points (N, 3) [m] of a cloud file, N >= 2.

    Points with a coordinate that is not finite, and those at (0, 0, 0), are omitted from .pcd and .ply files, where
    they mark an unknown depth; in .npy and .csv files the former are an error. Raises `InputError`.
    """
    points = as_points(_read(path), str(path))
    if path.suffix.lower() in (".pcd", ".ply"):
        points = points[np.all(np.isfinite(points), axis=1) & np.any(points != 0.0, axis=1)]
    return _checked(points, path)


def read_nodes(path: Path) -> Float64Array:
    """The nodes (M, 3) [m] of a .npy or .csv file, M >= 2; of the nodes of several clouds, those of the last cloud.

    Raises `InputError`.
    """
    if path.suffix.lower() not in (".npy", ".csv"):
        raise InputError(f"{path}: nodes must be a .npy or .csv file, not {path.suffix or 'one without an extension'}")
    nodes = _read(path)
    return _checked(as_points(nodes[-1] if nodes.ndim == 3 and len(nodes) else nodes, str(path)), path)


def _read(path: Path) -> np.ndarray:
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise InputError(
            f"{path}: a cloud must be a file that ends in {', '.join(FORMATS)}; convert it to one of these"
        )
    if not path.is_file():
        raise InputError(f"{path} does not exist; give the path of a recorded cloud")
    size = path.stat().st_size
    if size == 0:
        raise InputError(f"{path} is empty; a cloud needs at least 2 points")
    if size > LARGEST_FILE_BYTES:
        raise InputError(f"{path} has {size} bytes; the limit is {LARGEST_FILE_BYTES}; thin or crop the cloud first")
    if ending == ".pcd":
        return read_pcd(path)
    if ending == ".ply":
        return read_ply(path)
    return _read_npy(path) if ending == ".npy" else _read_csv(path)


def _read_npy(path: Path) -> np.ndarray:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)  # mapped: a shape that the file cannot hold is found
    except (ValueError, EOFError, OSError, OverflowError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is not an array: {error}; write it with numpy.save, shape (N, 3), metres") from error
    if not isinstance(array, np.ndarray) or (array.dtype.kind not in "fiu" and array.dtype.names is None):
        raise InputError(f"{path} contains no numbers; write an array (N, 3) of metres with numpy.save")
    return np.array(array)


def _read_csv(path: Path) -> Float64Array:
    """The rows (N, K) of a .csv file; x, y and z alone (N, 3) where a heading names them.

    Nodes of T clouds, as `dlokit track` writes them, are (T, M, 3).
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (UnicodeDecodeError, OSError) as error:
        raise InputError(f"{path} is not text: {error}; a .csv has x, y, z in metres on each line") from error
    columns: list[int] = []  # where x, y, z and the cloud's number are; empty: all, in this order
    width = 0
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        cells = _cells(line.lstrip("# "))
        if not cells:
            continue
        if line.lstrip().startswith("#") or not (rows or any(map(_NUMBER.match, cells))):
            if not columns and (columns := _coordinates(cells, path)):
                width = len(cells)
            continue  # a comment, or the heading
        width = width or len(cells)
        if len(cells) != width:
            raise InputError(f"{path}, line {number} has {len(cells)} columns, the first has {width}")
        try:
            rows.append([float(cells[at]) for at in columns or range(width)])
        except ValueError:
            raise InputError(f"{path}, line {number}: {line.strip()[:60]!r} is not x, y, z in metres") from None
    if not rows:
        raise InputError(f"{path} contains no numbers; a .csv has x, y, z in metres on each line")
    points = np.array(rows, dtype=np.float64)
    if len(columns) < 4:
        return points
    clouds = np.split(points[:, :3], np.flatnonzero(np.diff(points[:, 3])) + 1)
    if len({len(nodes) for nodes in clouds}) > 1:
        raise InputError(f"{path}: its clouds differ in their number of nodes; it was cut or edited, write it again")
    return np.stack(clouds)


def _cells(line: str) -> list[str]:
    """The cells of a line, cut at semicolons, tabs, commas or blanks; decimal commas become points."""
    cut = next((mark for mark in ";\t," if mark in line), None)
    cells = [cell.strip(" '\"") for cell in line.split(cut)]
    return cells if cut == "," else [cell.replace(",", ".") for cell in cells]


def _coordinates(heading: list[str], path: Path) -> list[int]:
    """Columns of x, y, z, and of the cloud's number if there is one; empty where the heading does not name them.

    Raises `InputError` for another unit than metres.
    """
    names = [cell.lower() for cell in heading]
    axes = sorted((match[1], at, match[2]) for at, name in enumerate(names) if (match := _AXIS.fullmatch(name)))
    if [axis for axis, _, _ in axes] != ["x", "y", "z"]:
        return []
    if any(unit not in (None, "m") for _, _, unit in axes):
        raise InputError(
            f"{path}: the heading is {', '.join(heading)}; convert to metres, and write x, y, z above them"
        )
    return [*(at for _, at, _ in axes), *(at for at, name in enumerate(names) if name in _FRAMES)]


def _checked(points: Float64Array, path: Path) -> Float64Array:
    if len(points) < 2:
        raise InputError(f"{path} has {len(points)} usable point(s); at least 2 are needed")
    bad = ~np.all(np.isfinite(points), axis=1)
    if np.any(bad):
        raise InputError(
            f"{path}: {np.count_nonzero(bad)} of {len(points)} points are not finite, the first is number "
            f"{int(np.argmax(bad)) + 1}; remove them"
        )
    if float(np.max(np.abs(points))) > FARTHEST_M:
        raise InputError(
            f"{path}: a coordinate is larger than {FARTHEST_M:.0f} m; if these are millimetres, divide them by 1000"
        )
    if not np.any(np.ptp(points, axis=0)):
        raise InputError(f"{path}: all {len(points)} points are at the same place, {points[0]}; record it again")
    return points
