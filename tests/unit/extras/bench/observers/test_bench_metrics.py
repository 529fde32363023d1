"""Metrics of the observer bench on cases with known results."""

from dataclasses import replace

import numpy as np
import pytest

from dlokit.extras.bench.observers.metrics import (
    CORRELATION,
    CORRELATION_FRAMES,
    Losses,
    Track,
    curve_error_m,
    longest_loss,
    losses,
    rank_correlation,
    score,
    to_polyline_m,
)

FRAMES, NODES = 4, 11


def _straight() -> np.ndarray:
    return np.column_stack([np.linspace(0.0, 0.5, NODES), np.zeros(NODES), np.zeros(NODES)])


def _track(nodes: np.ndarray, visible: np.ndarray | None = None, dark: list[int] | None = None) -> Track:
    true = np.broadcast_to(_straight(), nodes.shape).copy()
    return Track(
        nodes_world=nodes,
        true_world=true,
        visible=np.ones(nodes.shape[:2], dtype=np.bool_) if visible is None else visible,
        seconds=np.linspace(0.01, 0.04, len(nodes)),
        dark=np.isin(np.arange(len(nodes)), dark or []),
        failed=np.zeros(len(nodes), dtype=np.bool_),
    )


def _off_by(errors_m: list[float]) -> np.ndarray:
    """A track whose nodes all have these errors, frame by frame."""
    return _straight() + np.array(errors_m)[:, None, None] * [0.0, 1.0, 0.0]


def test_nodes_that_slide_along_the_curve_have_a_node_error_and_no_curve_error() -> None:
    slid = _straight() + np.array([0.03, 0.0, 0.0])
    figures = score(_track(np.broadcast_to(slid, (FRAMES, NODES, 3))))
    assert figures["node error"] == pytest.approx(0.03)
    # All nodes but those past the tip lie on the other line: 3 cm at one tip of each, of 11 nodes.
    assert figures["curve error"] == pytest.approx(0.03 / NODES)
    assert figures["tip error"] == pytest.approx(0.03)


def test_a_dlo_tracked_in_reverse_order_has_a_node_error() -> None:
    figures = score(_track(np.broadcast_to(_straight()[::-1], (FRAMES, NODES, 3))))
    assert figures["tip error"] == pytest.approx(0.5)
    assert figures["curve error"] == pytest.approx(0.0, abs=1e-12)


def test_errors_of_visible_and_hidden_nodes_are_separate() -> None:
    nodes = np.broadcast_to(_straight(), (FRAMES, NODES, 3)).copy()
    visible = np.ones((FRAMES, NODES), dtype=np.bool_)
    visible[:, 4:7] = False
    nodes[:, 4:7, 2] += 0.02
    figures = score(_track(nodes, visible))
    assert figures["node error, visible"] == pytest.approx(0.0)
    assert figures["node error, hidden"] == pytest.approx(0.02)


def test_without_hidden_nodes_their_error_is_absent() -> None:
    assert "node error, hidden" not in score(_track(np.broadcast_to(_straight(), (FRAMES, NODES, 3))))


def test_lost_frames_are_those_over_50_mm_in_the_mean() -> None:
    nodes = np.broadcast_to(_straight(), (FRAMES, NODES, 3)).copy()
    nodes[1, :, 1] += 0.051
    nodes[2, :, 1] += 0.049
    figures = score(_track(nodes))
    assert figures["frames over 50 mm"] == pytest.approx(0.25)
    assert figures["longest loss"] == 1.0


def test_the_longest_loss_is_the_longest_sequence_of_lost_frames_with_points() -> None:
    lost = np.array([True, False, True, True, True, True, False])
    shown = np.array([True, True, False, False, True, True, True])
    assert longest_loss(lost, shown) == 2
    assert longest_loss(lost, np.ones(7, dtype=np.bool_)) == 4


def test_a_track_that_is_never_found_again_counts_to_the_end() -> None:
    lost = np.array([False, True, True, True])
    assert longest_loss(lost, np.ones(4, dtype=np.bool_)) == 3


def test_frames_to_recover_count_from_the_light_s_return() -> None:
    errors = [0.004, 0.006, 0.005, 0.2, 0.3, 0.3, 0.2, 0.04, 0.009, 0.007, 0.02]
    figures = score(_track(_off_by(errors), dark=[3, 4]))
    assert figures["frames to recover"] == 2.0, "0.3 and 0.2 m, then it is below 50 mm"
    assert figures["frames to settle"] == 4.0, "1.5 times the median of 5 mm are 7.5 mm"


def test_a_track_that_never_recovers_counts_to_the_end() -> None:
    figures = score(_track(_off_by([0.004, 0.1, 0.1, 0.1, 0.1]), dark=[1]))
    assert (figures["frames to recover"], figures["frames to settle"]) == (3.0, 3.0)


def test_a_track_that_the_dark_did_not_disturb_recovers_at_once() -> None:
    figures = score(_track(_off_by([0.004, 0.004, 0.004, 0.004]), dark=[1, 2]))
    assert (figures["frames to recover"], figures["frames to settle"]) == (0.0, 0.0)


def test_a_case_without_a_dark_has_no_recovery() -> None:
    figures = score(_track(_off_by([0.2, 0.004])))
    assert "frames to recover" not in figures
    assert "frames to settle" not in figures


def test_stated_deviations_in_the_order_of_the_errors_have_correlation_one() -> None:
    track = _track(_off_by([0.001, 0.002, 0.004, 0.03]))
    figures = score(replace(track, stated_m=track.errors_m**2))
    assert figures[CORRELATION] == pytest.approx(1.0)
    assert figures[CORRELATION_FRAMES] == pytest.approx(1.0)
    figures = score(replace(track, stated_m=-track.errors_m))
    assert figures[CORRELATION] == pytest.approx(-1.0)


def test_a_method_without_stated_deviations_has_no_correlation() -> None:
    assert CORRELATION not in score(_track(_off_by([0.001, 0.002])))


def test_frames_without_a_covariance_are_left_out_of_the_correlation() -> None:
    track = _track(_off_by([0.001, 0.002, 0.004, 0.5]))
    stated = track.errors_m.copy()
    stated[3] = np.nan
    assert score(replace(track, stated_m=stated))[CORRELATION] == pytest.approx(1.0)


def test_constant_deviations_have_no_correlation() -> None:
    assert rank_correlation(np.ones(5), np.arange(5.0)) is None
    assert rank_correlation(np.arange(2.0), np.arange(2.0)) is None


def test_a_loss_is_flagged_when_health_falls_within_five_frames() -> None:
    lost = np.zeros(40, dtype=np.bool_)
    lost[[2, 3, 4]] = lost[[15, 16]] = lost[30] = True
    health = np.ones(40)
    health[7] = 0.1  # the fifth frame after the first loss
    health[21] = 0.1  # the sixth after the second
    health[30] = 0.1
    assert losses(lost, health, 0.75) == Losses(count=3, flagged=2)


def test_a_loss_at_the_very_end_is_not_assessed() -> None:
    lost = np.zeros(10, dtype=np.bool_)
    lost[5:] = True
    assert losses(lost, np.ones(10), 0.75) == Losses(count=0, flagged=0)


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
