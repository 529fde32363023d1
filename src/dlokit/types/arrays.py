"""Array annotations; decoding a message checks the dtype.

A comment after each field gives the shape and the unit; the field's name gives the frame.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Float64Array: TypeAlias = NDArray[np.float64]
"""For state: poses, nodes, joint values."""
Float32Array: TypeAlias = NDArray[np.float32]
"""For sensor data: point clouds, depth."""
UInt8Array: TypeAlias = NDArray[np.uint8]
"""For images."""
Int64Array: TypeAlias = NDArray[np.int64]
"""For indices."""
BoolArray: TypeAlias = NDArray[np.bool_]
"""For masks and flags."""
