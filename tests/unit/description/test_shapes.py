import numpy as np
import pytest

from dlokit import geometry
from dlokit.description import shapes
from dlokit.errors import ShapeError

ROPE_M = 0.5
# A polyline is shorter than its curve by (h κ)² / 24 of its length: 41 nodes, 60 mm bends: 0.2 %.
CHORD_LOSS = 0.002
SEEDS = range(30)


def _bend_radius_m(nodes: np.ndarray) -> float:
    """The smallest radius of a circle through three consecutive nodes."""
    a, b = np.diff(nodes[:-1, :2], axis=0), np.diff(nodes[1:, :2], axis=0)
    turn = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.sum(a * b, axis=1))
    return float(np.linalg.norm(a, axis=1).mean() / max(np.abs(turn).max(), 1e-12))


@pytest.mark.parametrize("name", ["I", "S"])
@pytest.mark.parametrize("length_m", [0.2, 0.5, 0.6])
def test_builtin_shapes_have_the_length_of_the_rope_and_lie_on_the_table(name: str, length_m: float) -> None:
    nodes = shapes.builtin_shape(name, length_m, 41, radius_m=0.003)

    assert nodes.shape == (41, 3)
    assert shapes.length(nodes) == pytest.approx(length_m, rel=CHORD_LOSS)
    assert np.all(nodes[:, 2] == 0.003)
    spans = (nodes[:, :2].max(axis=0) + nodes[:, :2].min(axis=0)) / 2
    np.testing.assert_allclose(spans, shapes.CENTRE_M, atol=1e-3)  # resampling moves the extremes by < 1 mm
    assert nodes[0, 1] < nodes[-1, 1]


def test_an_i_is_straight_along_y() -> None:
    nodes = shapes.builtin_shape("I", ROPE_M, 31)

    np.testing.assert_allclose(nodes[:, 0], shapes.CENTRE_M[0], atol=1e-12)
    np.testing.assert_allclose(np.diff(nodes[:, 1]), ROPE_M / 30, atol=1e-12)


def test_an_s_is_point_symmetric_with_arcs_of_its_radius() -> None:
    nodes = shapes.builtin_shape("S", ROPE_M, 101)

    middle = nodes[50]
    np.testing.assert_allclose(nodes[::-1] - middle, middle - nodes, atol=1e-6)  # 1e-6 m: rounding of the quadrature
    # Sampling a circle by 5 mm chords changes its radius by less than 0.1 %.
    assert _bend_radius_m(nodes) == pytest.approx(shapes.S_RADIUS_M, rel=1e-3)
    assert nodes[:50, 0].max() > shapes.CENTRE_M[0] + 0.05  # the half at -y bulges away from the robot
    assert nodes[51:, 0].min() < shapes.CENTRE_M[0] - 0.05


def test_a_long_rope_gets_a_wider_s_instead_of_a_spiral() -> None:
    nodes = shapes.builtin_shape("S", 0.9, 201)

    assert _bend_radius_m(nodes) > 0.12
    assert shapes.self_clearance_m(nodes) > shapes.SELF_CLEARANCE_M


def test_an_unknown_shape_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ShapeError, match=r"'Z'.*I, L, U, S, W, spiral"):
        shapes.builtin_shape("Z", ROPE_M, 31)


@pytest.mark.parametrize("seed", SEEDS)
def test_random_shapes_stay_in_their_region_bend_gently_and_do_not_touch_themselves(seed: int) -> None:
    nodes = shapes.random_shape(np.random.default_rng(seed), ROPE_M, 81)

    assert shapes.length(nodes) == pytest.approx(ROPE_M, rel=CHORD_LOSS)
    assert nodes[:, 0].min() >= shapes.RANDOM_X_M[0]
    assert nodes[:, 0].max() <= shapes.RANDOM_X_M[1]
    assert nodes[:, 1].min() >= shapes.RANDOM_Y_M[0]
    assert nodes[:, 1].max() <= shapes.RANDOM_Y_M[1]
    assert shapes.self_clearance_m(nodes) >= shapes.SELF_CLEARANCE_M
    assert _bend_radius_m(nodes) >= shapes.MIN_BEND_RADIUS_M * 0.999  # chords


def test_random_shapes_are_drawn_from_the_seed_alone() -> None:
    first, again, other = (shapes.random_shape(np.random.default_rng(seed), ROPE_M, 31) for seed in (7, 7, 8))

    np.testing.assert_array_equal(first, again)
    assert geometry.rmse_m(first, other) > 0.01


def test_random_shapes_are_not_all_alike() -> None:
    drawn = np.stack([shapes.random_shape(np.random.default_rng(seed), ROPE_M, 31) for seed in SEEDS])

    tips = np.linalg.norm(drawn[:, -1] - drawn[:, 0], axis=1)
    assert tips.min() < 0.7 * ROPE_M  # some well bent
    assert tips.max() > 0.95 * ROPE_M  # some nearly straight
    assert np.all(drawn.mean(axis=1)[:, :2].std(axis=0) > 0.02)  # spread over the table


def test_a_rope_too_long_for_the_table_is_refused() -> None:
    with pytest.raises(ShapeError, match="shorter rope"):
        shapes.random_shape(np.random.default_rng(0), 2.5, 31)


def test_moving_turns_about_the_middle_then_shifts() -> None:
    nodes = shapes.builtin_shape("I", ROPE_M, 31)

    turned = shapes.moved(nodes, (0.1, -0.05), np.pi / 2)

    np.testing.assert_allclose(turned.mean(axis=0), nodes.mean(axis=0) + np.array([0.1, -0.05, 0.0]), atol=1e-12)
    # Counter-clockwise seen from above: the end at +y comes to lie at -x.
    np.testing.assert_allclose(turned[-1] - turned[0], [-ROPE_M, 0.0, 0.0], atol=1e-12)


def test_fitting_the_length_keeps_the_shape_and_its_place() -> None:
    nodes = shapes.builtin_shape("S", ROPE_M, 31)

    fitted = shapes.fit_length(nodes, 0.4)

    assert shapes.length(fitted) == pytest.approx(0.4)
    np.testing.assert_allclose(fitted.mean(axis=0), nodes.mean(axis=0), atol=1e-12)
    assert np.all(fitted[:, 2] == pytest.approx(0.004))


def test_clearance_sees_a_loop_and_ignores_neighbours() -> None:
    angle = np.linspace(0.0, 2 * np.pi * 0.95, 100)
    loop = 0.1 * np.column_stack([np.cos(angle), np.sin(angle)])

    # The gap of 5 % of the circle: 2 r sin(0.05 π).
    assert shapes.self_clearance_m(loop) == pytest.approx(0.2 * np.sin(0.05 * np.pi), rel=1e-6)
    assert shapes.self_clearance_m(loop[:5]) == np.inf
