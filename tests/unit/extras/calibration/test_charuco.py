import numpy as np
import pytest

from dlokit.description.board import CharucoBoard
from dlokit.errors import ConfigError
from dlokit.extras.calibration.charuco import find_board

BOARD = CharucoBoard()


def pictured(square_px: int, cut_columns: int = 0) -> np.ndarray:
    """The pattern from the front on grey paper, its right side cut off."""
    pattern = BOARD.picture(square_px)
    return np.pad(pattern[:, : pattern.shape[1] - cut_columns * square_px], 40, constant_values=128)


def test_all_corners_are_found_where_they_are():
    found = find_board(pictured(30), BOARD)
    assert found is not None
    assert sorted(found.numbers.tolist()) == list(range(24))
    expected = BOARD.corners_board[found.numbers, :2] / BOARD.square_m * 30 + 39.5
    np.testing.assert_allclose(found.pixels, expected, atol=0.1)


def test_colour_pictures_and_parts_of_the_board_do_too():
    grey = pictured(30, cut_columns=2)
    found = find_board(np.repeat(grey[:, :, None], 3, axis=2), BOARD)
    assert found is not None
    assert 8 <= len(found.numbers) < 24


def test_a_picture_without_the_board_or_with_little_of_it_gives_none():
    assert find_board(np.full((200, 200), 90, dtype=np.uint8), BOARD) is None
    assert find_board(pictured(30, cut_columns=5), BOARD) is None


@pytest.mark.parametrize("wrong", [{"columns": 2}, {"columns": 20, "rows": 20}, {"marker_m": 0.05}])
def test_a_board_that_cannot_be_is_refused(wrong: dict[str, float]):
    with pytest.raises(ConfigError):
        CharucoBoard(**wrong)  # pyright: ignore[reportArgumentType]
