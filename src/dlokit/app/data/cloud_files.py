"""Recorded clouds: .pcd, .ply, .npy and .csv files as points in metres.

Only x, y and z of the element ``vertex`` are read. Memory use is bounded by the size of the file.
"""

from pathlib import Path

import numpy as np

from dlokit.app.data.pcd_file import read_pcd
from dlokit.errors import InputError
from dlokit.types.arrays import Float64Array

LARGEST_FILE_BYTES = 1 << 30
FORMATS = (".pcd", ".ply", ".npy", ".csv")


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

    Points with a coordinate that is not finite are omitted from .pcd and .ply files, where they usually mark an
    unknown depth; in .npy and .csv files they are an error. Raises `InputError`.
    """
    points = _read(path)
    if path.suffix.lower() in (".pcd", ".ply"):
        points = points[np.all(np.isfinite(points), axis=1)]
    return _checked(points, path)


def read_nodes(path: Path) -> Float64Array:
    """The nodes (M, 3) [m] of a .npy or .csv file, M >= 2. Raises `InputError`."""
    if path.suffix.lower() not in (".npy", ".csv"):
        raise InputError(f"{path}: nodes must be a .npy or .csv file, not {path.suffix or 'one without an extension'}")
    return _checked(_read(path), path)


def _read(path: Path) -> Float64Array:
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


def _read_npy(path: Path) -> Float64Array:
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise InputError(f"{path} is not an array: {error}; write it with numpy.save, shape (N, 3), metres") from error
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise InputError(f"{path} contains no numbers; write an array (N, 3) of metres with numpy.save")
    return array.astype(np.float64)


def _read_csv(path: Path) -> Float64Array:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (UnicodeDecodeError, OSError) as error:
        raise InputError(f"{path} is not text: {error}; a .csv has x, y, z in metres on each line") from error
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        cells = line.replace(";", ",").split(",")
        try:
            values = [float(cell) for cell in cells]
        except ValueError:
            if not line.strip() or line.lstrip().startswith("#") or not rows:
                continue  # blank, a comment, or the heading
            raise InputError(f"{path}, line {number}: {line.strip()[:60]!r} is not x, y, z in metres") from None
        if rows and len(values) != len(rows[0]):
            raise InputError(f"{path}, line {number} has {len(values)} columns, the first has {len(rows[0])}")
        rows.append(values)
    if not rows:
        raise InputError(f"{path} contains no numbers; a .csv has x, y, z in metres on each line")
    return np.array(rows, dtype=np.float64)


def _checked(points: Float64Array, path: Path) -> Float64Array:
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{path} has shape {points.shape}; it must be (N, 3): x, y, z in metres for each point")
    if len(points) < 2:
        raise InputError(f"{path} has {len(points)} usable point(s); at least 2 are needed")
    bad = ~np.all(np.isfinite(points), axis=1)
    if np.any(bad):
        raise InputError(
            f"{path}: {np.count_nonzero(bad)} of {len(points)} points are not finite, the first is number "
            f"{int(np.argmax(bad)) + 1}; remove them"
        )
    if float(np.max(np.abs(points))) > 100.0:
        raise InputError(f"{path}: a coordinate is larger than 100 m; if these are millimetres, divide them by 1000")
    return points
