import itertools

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description import shapes
from dlokit.description.dlo import SOFT_ROPE
from dlokit.description.scene import Post
from dlokit.extras.bench.shaping import among_posts
from dlokit.extras.bench.shaping.cases import ShapingMethod, cases
from dlokit.extras.bench.shaping.experiments import Experiment
from dlokit.extras.bench.shaping.suites import pegs_suite, posts_suite
from dlokit.system.config import RunConfig
from dlokit.types.arrays import Float64Array

METHOD = ShapingMethod(observer="map", planner="rollout")
FREE_M = among_posts.POST_DIAMETER_M / 2.0 + SOFT_ROPE.radius_m + 0.004


def goal_and_posts(experiment: Experiment) -> tuple[Float64Array, tuple[Post, ...]]:
    run = experiment.configured(RunConfig())
    goal = experiment.goal.nodes_world(run.model.length_m, run.model.radius_m)
    return geometry.resample(goal, 2001), run.scene.posts


def beside_m(curve_world: Float64Array, one: Post) -> float:
    return float(np.linalg.norm(curve_world[:, :2] - one.position_m[:2], axis=1).min())


@pytest.mark.parametrize("experiment", [*posts_suite(), *pegs_suite()], ids=lambda one: one.name)
def test_goals_and_starts_of_every_seed_are_clear_of_the_posts(experiment: Experiment) -> None:
    for case in cases([experiment], 6, [METHOD], first_seed=500):
        goal, standing = goal_and_posts(case.experiment)
        start = case.experiment.start_world(case.experiment.dlo or SOFT_ROPE, case.run_seed)
        assert standing
        for one in standing:
            assert beside_m(goal, one) > FREE_M
            assert beside_m(geometry.resample(start, 2001), one) > FREE_M


def test_the_posts_inside_the_s_stand_on_alternate_sides() -> None:
    curve = geometry.resample(shapes.builtin_shape("S", SOFT_ROPE.length_m, 101), 2001)
    along = geometry.tangents(curve)[:, :2]
    lefts = []
    for one in among_posts.inside_s():
        away = np.array(one.position_m[:2]) - curve[:, :2]
        nearest = int(np.argmin(np.linalg.norm(away, axis=1)))
        assert np.linalg.norm(away[nearest]) == pytest.approx(among_posts.BESIDE_M, abs=1e-3)
        lefts.append(along[nearest, 0] * away[nearest, 1] - along[nearest, 1] * away[nearest, 0] > 0.0)
    assert lefts in ([True, True, False, False], [False, False, True, True])


def test_posts_and_goal_are_drawn_from_the_seed_alone() -> None:
    start = shapes.builtin_shape("I", SOFT_ROPE.length_m, 101)
    assert among_posts.drawn(7, start) == among_posts.drawn(7, start)
    assert among_posts.drawn(7, start) != among_posts.drawn(8, start)


def test_drawn_scenes_have_three_to_six_posts_with_room_for_a_hand_between_them() -> None:
    counts = set()
    for case in cases([posts_suite()[-1]], 25, [METHOD]):
        _, standing = goal_and_posts(case.experiment)
        counts.add(len(standing))
        for one, other in itertools.combinations(standing, 2):
            assert np.hypot(*np.subtract(one.position_m, other.position_m)[:2]) >= 0.069
    assert counts == {3, 4, 5, 6}


def test_the_curve_around_the_pegs_passes_the_first_on_its_left_and_the_second_on_its_right() -> None:
    standing, curve = among_posts.pegs()
    goal = curve.nodes_world(among_posts.PEGS_LENGTH_M, 0.004)
    assert shapes.length(goal) == pytest.approx(among_posts.PEGS_LENGTH_M, rel=2e-3)
    turned = []
    for one in standing:
        away = goal[:, :2] - one.position_m[:2]
        near = away[np.linalg.norm(away, axis=1) < 0.05]
        cross = near[:-1, 0] * near[1:, 1] - near[:-1, 1] * near[1:, 0]
        turned.append(float(np.sum(np.arctan2(cross, np.sum(near[:-1] * near[1:], axis=1)))))
    assert turned[0] > 2.6
    assert turned[1] < -2.6


def test_the_posts_of_an_experiment_replace_the_installed_ones() -> None:
    run = posts_suite()[0].configured(RunConfig())
    assert [one.name for one in run.scene.posts] == ["A", "B", "C", "D"]
