"""On which side of posts a path lies: hand-made paths, and properties of the winding."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dlokit import geometry
from dlokit.description.passing import CLOSELY_RAD, parse_wish, passing, wrong_sides
from dlokit.description.scene import Box, Fixture, Post
from dlokit.errors import ConfigError
from dlokit.types.arrays import BoolArray, Float64Array
from dlokit.types.passing import AsWished, Passing, PostPassing, SideWish

A = Post(name="A", position_m=(0.5, 0.0, 0.0))
B = Post(name="B", position_m=(0.5, 0.12, 0.0))
ONE = (A,)
TWO = (A, B)
HEIGHT_M = 0.004


def path(x_m: object, y_m: object) -> Float64Array:
    """Points (N, 3) [m] on the table."""
    x, y = np.broadcast_arrays(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
    return np.column_stack((x, y, np.full(len(x), HEIGHT_M)))


def straight(away_m: float, end_m: float = 0.25) -> Float64Array:
    """Along +y, by `away_m` to the left of A (negative: to its right): A on its right, which it passes clockwise."""
    return path(0.5 - away_m, np.linspace(-0.25, end_m, 41))


def wound(turns: float, radius_m: float = 0.012, clockwise: bool = True) -> Float64Array:
    """Around A by `turns`, with straight ends that touch the circle."""
    count = max(int(48 * turns), 2)
    angles = np.linspace(0.0, 2.0 * np.pi * turns, count)
    circle = np.column_stack((-np.cos(angles), np.sin(angles))) * radius_m
    last = np.array([np.sin(angles[-1]), np.cos(angles[-1])])
    ends = (
        circle[0] - np.outer(np.linspace(0.1, 0.01, 10), (0.0, 1.0)),
        circle[-1] + np.outer(np.linspace(0.01, 0.1, 10), last),
    )
    points = np.vstack((ends[0], circle, ends[1]))
    return path(0.5 + (1.0 if clockwise else -1.0) * points[:, 0], points[:, 1])


def ask(
    points: Float64Array,
    wish: str,
    fixtures: Sequence[Fixture] = ONE,
    seen: BoolArray | None = None,
    ends: bool = False,
) -> Passing:
    wished = parse_wish(wish, fixtures)
    return passing(points, fixtures, wished, visible=seen, ends_interchangeable=ends)


def answers(found: Passing) -> list[AsWished]:
    return [one.answer for one in found.answers]


def post(found: Passing, number: int = 0) -> PostPassing:
    record = found.fixtures[number]
    assert isinstance(record, PostPassing)
    return record


@pytest.mark.parametrize("away_m", [0.009, 0.02, 0.045, 0.15])
def test_a_straight_path_passes_a_post_on_its_right_clockwise_at_any_distance(away_m: float):
    for sign, side in ((1.0, 1), (-1.0, -1)):
        record = post(passing(straight(sign * away_m), ONE))
        assert record.side == side
        assert record.distance_m == pytest.approx(away_m)
        assert record.along_m == pytest.approx(0.25)
        wanted = 2.0 * math.acos(away_m / 0.05) if away_m < 0.05 else 0.0
        assert record.winding_rad == pytest.approx(sign * wanted)
    assert answers(ask(straight(away_m), "+A")) == [AsWished.YES]
    assert answers(ask(straight(away_m), "-A")) == [AsWished.NO]
    assert answers(ask(straight(-away_m), "-A")) == [AsWished.YES]


def test_closely_is_within_13_mm_on_either_side():
    for away_m, answer in ((0.009, AsWished.YES), (-0.009, AsWished.YES), (0.02, AsWished.NO), (-0.02, AsWished.NO)):
        assert answers(ask(straight(away_m), "A")) == [answer]
    assert post(passing(straight(0.0134), ONE)).winding_rad == pytest.approx(CLOSELY_RAD, abs=0.01)


@pytest.mark.parametrize("turns", [0.5, 0.75, 1.0, 1.75, 3.0])
def test_a_wrapped_post_counts_every_turn(turns: float):
    bare = post(passing(wound(turns), ONE)).winding_rad
    ends_rad = 2.0 * math.acos(0.012 / 0.05)  # of the straight ends, from the circle to 50 mm
    assert bare == pytest.approx(2.0 * math.pi * turns + ends_rad, abs=0.02)
    assert post(passing(wound(turns, clockwise=False), ONE)).winding_rad == pytest.approx(-bare)
    assert answers(ask(wound(turns), "+A")) == [AsWished.YES]


def test_a_hairpin_beside_a_post_does_not_pass_it():
    y = np.linspace(-0.25, 0.2, 40)
    hairpin = np.vstack((path(0.49, y), path(0.475, y[::-1])))
    assert post(passing(hairpin, ONE)).side == 0
    (answer,) = ask(hairpin, "+A").answers
    assert (answer.answer, answer.why) == (AsWished.NO, "does not pass A")


def test_a_return_far_away_does_not_undo_a_side():
    y = np.linspace(-0.25, 0.2, 40)
    assert answers(ask(np.vstack((path(0.49, y), path(0.3, y[::-1]))), "+A")) == [AsWished.YES]


def test_a_path_that_ends_before_the_post_does_not_pass_it():
    assert answers(ask(straight(0.009, end_m=-0.03), "+A")) == [AsWished.NO]
    assert answers(ask(straight(0.009, end_m=0.03), "+A")) == [AsWished.YES]
    assert answers(ask(straight(0.009, end_m=0.0), "+A")) == [AsWished.NOT_SEEN]


def test_a_path_too_near_the_axis_for_its_uncertainty_is_not_seen():
    assert answers(ask(straight(0.002), "+A")) == [AsWished.NOT_SEEN]
    assert answers(ask(straight(0.002), "-A")) == [AsWished.NOT_SEEN]
    truth = passing(straight(0.002), ONE, parse_wish("+A", (A,)), unsure_m=0.0)
    assert answers(truth) == [AsWished.YES]


def test_a_path_over_the_head_is_not_beside_the_post():
    lifted = straight(0.004) + np.array([0.0, 0.0, 0.025])
    (answer,) = passing(lifted, ONE, parse_wish("+A", (A,)), unsure_m=0.0).answers
    assert (answer.answer, answer.why) == (AsWished.NO, "lies over A")
    assert post(passing(lifted, ONE)).over
    beside = straight(0.009) + np.array([0.0, 0.0, 0.025])  # held high beside it
    assert not post(passing(beside, ONE)).over


def test_the_axis_of_a_leaning_post_decides():
    leaning = (Post(name="A", position_m=(0.5, 0.0, 0.0), rpy_deg=(0.0, 15.0, 0.0), height_m=0.1),)
    # The axis leans towards +x: at the height of 60 mm it is 16 mm from the foot.
    high = straight(-0.006) + np.array([0.0, 0.0, 0.056])
    assert answers(ask(high, "+A", leaning)) == [AsWished.YES]
    assert answers(ask(straight(-0.006), "+A", leaning)) == [AsWished.NO]
    assert post(passing(high, leaning)).distance_m == pytest.approx(
        math.cos(math.radians(15.0)) * (0.06 * math.tan(math.radians(15.0)) - 0.006), abs=1e-6
    )


def test_hidden_parts_that_could_lie_on_the_other_side_are_not_seen():
    points = straight(0.009)
    for hidden, answer in ((1, AsWished.YES), (2, AsWished.YES), (12, AsWished.NOT_SEEN)):
        visible = np.ones(41, np.bool_)
        visible[20 - hidden // 2 : 20 - hidden // 2 + hidden] = False
        assert answers(ask(points, "+A", seen=visible)) == [answer], hidden
        assert answers(ask(points, "-A", seen=visible)) == [AsWished.NO if answer is AsWished.YES else answer]


def test_hidden_parts_far_from_the_post_do_not_matter():
    assert answers(ask(straight(0.009), "+A", seen=np.arange(41) > 7)) == [AsWished.YES]
    # The end is hidden over 113 mm and begins 138 mm from the axis: bent towards the post it comes within 25 mm.
    assert answers(ask(straight(0.009), "+A", seen=np.arange(41) > 8)) == [AsWished.NOT_SEEN]
    assert answers(ask(straight(0.009), "+A", seen=np.arange(41) > 18)) == [AsWished.NOT_SEEN]
    assert answers(ask(straight(0.009), "+A", seen=np.zeros(41, np.bool_))) == [AsWished.NOT_SEEN]


def test_points_that_may_be_across_the_axis_count_as_hidden():
    wish = parse_wish("+A", (A,))
    across, along = np.diag([0.02**2, 0.001**2, 0.001**2]), np.diag([0.001**2, 0.02**2, 0.001**2])
    for one, answer in ((across, AsWished.NOT_SEEN), (along, AsWished.YES)):
        covariance = np.tile(np.diag([0.001**2] * 3), (41, 1, 1))
        covariance[14:27] = one
        assert answers(passing(straight(0.015), ONE, wish, covariance=covariance)) == [answer]


def test_the_order_along_the_path_belongs_to_the_wish():
    points = straight(0.009)
    assert answers(ask(points, "+A +B", TWO)) == [AsWished.YES, AsWished.YES]
    late = ask(points, "+B +A", TWO)
    assert answers(late) == [AsWished.YES, AsWished.NO]
    assert late.answers[1].why == "passes A before B"


def test_posts_abreast_of_each_other_may_be_named_in_either_order():
    gate = (A, Post(name="B", position_m=(0.48, 0.005, 0.0)))
    for wish in ("+A -B", "-B +A"):
        assert answers(ask(straight(0.01), wish, gate)) == [AsWished.YES, AsWished.YES]


def test_with_interchangeable_ends_the_wish_may_be_met_from_either_end():
    points = straight(0.009)
    for ends, answer in ((True, AsWished.YES), (False, AsWished.NO)):
        assert answers(ask(points[::-1], "+A +B", TWO, ends=ends)) == [answer, answer]
    assert answers(ask(points, "-B -A", TWO, ends=True)) == [AsWished.YES, AsWished.YES]
    assert ask(points[::-1], "-A -B", TWO, ends=True).answers[0].why == "passes A clockwise"


def test_posts_that_are_passed_and_not_named_are_listed():
    assert ask(straight(0.009), "+A", TWO).unnamed == ("B",)
    assert ask(straight(0.06), "+A", TWO).unnamed == ()
    assert passing(straight(0.009), TWO).unnamed == ()


def test_slack_compares_the_path_with_straight_lines_around_the_named_posts():
    taut = ask(straight(0.005), "+A +B", TWO)
    assert taut.slack == pytest.approx(1.0)
    y = np.linspace(-0.25, 0.37, 200)
    bulge = path(0.491 - 0.04 * np.sin(np.pi * np.clip(y / 0.12, 0.0, 1.0)) ** 2, y)
    slack = ask(bulge, "+A +B", TWO).slack
    assert slack is not None
    assert 1.1 < slack < 1.4
    assert ask(bulge, "+A", TWO).slack is None


def test_a_box_has_its_distance():
    boxes = (Box(name="K", position_m=(0.6, 0.0, 0.0), size_m=(0.06, 0.04, 0.05)),)
    (beside,) = passing(straight(0.0), boxes).fixtures
    assert beside.distance_m == pytest.approx(0.07)
    assert beside.along_m == pytest.approx(0.25, abs=0.021)
    (over,) = passing(straight(-0.1), boxes).fixtures
    assert over.distance_m == 0.0


@pytest.mark.parametrize("text", ["+", "A,B", "*A", "+-A", "A- B", "a.b"])
def test_what_is_no_wish_is_refused_with_an_example(text: str):
    with pytest.raises(ConfigError, match=r'as in "-A \+B C"'):
        parse_wish(text, (A, B))


def test_unknown_doubled_and_box_names_are_refused():
    box = Box(name="K", position_m=(0.3, 0.3, 0.0))
    with pytest.raises(ConfigError, match="names K, X, which is no post; the posts are A, B"):
        parse_wish("-A +X K", (A, B, box))
    with pytest.raises(ConfigError, match="names A twice"):
        parse_wish("-A +B +A", (A, B))
    with pytest.raises(ConfigError, match="the scene has none: describe them with --fixtures"):
        parse_wish("A", ())


def test_a_wish_is_read_in_its_order():
    assert parse_wish(" -A  +B", (B, A)) == (SideWish(name="A", turn=-1), SideWish(name="B", turn=1))
    assert parse_wish("", ()) == ()


def test_many_paths_are_counted_as_each_alone():
    rng = np.random.default_rng(7)
    paths = np.array([straight(away_m) for away_m in rng.uniform(-0.06, 0.06, 40)])
    paths[:, :, :2] += np.cumsum(rng.normal(0.0, 0.003, (40, 41, 2)), axis=1)
    wish = parse_wish("-A +B", TWO)
    for ends in (False, True):
        each = [
            sum(answer is not AsWished.YES for answer in answers(found))
            for found in (passing(one, TWO, wish, ends_interchangeable=ends, unsure_m=0.0) for one in paths)
        ]
        assert wrong_sides(paths, TWO, wish, ends_interchangeable=ends).tolist() == each
        assert len(set(each)) > 1
    assert wrong_sides(np.full((1, 41, 3), np.nan), TWO, wish).tolist() == [2]
    assert wrong_sides(paths, TWO, ()).tolist() == [0] * 40


def curve(seed: int) -> Float64Array:
    """A smooth random path of 60 points past the posts."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.normal(0.0, 0.25, 60)) + rng.uniform(0.0, 6.28)
    steps = 0.01 * np.column_stack((np.cos(heading), np.sin(heading)))
    points = np.cumsum(steps, axis=0)
    points += np.array(A.position_m[:2]) - points[30] + rng.normal(0.0, 0.03, 2)
    return path(points[:, 0], points[:, 1])


def windings(points: Float64Array, posts: Sequence[Post] = TWO) -> list[float]:
    found = passing(points, posts)
    return [post(found, number).winding_rad for number in range(len(posts))]


@given(seed=st.integers(0, 10_000), turns=st.integers(-3, 3))
def test_a_closed_loop_within_the_circle_winds_by_whole_turns(seed: int, turns: int):
    rng = np.random.default_rng(seed)
    angles = np.linspace(0.0, 2.0 * np.pi * turns, 200)
    radius = 0.025 + 0.01 * np.sin(
        angles * rng.integers(1, 4) / max(abs(turns), 1) * abs(turns) + rng.uniform(0.0, 6.28)
    )
    radius[-1] = radius[0]
    loop = path(0.5 + radius * np.cos(angles), radius * np.sin(angles))
    assert windings(loop, ONE)[0] == pytest.approx(-2.0 * np.pi * turns, abs=1e-9)


@given(seed=st.integers(0, 10_000), yaw_deg=st.floats(-180.0, 180.0), x_m=st.floats(-0.05, 0.05))
def test_moving_path_and_posts_together_changes_nothing(seed: int, yaw_deg: float, x_m: float):
    about = geometry.pose_from_angles((0.5, 0.0, 0.0), (0.0, 0.0, yaw_deg))

    def moved(points: object) -> Float64Array:
        return geometry.transform(about, np.asarray(points) - np.array([0.5, 0.0, 0.0])) + np.array([x_m, 0.0, 0.0])

    posts = tuple(
        Post(name=one.name, position_m=tuple(moved([one.position_m])[0].tolist()), rpy_deg=(0.0, 0.0, yaw_deg))
        for one in (A, B)
    )
    points = curve(seed)
    assert windings(moved(points), posts) == pytest.approx(windings(points), abs=1e-6)


@given(seed=st.integers(0, 10_000))
def test_mirrored_and_reversed_paths_wind_the_other_way(seed: int):
    points = curve(seed)
    mirrored = points * np.array([-1.0, 1.0, 1.0]) + np.array([1.0, 0.0, 0.0])
    assert windings(mirrored) == pytest.approx([-one for one in windings(points)], abs=1e-9)
    assert windings(points[::-1]) == pytest.approx([-one for one in windings(points)], abs=1e-9)


@given(seed=st.integers(0, 10_000))
def test_the_winding_is_that_of_a_finely_sampled_path(seed: int):
    points = curve(seed)
    fine = geometry.resample(points, 60_000)[:, :2] - np.array(A.position_m[:2])
    inside = np.linalg.norm(fine, axis=1) < 0.05
    both = inside[:-1] & inside[1:]
    steps = np.diff(np.unwrap(np.arctan2(fine[:, 1], fine[:, 0])))
    assert windings(points)[0] == pytest.approx(-float(steps[both].sum()), abs=0.02)
