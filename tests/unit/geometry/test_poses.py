"""A matrix that a caller gives is a rotation with a position, or is refused by name."""

import numpy as np
import pytest

from dlokit.errors import BadValue
from dlokit.geometry import matrix, pose, rigid_pose

GOOD = matrix(pose([0.1, 0.2, 0.3], [0.9, 0.1, -0.3, 0.2]))


def test_a_rigid_transform_is_taken_also_with_three_decimals() -> None:
    np.testing.assert_allclose(matrix(rigid_pose(GOOD, "T")), GOOD, atol=1e-12)
    np.testing.assert_allclose(matrix(rigid_pose(np.round(GOOD, 3).tolist(), "T")), GOOD, atol=1e-3)


@pytest.mark.parametrize(
    ("values", "wrong"),
    [
        (GOOD[:3], r"\(3, 4\); needed is \(4, 4\)"),
        (GOOD * np.nan, "finite"),
        ("T.npy", "array"),
        (GOOD.T, "last row.*transpose"),
        (GOOD @ np.diag([1.0, -1.0, 1.0, 1.0]), "mirrors"),
        (GOOD @ np.diag([1.05, 1.05, 1.05, 1.0]), "lengths .1.05 1.05 1.05"),
        (np.diag([0.0, 0.0, 0.0, 1.0]), "scales"),
        (np.zeros((4, 4)), "last row"),
    ],
)
def test_another_matrix_is_refused_by_name_and_reason(values: object, wrong: str) -> None:
    with pytest.raises(BadValue, match=f"T_world_camera.*{wrong}"):
        rigid_pose(values, "T_world_camera")  # pyright: ignore[reportArgumentType]
