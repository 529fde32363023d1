"""The annotations of arrays say their dtype in the same way on every version of Python and NumPy."""

from typing import get_args, get_origin

import numpy as np
import pytest

from dlokit.types import arrays


@pytest.mark.parametrize(
    ("annotation", "dtype"),
    [
        (arrays.Float64Array, np.float64),
        (arrays.Float32Array, np.float32),
        (arrays.UInt8Array, np.uint8),
        (arrays.Int64Array, np.int64),
        (arrays.BoolArray, np.bool_),
    ],
)
def test_the_codec_and_the_recording_find_the_dtype_of_an_array(annotation: object, dtype: type) -> None:
    assert get_origin(annotation) is np.ndarray
    assert get_args(get_args(annotation)[1]) == (dtype,)
