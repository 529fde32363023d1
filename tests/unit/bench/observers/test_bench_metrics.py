"""Metrics of the observers' bench on cases that can be reckoned by hand."""

import numpy as np
import pytest

from dlokit.bench.observers.metrics import Track, curve_error_m, frames_to_recover, score, to_polyline_m

FRAMES, NODES = 4, 11


def _straight() -> np.ndarray:
    return np.column_stack([np.linspace(0.0, 0.5, NODES), np.zeros(NODES), np.zeros(NODES)])


def _track(nodes: np.ndarray, visible: np.ndarray | None = None) -> Track:
    true = np.broadcast_to(_straight(), (FRAMES, NODES, 3)).copy()
    shown = np.ones((FRAMES, NODES), dtype=np.bool_) if visible is None else visible
    return Track(nodes_world=nodes, true_world=true, visible=shown, seconds=np.array([0.01, 0.02, 0.03, 0.04]))


def test_nodes_that_slide_along_the_curve_are_wrong_in_order_and_right_as_a_curve() -> None:
    slid = _straight() + np.array([0.03, 0.0, 0.0])
    figures = score(_track(np.broadcast_to(slid, (FRAMES, NODES, 3))))
    assert figures["node error"] == pytest.approx(0.03)
    # All nodes but those past the tip lie on the other line: 3 cm at one tip of each, of 11 nodes.
    assert figures["curve error"] == pytest.approx(0.03 / NODES)
    assert figures["tip error"] == pytest.approx(0.03)


def test_a_dlo_tracked_the_wrong_way_round_is_wrong_in_order() -> None:
    figures = score(_track(np.broadcast_to(_straight()[::-1], (FRAMES, NODES, 3))))
    assert figures["tip error"] == pytest.approx(0.5)
    assert figures["curve error"] == pytest.approx(0.0, abs=1e-12)


def test_errors_of_visible_and_hidden_nodes_are_told_apart() -> None:
    nodes = np.broadcast_to(_straight(), (FRAMES, NODES, 3)).copy()
    visible = np.ones((FRAMES, NODES), dtype=np.bool_)
    visible[:, 4:7] = False
    nodes[:, 4:7, 2] += 0.02
    figures = score(_track(nodes, visible))
    assert figures["node error, visible"] == pytest.approx(0.0)
    assert figures["node error, hidden"] == pytest.approx(0.02)


def test_without_hidden_nodes_there_is_no_figure_for_them() -> None:
    assert "node error, hidden" not in score(_track(np.broadcast_to(_straight(), (FRAMES, NODES, 3))))


def test_lost_frames_are_those_over_50_mm_in_the_mean() -> None:
    nodes = np.broadcast_to(_straight(), (FRAMES, NODES, 3)).copy()
    nodes[1, :, 1] += 0.051
    nodes[2, :, 1] += 0.049
    figures = score(_track(nodes))
    assert figures["frames over 50 mm"] == pytest.approx(0.25)
    assert figures["frames to recover"] == 1.0


def test_frames_to_recover_are_the_longest_row_and_dark_frames_do_not_count() -> None:
    lost = np.array([True, False, True, True, True, True, False])
    shown = np.array([True, True, False, False, True, True, True])
    assert frames_to_recover(lost, shown) == 2
    assert frames_to_recover(lost, np.ones(7, dtype=np.bool_)) == 4


def test_a_track_that_is_never_found_again_counts_to_the_end() -> None:
    lost = np.array([False, True, True, True])
    assert frames_to_recover(lost, np.ones(4, dtype=np.bool_)) == 3


def test_the_distance_to_a_polyline_is_to_its_edges_not_to_its_nodes() -> None:
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert to_polyline_m(np.array([[0.5, 0.2, 0.0], [1.3, 0.4, 0.0]]), line) == pytest.approx([0.2, 0.5])


def test_the_curve_error_is_the_same_both_ways() -> None:
    a, b = _straight(), _straight()[:6]
    assert curve_error_m(a, b) == pytest.approx(curve_error_m(b, a))
    assert curve_error_m(a, b) > 0.0, "a curve that covers half is wrong, though all of it lies on the other"


def test_between_few_nodes_the_curve_is_smooth_not_its_chords() -> None:
    def arc(count: int) -> np.ndarray:
        angle = np.linspace(0.0, 2.0, count)
        return 0.3 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)])

    # The chord of a quarter radian lies up to 0.3 (1 - cos(1/8)) = 2.3 mm inside the arc.
    assert curve_error_m(arc(9), arc(8)) < 0.0004


def test_an_estimate_whose_nodes_coincide_has_an_error_too() -> None:
    assert curve_error_m(np.zeros((9, 3)), _straight()) > 0.1


def test_times_are_percentiles_over_frames() -> None:
    assert score(_track(np.broadcast_to(_straight(), (FRAMES, NODES, 3))))["time p50"] == pytest.approx(0.025)
