import numpy as np
import pytest

from dlokit.skills.perception.calibration.hand_sight import difference, find_edges


def pictures(edge_px: float) -> tuple[np.ndarray, np.ndarray]:
    """A textured table, and the same with a bright object up to a column, which covers the last pixel partly."""
    rng = np.random.default_rng(3)
    empty = rng.integers(30, 90, (60, 80, 3)).astype(np.uint8)
    covered = np.clip(edge_px - np.arange(80) + 0.5, 0.0, 1.0)[None, :, None]
    return np.round(covered * 210 + (1 - covered) * empty).astype(np.uint8), empty


def edges_at(picture: np.ndarray, empty: np.ndarray, column: float):
    rows = np.arange(15.0, 45.0)
    pixels = np.column_stack([np.full(len(rows), column), rows])
    return find_edges(difference(picture, empty), pixels, np.tile([1.0, 0.0], (len(rows), 1)), 12.0)


@pytest.mark.parametrize("off_px", [-6.3, -0.25, 0.0, 2.6, 7.0])
def test_an_edge_is_found_to_a_fraction_of_a_pixel(off_px: float):
    edges = edges_at(*pictures(40.0 + off_px), 40.0)
    assert edges.found.all()
    # The level is far below the middle of a blurred edge, so that all edges are found farther out by the same offset.
    assert abs(np.median(edges.offsets_px) - off_px - 0.8) < 0.2
    assert np.std(edges.offsets_px) < 0.2


def test_no_edge_is_found_without_a_change_or_with_a_change_everywhere():
    picture, empty = pictures(40.0)
    assert not edges_at(empty, empty, 40.0).found.any()
    assert not edges_at(picture, empty, 20.0).found.any()  # all of it within
    assert not edges_at(picture, empty, 60.0).found.any()  # none of it


def test_a_shadow_near_the_edge_does_not_move_it():
    picture, empty = pictures(40.0)
    shadowed = picture.copy()
    shadowed[:, 42:] = (empty[:, 42:] * 0.7).astype(np.uint8)
    plain, dark = edges_at(picture, empty, 40.0), edges_at(shadowed, empty, 40.0)
    assert dark.found.all()
    assert np.abs(plain.offsets_px - dark.offsets_px).max() < 0.5
