"""Array annotations. Their dtype is checked when a message is decoded.

A comment behind each field gives the shape, the unit and, through its name, the frame.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64Array: TypeAlias = NDArray[np.float64]
"""State: poses, nodes, joint values."""
Float32Array: TypeAlias = NDArray[np.float32]
"""Bulk: clouds, depth."""
UInt8Array: TypeAlias = NDArray[np.uint8]
"""Pictures."""
Int64Array: TypeAlias = NDArray[np.int64]
"""Indices."""
BoolArray: TypeAlias = NDArray[np.bool_]
"""Masks and flags."""
