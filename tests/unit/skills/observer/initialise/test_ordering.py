"""The order of pieces of line along one rod: straight on at crossings, small gaps, the rod's length."""

import numpy as np
import pytest

from dlokit.geometry import arc_lengths
from dlokit.skills.observer.initialise.ordering import Links, faces_itself, hermite, links, polyline, routes
from dlokit.types.arrays import Float64Array

LONGEST_GAP_M = 0.05


def line(start: tuple[float, float], end: tuple[float, float], count: int = 21) -> Float64Array:
    """Places (count, 3) [m] on a straight line on the table."""
    return np.column_stack([np.linspace(a, b, count) for a, b in zip(start, end, strict=True)] + [np.zeros(count)])


def linked(pieces: list[Float64Array], longest_gap_m: float = LONGEST_GAP_M) -> Links:
    return links(pieces, np.vstack(pieces), longest_gap_m)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
@pytest.mark.parametrize("turned", [(), (0,), (1, 2), (0, 1, 2)])
def test_pieces_of_a_straight_rod_are_joined_in_order_whichever_way_they_come(
    order: tuple[int, ...], turned: tuple[int, ...]
) -> None:
    rod = [line((0.0, 0.0), (0.1, 0.0)), line((0.11, 0.0), (0.2, 0.0)), line((0.215, 0.0), (0.3, 0.0))]
    pieces = [rod[k][::-1] if k in turned else rod[k] for k in order]
    joined = linked(pieces)
    best = routes(pieces, joined, 0.3, margin=0.0)[0]
    assert sorted(best.pieces) == [0, 1, 2]
    assert best.length_m == pytest.approx(0.3, abs=1e-3)
    x = polyline(best, pieces, joined)[:, 0]
    steps = np.diff(x if x[0] < x[-1] else x[::-1])
    assert np.all(steps > 0.0)


def test_a_rod_continues_straight_where_it_crosses_itself() -> None:
    west, east = line((-0.1, 0.0), (-0.01, 0.0)), line((0.01, 0.0), (0.1, 0.0))
    north = line((0.0, 0.01), (0.0, 0.1))
    cost = linked([west, east, north]).cost
    at_west, at_east, at_north = 1, 2, 4  # the ends at the crossing
    assert cost[at_west, at_east] < cost[at_west, at_north]
    assert cost[at_west, at_east] == pytest.approx(cost[at_east, at_west])
    best = routes([west, east, north], linked([west, east, north]), 0.2, margin=0.0)[0]
    assert sorted(best.pieces) == [0, 1]  # the third is too much for the rod's length


def test_a_link_is_no_longer_than_the_longest_gap_and_does_not_turn_back() -> None:
    first, far, back = line((0.0, 0.0), (0.1, 0.0)), line((0.18, 0.0), (0.25, 0.0)), line((0.08, 0.01), (0.0, 0.01))
    assert np.isinf(linked([first, far]).cost[1, 2])
    assert np.isfinite(linked([first, far], longest_gap_m=0.09).cost[1, 2])
    assert np.isinf(linked([first, back]).cost[1, 2])


def test_a_link_that_the_cloud_supports_is_cheaper() -> None:
    pieces = [line((0.0, 0.0), (0.1, 0.0)), line((0.13, 0.0), (0.2, 0.0))]
    unseen = linked(pieces).cost[1, 2]
    seen = links(pieces, line((0.0, 0.0), (0.2, 0.0), 101), LONGEST_GAP_M).cost[1, 2]
    assert seen < 0.1 < unseen


def test_the_rods_length_decides_whether_a_piece_belongs_to_it() -> None:
    pieces = [line((0.0, 0.0), (0.2, 0.0)), line((0.215, 0.0), (0.245, 0.0), 7)]
    whole, short = (routes(pieces, linked(pieces), length_m, margin=0.0)[0] for length_m in (0.245, 0.2))
    assert whole.pieces in ((0, 1), (1, 0))
    assert short.pieces == (0,)


def test_ways_that_cost_little_more_are_found_as_well_the_cheapest_first() -> None:
    pieces = [line((0.0, 0.0), (0.2, 0.0)), line((0.215, 0.0), (0.245, 0.0), 7)]
    found = routes(pieces, linked(pieces), None, margin=1e6)
    assert [route.cost for route in found] == sorted(route.cost for route in found)
    assert {route.pieces for route in found} >= {(0,), (1,)}
    assert len(routes(pieces, linked(pieces), None, margin=0.0)) == 1


def test_links_leave_and_arrive_along_their_tangents() -> None:
    start, end = np.zeros((1, 3)), np.array([[0.02, 0.01, 0.0]])
    x, y = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    curve = hermite(start, x, end, y)[0]
    assert np.array_equal(curve[0], start[0])
    assert np.allclose(curve[-1], end[0])
    leaving, arriving = curve[1] - curve[0], curve[-1] - curve[-2]
    assert leaving[0] > 4.0 * abs(leaving[1])
    assert arriving[1] > 4.0 * abs(arriving[0])
    assert arc_lengths(curve)[-1] > np.linalg.norm(end)


@pytest.mark.parametrize(("turn_rad", "faces"), [(1.9 * np.pi, True), (np.pi, False)])
def test_only_a_line_whose_ends_point_at_each_other_from_near_is_a_ring(turn_rad: float, faces: bool) -> None:
    a = np.linspace(0.0, turn_rad, 100)
    assert faces_itself(0.07 * np.column_stack([np.cos(a), np.sin(a), 0.0 * a])) is faces
