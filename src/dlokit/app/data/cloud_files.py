"""Recorded clouds: .pcd, .ply, .npy and .csv files as points in metres.

Only x, y and z are read. Memory use is bounded by the size of the file and by what its header plausibly declares.
trimesh reads .ply, NumPy .npy. Files of the Point Cloud Library (.pcd 0.7: ascii, binary, binary_compressed) are read
here, because neither trimesh nor OpenCV reads them, small packages need a compiler or a data frame library, and open3d
is 400 MB.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dlokit.description.point_files import read_npy, rows_of_csv
from dlokit.errors import InputError
from dlokit.functional.cameras.calibration_file import pose_from
from dlokit.geometry.poses import rigid_pose
from dlokit.types.arrays import Float64Array, as_numbers
from dlokit.types.pose import Pose

LARGEST_FILE_BYTES = 1 << 30
FORMATS = (".pcd", ".ply", ".npy", ".csv")
FARTHEST_M = 100.0
"""Coordinates of a cloud are at most this large [m]; larger ones are in another unit."""
LARGEST_HEADER_BYTES = 16_384
LARGEST_POINTS = 20_000_000
_PCD_KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")


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
    return _checked(points, str(path))


def read_clouds(path: Path) -> list[tuple[str, Float64Array]]:
    """The name and the points of each cloud in a file: one, or T of the same size in a .npy file (T, N, 3) [m].

    Raises `InputError`, as `read_cloud`, and where the stack has points without depth, as a picture has.
    """
    if path.suffix.lower() == ".npy" and (stack := _read(path)).ndim == 3 and len(stack) > 1:
        names = [f"{path}:{number}" for number in range(len(stack))]
        clouds = [as_points(points, name) for name, points in zip(names, stack, strict=True)]
        if not all((np.isfinite(points).all(axis=1) & points.any(axis=1)).all() for points in clouds):
            raise InputError(
                f"{path} has the shape {stack.shape}, and points that are not finite or at (0, 0, 0): of a picture "
                "(height, width, 3) give the other points as one cloud (N, 3); clouds with such points cannot be in a "
                "stack (T, N, 3): give each as a file"
            )
        return [(name, _checked(points, name)) for name, points in zip(names, clouds, strict=True)]
    return [(str(path), read_cloud(path))]


def read_camera_pose(path: Path) -> Pose:
    """The pose T_world_camera in a calibration (.toml) or a matrix (4, 4) (.npy, .csv, .txt). Raises `InputError`."""
    ending = path.suffix.lower()
    if ending == ".toml":
        return pose_from(str(path))
    if ending not in (".npy", ".csv", ".txt"):
        raise InputError(
            f"{path}: the pose of a camera must be the .toml file of its calibration, or a matrix (4, 4) in a .npy, "
            ".csv or .txt file"
        )
    if not path.is_file():
        raise InputError(f"{path} does not exist; give the file with the camera's pose in the world")
    matrix = read_npy(path) if ending == ".npy" else rows_of_csv(path.read_bytes(), str(path))
    T_world_camera = rigid_pose(matrix, f"T_world_camera in {path}")
    if np.max(np.abs(T_world_camera.position_m)) > FARTHEST_M:
        raise InputError(f"{path}: the camera is more than {FARTHEST_M:.0f} m away; divide millimetres by 1000")
    return T_world_camera


def read_nodes(path: Path) -> Float64Array:
    """The nodes (M, 3) [m] of a .npy or .csv file, M >= 2; of the nodes of several clouds, those of the last cloud.

    Raises `InputError`.
    """
    if path.suffix.lower() not in (".npy", ".csv"):
        raise InputError(f"{path}: nodes must be a .npy or .csv file, not {path.suffix or 'one without an extension'}")
    nodes = _read(path)
    return _checked(as_points(nodes[-1] if nodes.ndim == 3 and len(nodes) else nodes, str(path)), str(path))


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
    return read_npy(path) if ending == ".npy" else rows_of_csv(path.read_bytes(), str(path))


def _checked(points: Float64Array, name: str) -> Float64Array:
    if len(points) < 2:
        raise InputError(f"{name} has {len(points)} usable point(s); at least 2 are needed")
    bad = ~np.all(np.isfinite(points), axis=1)
    if np.any(bad):
        raise InputError(
            f"{name}: {np.count_nonzero(bad)} of {len(points)} points are not finite, the first is number "
            f"{int(np.argmax(bad)) + 1}; remove them"
        )
    if float(np.max(np.abs(points))) > FARTHEST_M:
        raise InputError(
            f"{name}: a coordinate is larger than {FARTHEST_M:.0f} m; if these are millimetres, divide them by 1000"
        )
    if not np.any(np.ptp(points, axis=0)):
        raise InputError(f"{name}: all {len(points)} points are at the same place, {points[0]}; record it again")
    return points


@dataclass(frozen=True, kw_only=True)
class _Header:
    names: tuple[str, ...]
    """Column names of a point, one per count of a field; x, y, z are among them."""
    dtype: np.dtype[np.void]
    """One point in the binary format."""
    points: int
    data: str
    body: bytes


def read_pcd(path: Path) -> Float64Array:
    """The points (N, 3) of a .pcd file, including those of unknown depth (NaN). Raises `InputError`."""
    header = _read_header(path)
    if header.data == "ascii":
        return _ascii(header, path)
    records = _records(header.body, header, path) if header.data == "binary" else _compressed(header, path)
    return np.column_stack([records[axis].astype(np.float64) for axis in "xyz"])


def _read_header(path: Path) -> _Header:
    content = path.read_bytes()
    entries: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in entries:
        end = content.find(b"\n", at, LARGEST_HEADER_BYTES)
        if end < 0:
            raise InputError(f"{path} is not a .pcd file: its header has no DATA line; record or convert it again")
        words = content[at:end].decode("ascii", errors="replace").split()
        at = end + 1
        if words and not words[0].startswith("#") and words[0] in _PCD_KEYS:
            entries[words[0]] = words[1:]
    try:
        fields, kinds = entries["FIELDS"], entries["TYPE"]
        sizes = [int(size) for size in entries["SIZE"]]
        counts = [int(count) for count in entries.get("COUNT", ["1"] * len(fields))]
        width, height = int(entries["WIDTH"][0]), int(entries.get("HEIGHT", ["1"])[0])
        points = int(entries["POINTS"][0]) if "POINTS" in entries else width * height
        data = entries["DATA"][0]
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(f"{path} is not a .pcd file: its header has no valid {error}; convert it again") from error
    if not {"x", "y", "z"} <= set(fields) or not len(fields) == len(kinds) == len(sizes) == len(counts):
        raise InputError(f"{path}: its fields are {' '.join(fields)}; x, y and z are needed, each with SIZE and TYPE")
    if not 0 <= points <= LARGEST_POINTS:
        raise InputError(f"{path} declares {points} points; the limit is {LARGEST_POINTS}")
    if points != width * height:
        raise InputError(f"{path} declares POINTS {points}, but WIDTH x HEIGHT is {width * height}; convert it again")
    if data not in ("ascii", "binary", "binary_compressed"):
        raise InputError(f"{path}: DATA {data} is unknown; it must be ascii, binary or binary_compressed")
    names, formats = _layout(fields, kinds, sizes, counts, path)
    dtype = np.dtype({"names": list(names), "formats": formats})
    return _Header(names=names, dtype=dtype, points=points, data=data, body=content[at:])


def _layout(
    fields: list[str], kinds: list[str], sizes: list[int], counts: list[int], path: Path
) -> tuple[tuple[str, ...], list[str]]:
    """Names and NumPy formats of the columns of a point."""
    names: list[str] = []
    formats: list[str] = []
    for index, (field, kind, size, count) in enumerate(zip(fields, kinds, sizes, counts, strict=True)):
        if kind not in "FIU" or size not in (1, 2, 4, 8) or (kind == "F" and size < 4) or not 1 <= count <= 4096:
            raise InputError(f"{path}: field {field} of TYPE {kind}, SIZE {size}, COUNT {count} is unknown")
        for part in range(count):
            coordinate = field in ("x", "y", "z") and part == 0 and field not in names
            names.append(field if coordinate else f"{field}.{index}.{part}")  # padding fields share a name
            formats.append(f"<{kind.lower()}{size}")
    return tuple(names), formats


def _ascii(header: _Header, path: Path) -> Float64Array:
    # `numpy.loadtxt` takes half of the 1.6 µs a point, but its errors count rows from 0 in one case, from 1 in another.
    columns = [header.names.index(axis) for axis in "xyz"]
    rows: list[list[float]] = []
    for line in header.body.decode("ascii", errors="replace").splitlines():
        words = line.split()
        if not words:
            continue
        try:
            rows.append([float(words[column]) for column in columns])
        except (ValueError, IndexError):
            raise InputError(f"{path}: point {len(rows) + 1} is {line[:60]!r}, not a number for each field") from None
    if len(rows) != header.points:
        raise InputError(
            f"{path} declares {header.points} points and has {len(rows)}; it is truncated or damaged, record it again"
        )
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _records(data: bytes, header: _Header, path: Path) -> NDArray[np.void]:
    wanted = header.points * header.dtype.itemsize
    if len(data) < wanted:
        raise InputError(f"{path} needs {wanted} bytes of points and has {len(data)}; it is truncated, record it again")
    return np.frombuffer(data, dtype=header.dtype, count=header.points)


def _compressed(header: _Header, path: Path) -> NDArray[np.void]:
    """binary_compressed: two sizes, then the values of the first field, of the second, and so on, in LZF."""
    if len(header.body) < 8:
        raise InputError(f"{path} ends after its header; record it again")
    packed, full = (int(size) for size in np.frombuffer(header.body, dtype="<u4", count=2))
    wanted = header.points * header.dtype.itemsize
    if full != wanted or packed > len(header.body) - 8:
        raise InputError(
            f"{path}: {packed} packed bytes for {full} unpacked ones do not match its {header.points} points; "
            f"it is truncated or corrupt, record it again"
        )
    data = _lzf(header.body[8 : 8 + packed], full, path)
    records = np.empty(header.points, dtype=header.dtype)
    at = 0
    for name in header.names:
        column = np.frombuffer(data, dtype=header.dtype[name], count=header.points, offset=at)
        records[name] = column
        at += column.nbytes
    return records


def _lzf(packed: bytes, size: int, path: Path) -> bytes:
    """Decompress LZF to exactly `size` bytes: literal runs, and references to previous output."""
    out = bytearray()
    at = 0
    try:
        while at < len(packed) and len(out) <= size:
            control = packed[at]
            at += 1
            if control < 32:
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            start = len(out) - ((control & 31) << 8) - packed[at] - 1
            at += 1
            if start < 0:
                raise IndexError
            for index in range(start, start + length + 2):  # may read the bytes just written
                out.append(out[index])
    except IndexError:
        raise InputError(f"{path}: its compressed points are corrupt; record it again") from None
    if len(out) != size:
        raise InputError(f"{path} unpacks to {len(out)} bytes instead of {size}; it is corrupt, record it again")
    return bytes(out)
