"""No part of an arm comes nearer to a fixture than allowed, also between the samples of a trajectory."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dlokit.description.arm.franka import PANDA
from dlokit.description.arm.model import ArmModel
from dlokit.description.arm.mounts import arm_model
from dlokit.description.scene import Box, Fixture, Post
from dlokit.errors import SkillFailure
from dlokit.geometry import downward, pose, transform
from dlokit.motion import fixture_checks
from dlokit.motion.collisions import COLLISION_STEP_RAD
from dlokit.motion.fixture_checks import check_fixtures_clear
from dlokit.motion.fixture_clearance import (
    FIXTURE_CLEARANCE_M,
    RESOLUTION_M,
    arm_solids,
    fixture_solids,
    gaps_m,
)
from dlokit.motion.inverse_kinematics import ArmKinematics, Yaw
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotReason, remedy_of

KINEMATICS = ArmKinematics(PANDA)
LEANING = PANDA.home_q_rad + np.array([0.4, 0.5, 0.3, 0.2, 0.4, 0.2, 0.3])
MOVING = [number for number, capsule in enumerate(PANDA.capsules) if capsule.link != PANDA.base]
PHASES = (0.0, 0.17, 0.39, 0.5, 0.71, 0.93)
THIN_M = 0.004


def dense_m(arm: ArmModel, q_rad: Float64Array, width_m: float, fixtures: tuple[Fixture, ...]) -> float:
    """Least distance on the straight lines in joint space, 100 postures each."""
    share = np.linspace(0.0, 1.0, 100)[:, None]
    rows = np.concatenate([a + share * (b - a) for a, b in itertools.pairwise(q_rad)])
    return float(gaps_m(arm_solids(arm, rows, width_m), fixture_solids(fixtures)).min())


def start_m(arm: ArmModel, q_rad: Float64Array, width_m: float, fixtures: tuple[Fixture, ...]) -> float:
    return float(gaps_m(arm_solids(arm, q_rad[:1], width_m), fixture_solids(fixtures)).min())


def refusal(
    arm: ArmModel, q_rad: Float64Array, widths_m: float | tuple[float, float], fixtures: tuple[Fixture, ...]
) -> str:
    """Why a motion is refused; empty if it is not."""
    try:
        check_fixtures_clear(arm, q_rad, widths_m, fixtures)
    except SkillFailure as failure:
        return failure.detail
    return ""


def thin_post(head_world: Float64Array) -> tuple[Fixture, ...]:
    """A post whose axis ends at a point."""
    x, y, z = head_world.tolist()
    return (Post(name="thin", position_m=(x, y, 0.0), diameter_m=THIN_M, height_m=max(z, THIN_M / 2.0)),)


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("number", MOVING)
def test_no_link_passes_a_thin_post_at_any_phase_of_the_sampling(number: int, phase: float) -> None:
    capsule = PANDA.capsules[number]
    alone = replace(PANDA, capsules=(capsule,))  # with the boxes around the fingers
    middle = arm_solids(alone, LEANING, 0.0)[0, 0, 9:12]
    q_rad = LEANING + (np.arange(-4.0, 5.0) + phase)[:, None] * COLLISION_STEP_RAD * np.ones(7)
    post = thin_post(middle)
    assert dense_m(alone, q_rad, 0.0, post) < FIXTURE_CLEARANCE_M
    assert "the fixture thin" in refusal(alone, q_rad, 0.0, post)


@pytest.mark.parametrize("phase", PHASES[::2])
@pytest.mark.parametrize("number", MOVING)
def test_a_link_that_only_grazes_a_post_is_refused_or_not_as_a_dense_search_says(number: int, phase: float) -> None:
    alone = replace(PANDA, capsules=(PANDA.capsules[number],))
    middle = arm_solids(alone, LEANING, 0.0)[0, 0, 9:12]
    q_rad = LEANING + (np.arange(-2.0, 3.0) + phase)[:, None] * COLLISION_STEP_RAD * np.array([1, 0, 0, 0, 0, 0, 0])
    seen: set[bool] = set()
    for below_m in np.linspace(0.0, 0.26, 48):  # the link passes over the post's head
        post = thin_post(middle - np.array([0.0, 0.0, below_m]))
        least_m = dense_m(alone, q_rad, 0.0, post)
        if abs(least_m - FIXTURE_CLEARANCE_M) > 2.0 * RESOLUTION_M:
            refused = bool(refusal(alone, q_rad, 0.0, post)) or start_m(alone, q_rad, 0.0, post) < FIXTURE_CLEARANCE_M
            assert refused == (least_m < FIXTURE_CLEARANCE_M)
            seen.add(refused)
    assert seen == {True, False}


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 100_000), st.sampled_from(["panda", "ur5e"]))
def test_any_motion_among_posts_and_turned_boxes_is_refused_as_a_dense_search_says(seed: int, name: str) -> None:
    rng, arm = np.random.default_rng(seed), arm_model(name)
    kinematics = ArmKinematics(arm)
    places = rng.uniform((0.35, -0.2, 0.011), (0.6, 0.2, 0.12), (3, 3))
    q_rad = np.array(
        [kinematics.inverse(downward(place, rng.uniform(-1, 1)), arm.home_q_rad, Yaw.EITHER) for place in places]
    )
    fixtures = (
        *(Post(name=f"p{i}", position_m=(*rng.uniform((0.3, -0.2), (0.6, 0.2)), 0.0)) for i in range(3)),
        Box(
            name="box",
            position_m=(*rng.uniform((0.3, -0.2), (0.6, 0.2)), 0.0),
            rpy_deg=tuple(rng.uniform(-180.0, 180.0, 3).tolist()),
            size_m=(0.02, 0.05, 0.06),
        ),
    )
    width_m = rng.uniform(0.0, arm.gripper.open_width_m)
    if start_m(arm, q_rad, width_m, fixtures) < FIXTURE_CLEARANCE_M:
        return
    least_m = dense_m(arm, q_rad, width_m, fixtures)
    if least_m < FIXTURE_CLEARANCE_M - 2.0 * RESOLUTION_M:
        assert refusal(arm, q_rad, width_m, fixtures)
    elif least_m > FIXTURE_CLEARANCE_M + 0.003:  # two postures of the search are up to 6 mm apart
        assert not refusal(arm, q_rad, width_m, fixtures)


def test_a_base_elsewhere_takes_the_arm_to_the_fixture() -> None:
    T_world_base = pose([0.2, -0.3, 0.0], [0.9, 0.0, 0.0, np.sqrt(0.19)])
    q_rad = KINEMATICS.inverse(downward([0.5, 0.0, 0.05], 0.0))[None]
    x, y, _ = transform(T_world_base, np.array([[0.5, 0.0, 0.0]]))[0].tolist()
    post = (Post(name="under", position_m=(x, y, 0.0), height_m=0.045),)
    with pytest.raises(SkillFailure, match=r"finger would come to .* mm from the fixture under"):
        check_fixtures_clear(PANDA, q_rad, 0.0, post, T_world_base, may_leave=False)
    check_fixtures_clear(PANDA, q_rad, 0.0, post, may_leave=False)


def test_a_motion_that_passes_at_the_allowed_distance_needs_few_postures(monkeypatch: pytest.MonkeyPatch) -> None:
    q_rad = KINEMATICS.inverse(downward([0.5, 0.0, 0.011], 0.0)) + np.linspace(-0.3, 0.3, 100)[:, None] * np.eye(7)[0]
    post = (Post(name="behind", position_m=(0.5, 0.0, 0.0), height_m=0.02),)
    measured: list[int] = []
    plain = gaps_m

    def counted(parts: Float64Array, fixtures: Float64Array) -> Float64Array:
        measured.append(len(parts))
        return plain(parts, fixtures)

    monkeypatch.setattr(fixture_checks, "gaps_m", counted)
    for x_m in np.arange(0.45, 0.5, 0.0005):
        measured.clear()
        refusal(PANDA, q_rad, 0.0, (replace(post[0], position_m=(x_m, 0.0, 0.0)),))
        assert sum(measured) < 400  # 21 of them are samples


def test_the_failure_names_link_fixture_distance_and_remedy() -> None:
    q_rad = KINEMATICS.inverse(downward([0.5, 0.0, 0.03], 0.0))[None]
    with pytest.raises(SkillFailure) as failure:
        check_fixtures_clear(PANDA, q_rad, 0.0, (Post(name="peg", position_m=(0.5, 0.0, 0.0)),), may_leave=False)
    assert "finger would come to 0.0 mm from the fixture peg" in failure.value.detail
    assert "at least 4.0 mm are allowed; go over it" in failure.value.detail
    assert failure.value.reason == RobotReason.FIXTURE_COLLISION
    assert remedy_of(failure.value.reason) == remedy_of(RobotReason.TABLE_COLLISION)


def test_an_arm_that_touches_a_fixture_may_move_away_but_not_come_nearer() -> None:
    post = (Post(name="touched", position_m=(0.5, 0.026, 0.0)),)
    places = {"up": (0.5, 0.0, 0.06), "away": (0.5, -0.03, 0.011), "into it": (0.5, 0.004, 0.011)}
    here = KINEMATICS.inverse(downward((0.5, 0.0, 0.011), 0.0))
    refused = {
        name: refusal(PANDA, np.array([here, KINEMATICS.inverse(downward(place, 0.0), here)]), 0.0, post)
        for name, place in places.items()
    }
    assert refused["up"] == refused["away"] == ""
    assert "touched" in refused["into it"]


def test_fingers_that_open_or_close_are_checked_over_the_whole_range_of_widths() -> None:
    q_rad = np.repeat(KINEMATICS.inverse(downward((0.5, 0.0, 0.011), 0.0))[None], 2, axis=0)
    post = (Post(name="near", position_m=(0.5, 0.045, 0.0), height_m=0.018),)
    assert refusal(PANDA, q_rad, (0.0, 0.02), post) == ""
    assert "right_finger" in refusal(PANDA, q_rad, (0.0, 0.04), post)
    between = (Post(name="between", position_m=(0.5, 0.0, 0.0), diameter_m=THIN_M, height_m=0.018),)
    assert refusal(PANDA, q_rad, (0.04, 0.02), between) == ""
    assert "between" in refusal(PANDA, q_rad, (0.04, 0.0), between)
    # Both widths are clear, with the finger on either side of the post; on its way it strikes the post.
    passed = (Post(name="passed", position_m=(0.5, 0.03, 0.0), diameter_m=0.002, height_m=0.018),)
    for width_m in (0.0, 0.08):
        check_fixtures_clear(PANDA, q_rad, width_m, passed, may_leave=False)
    assert "passed" in refusal(PANDA, q_rad, (0.0, 0.08), passed)
