"""How far two messages of one type are apart, field by field."""

import math
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

CLOUD_FIELD = "points_world"
"""Points in no order: compared as a cloud, not one by one."""
PICTURE_FIELD = "depth_m"
"""A picture: pixels at edges may fall on the other side."""
QUANTILE = 0.95
"""Share of a cloud's points, or a picture's pixels, that a deviation speaks of."""


def deviations(recorded: Any, replayed: Any, field: str = "") -> Iterator[tuple[str, float]]:
    """Every field within two values, by its path, with how far it is apart.

    Numbers and arrays: the largest difference, in the field's unit; arrays of truth values: how many differ; clouds:
    the 95th percentile of the distances from a point to the nearest of the other cloud, both ways; depth: the 95th
    percentile of the differences; everything else: 0 when equal. Infinite where the two cannot be compared: another
    type, shape or length.
    """
    if isinstance(recorded, msgspec.Struct) and type(recorded) is type(replayed):
        for name in recorded.__struct_fields__:
            path = f"{field}.{name}" if field else name
            yield from deviations(getattr(recorded, name), getattr(replayed, name), path)
    elif isinstance(recorded, tuple | list) and isinstance(replayed, tuple | list):
        if len(recorded) != len(replayed):
            yield field, math.inf
            return
        for one, other in zip(recorded, replayed, strict=True):
            yield from deviations(one, other, f"{field}[]")
    else:
        yield field, _apart(recorded, replayed, field)


def _apart(recorded: Any, replayed: Any, field: str) -> float:
    if isinstance(recorded, np.ndarray) and isinstance(replayed, np.ndarray):
        if field.endswith(CLOUD_FIELD):
            return _clouds_apart(recorded, replayed)
        return _arrays_apart(recorded, replayed, QUANTILE if field.endswith(PICTURE_FIELD) else 1.0)
    if type(recorded) is type(replayed) and isinstance(recorded, int | float) and not isinstance(recorded, bool):
        return float(_difference(np.asarray(recorded, float), np.asarray(replayed, float)).max())
    return 0.0 if type(recorded) is type(replayed) and recorded == replayed else math.inf


def _arrays_apart(recorded: NDArray[Any], replayed: NDArray[Any], quantile: float) -> float:
    if recorded.shape != replayed.shape or recorded.dtype != replayed.dtype:
        return math.inf
    if recorded.size == 0:
        return 0.0
    if recorded.dtype.kind == "b":
        return float(np.count_nonzero(recorded != replayed))
    apart = _difference(recorded.astype(float), replayed.astype(float))
    return float(np.quantile(apart, quantile, method="lower"))


def _difference(recorded: NDArray[Any], replayed: NDArray[Any]) -> NDArray[Any]:
    """Of each element; what is not a number, or infinite the same way, on both sides is equal."""
    same = (recorded == replayed) | (np.isnan(recorded) & np.isnan(replayed))
    with np.errstate(invalid="ignore"):
        apart = np.abs(recorded - replayed)
    return np.where(same, 0.0, np.where(np.isnan(apart), math.inf, apart))


def _clouds_apart(recorded: NDArray[Any], replayed: NDArray[Any]) -> float:
    if len(recorded) == 0 or len(replayed) == 0:
        return 0.0 if len(recorded) == len(replayed) else math.inf
    both = (
        np.quantile(KDTree(mine).query(theirs)[0], QUANTILE)
        for mine, theirs in ((recorded, replayed), (replayed, recorded))
    )
    return float(max(both))
