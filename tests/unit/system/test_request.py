"""Arguments of the library as parts of a configuration."""

from pathlib import Path

import numpy as np
import pytest

from dlokit.errors import InputError
from dlokit.system.job import named_or_saved


def test_points_that_are_no_numbers_are_refused_by_the_arguments_name(tmp_path: Path) -> None:
    for points in ([["0.1", "a"]], [[0.1, 0.2], [0.3]], np.ones((3, 2)) * 1j):
        with pytest.raises(InputError, match="goal"):
            named_or_saved(points, "goal", tmp_path)


def test_masked_points_are_saved_as_gaps_which_shapes_may_not_have(tmp_path: Path) -> None:
    masked = np.ma.masked_array([[0.1, 0.2], [9.0, 9.0]], mask=[[False, False], [True, True]])
    np.testing.assert_array_equal(np.load(named_or_saved(masked, "goal", tmp_path)), [[0.1, 0.2], [np.nan, np.nan]])
