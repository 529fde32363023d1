"""Array annotations; decoding a message checks the dtype.

A comment after each field gives the shape and the unit; the field's name gives the frame.

Not `NDArray`: since NumPy 2.5 that is an alias which hides the dtype from `get_args`, and so from the codec.
"""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dlokit.errors import BadValue

Float64Array: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.float64]]
"""For state: poses, nodes, joint values."""
Float32Array: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.float32]]
"""For sensor data: point clouds, depth."""
UInt8Array: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.uint8]]
"""For images."""
Int64Array: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.int64]]
"""For indices."""
BoolArray: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.bool_]]
"""For masks and flags."""
RowArray: TypeAlias = np.ndarray[tuple[Any, ...], np.dtype[np.void]]
"""For rows of named columns."""


def as_numbers(values: ArrayLike, name: str) -> Float64Array:
    """Convert a caller's values to an array of real numbers; masked values become NaN.

    Raises `BadValue`, which calls the array `name`.
    """
    try:
        array = np.asanyarray(values)
    except (TypeError, ValueError, RuntimeError) as error:  # ragged lists; arrays on another device
        raise BadValue(f"{name} is no array ({error}); give an array of real numbers") from error
    if array.dtype.kind not in "fiu":
        raise BadValue(f"{name} holds {array.dtype}; give an array of real numbers")
    if isinstance(array, np.ma.MaskedArray):
        array = np.ma.filled(array.astype(np.float64), np.nan)
    return np.asarray(array, dtype=np.float64)
