"""The skeleton of a cloud: the middle of the rod, in pieces that end where it branches or bends sharply."""

from itertools import pairwise

import numpy as np
import pytest
import scipy

from dlokit.geometry import arc_lengths
from dlokit.skills.observer.initialise.skeleton import averaged, contracted, skeleton, spaced
from dlokit.types.arrays import Float64Array

RADIUS_M = 0.004


def cloud_of(*lines: list[tuple[float, float]], per_m: int = 8000) -> Float64Array:
    """Points (N, 3) [m] of rods along polylines on the table, noisy within their radius."""
    rng = np.random.default_rng(5)
    parts = list[Float64Array]()
    for corners in lines:
        for start, end in pairwise(corners):
            count = round(per_m * float(np.hypot(end[0] - start[0], end[1] - start[1])))
            at = np.linspace(start, end, count)
            parts.append(np.column_stack([at, np.zeros(count)]) + rng.uniform(-1.0, 1.0, (count, 3)) * RADIUS_M / 2.0)
    return np.vstack(parts)


def lengths(pieces: list[Float64Array]) -> list[float]:
    return sorted(float(arc_lengths(piece)[-1]) for piece in pieces)


def test_a_straight_rod_is_one_piece_on_its_middle_from_tip_to_tip() -> None:
    (piece,) = skeleton(cloud_of([(0.0, 0.0), (0.3, 0.0)]))
    assert np.abs(piece[:, 1:]).max() < 0.001
    assert np.all(np.diff(piece[:, 0]) > 0.0) or np.all(np.diff(piece[:, 0]) < 0.0)
    assert np.ptp(piece[:, 0]) == pytest.approx(0.3, abs=0.008)


def test_a_gap_in_the_cloud_separates_two_pieces() -> None:
    assert lengths(skeleton(cloud_of([(0.0, 0.0), (0.1, 0.0)], [(0.13, 0.0), (0.3, 0.0)]))) == pytest.approx(
        [0.1, 0.17], abs=0.01
    )


def test_a_crossing_cuts_both_rods_and_each_piece_is_straight() -> None:
    crossing = cloud_of([(-0.1, 0.0), (0.1, 0.0)], [(0.0, -0.1), (0.0, 0.1)])
    pieces = [piece for piece in skeleton(crossing) if lengths([piece])[0] > 0.02]  # a crumb in the middle may stay
    assert lengths(pieces) == pytest.approx([0.085] * 4, abs=0.02)
    for piece in pieces:
        assert np.abs(piece[:, :2]).min(axis=1).max() < 0.003  # on one of the two axes


def test_a_sharp_bend_splits_a_rod_and_a_soft_one_does_not() -> None:
    assert lengths(skeleton(cloud_of([(0.0, 0.0), (0.1, 0.0), (0.03, 0.07)]))) == pytest.approx([0.1, 0.1], abs=0.02)
    a = np.linspace(0.0, np.pi, 40)
    around = [(0.08 * float(np.cos(angle)), 0.08 * float(np.sin(angle))) for angle in a]
    assert len(skeleton(cloud_of(around))) == 1


def test_a_piece_is_split_where_the_end_of_another_points_at_it() -> None:
    pieces = skeleton(cloud_of([(0.0, 0.0), (0.2, 0.0)], [(0.1, 0.015), (0.1, 0.1)]))
    assert lengths(pieces) == pytest.approx([0.085, 0.1, 0.1], abs=0.015)


def test_a_side_branch_of_noise_is_pruned() -> None:
    assert len(skeleton(cloud_of([(0.0, 0.0), (0.2, 0.0)], [(0.1, 0.0), (0.1, 0.006)]))) == 1


def test_a_cloud_that_covers_an_area_has_no_skeleton() -> None:
    rng = np.random.default_rng(1)
    assert skeleton(np.column_stack([rng.uniform(0.0, 0.5, (40_000, 2)), np.zeros(40_000)])) == []


def test_a_lone_point_beside_the_line_is_dropped() -> None:
    line = cloud_of([(0.0, 0.0), (0.2, 0.0)])
    stray = np.array([[0.1, 0.1, 0.0]])
    assert np.linalg.norm(contracted(np.vstack([line, stray])) - stray, axis=1).min() > 0.05


def test_averages_keep_the_number_and_the_mean_of_the_points() -> None:
    points = np.random.default_rng(2).uniform(0.0, 0.05, (500, 3))
    means, counts = averaged(points, 0.01)
    assert counts.sum() == len(points)
    assert counts @ means / len(points) == pytest.approx(points.mean(axis=0))
    assert len(means) < len(points)


def test_spaced_points_are_no_nearer_to_one_another_and_all_others_near_to_one() -> None:
    points, spacing_m = np.random.default_rng(3).uniform(0.0, 0.05, (500, 3)), 0.01
    kept = spaced(points, spacing_m)
    assert scipy.spatial.distance.pdist(kept).min() > spacing_m
    assert scipy.spatial.KDTree(kept).query(points)[0].max() <= spacing_m
