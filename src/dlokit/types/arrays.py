"""Array annotations; decoding a message checks the dtype.

A comment after each field gives the shape and the unit; the field's name gives the frame.

Not `NDArray`: since NumPy 2.5 that is an alias which hides the dtype from `get_args`, and so from the codec.
"""

from typing import Any, TypeAlias

import numpy as np

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
