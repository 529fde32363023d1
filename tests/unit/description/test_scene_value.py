"""Fixtures stand on the table, apart from one another and from the arms, or are refused by name."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.description.installation import PAPERS_CELL
from dlokit.description.scene import NO_POSTS, Box, Fixture, Post, Scene, outline_xy
from dlokit.description.table import Table
from dlokit.errors import ConfigError

A = Post(name="A", position_m=(0.45, 0.10, 0.0))
BLOCK = Box(name="block", position_m=(0.55, -0.10, 0.0), size_m=(0.10, 0.04, 0.03))


def beside(fixture: Fixture, dx_m: float, dy_m: float = 0.0, yaw_deg: float = 0.0) -> Fixture:
    """The same fixture with another name, moved and turned on the table."""
    x, y, z = fixture.position_m
    return replace(fixture, name="other", position_m=(x + dx_m, y + dy_m, z), rpy_deg=(0.0, 0.0, yaw_deg))


def test_a_scene_has_no_fixtures_by_default() -> None:
    scene = Scene()
    assert (scene.arms, scene.fixtures, scene.posts) == (FIRST_ALONE, (), ())
    assert scene.posts_world is NO_POSTS


def test_the_axis_of_a_post_ends_one_radius_below_its_rounded_top() -> None:
    post = Post(name="A", position_m=(0.4, 0.1, 0.0), diameter_m=0.01, height_m=0.025, friction=0.2)
    np.testing.assert_allclose(
        Scene(fixtures=(post,)).posts_world, [[0.4, 0.1, 0.0, 0.4, 0.1, 0.020, 0.005, 0.2]], atol=1e-15
    )


def test_the_head_of_a_leaning_post_is_where_its_angles_turn_it() -> None:
    leaning = replace(A, rpy_deg=(0.0, 15.0, 0.0))  # about y: the head moves along x
    (axis,) = Scene(fixtures=(leaning,)).posts_world
    length_m, angle = 0.020, np.radians(15.0)
    np.testing.assert_allclose(
        axis[3:6] - axis[0:3], [length_m * np.sin(angle), 0.0, length_m * np.cos(angle)], atol=1e-12
    )
    assert leaning.top_m == pytest.approx(0.025 * np.cos(angle) + 0.005 * np.sin(angle))


def test_posts_are_taken_from_the_fixtures_in_their_order() -> None:
    other = replace(A, name="B", position_m=(0.5, 0.2, 0.0))
    scene = Scene(fixtures=(A, BLOCK, other))
    assert scene.posts == (A, other)
    np.testing.assert_array_equal(scene.posts_world[:, :2], [A.position_m[:2], other.position_m[:2]])


def test_the_highest_corner_of_an_inclined_box_is_its_top() -> None:
    level = Box(name="a", position_m=(0.5, 0.0, 0.0), size_m=(0.04, 0.04, 0.05))
    assert level.top_m == pytest.approx(0.05)
    inclined = replace(level, rpy_deg=(5.0, 0.0, 0.0))
    angle = np.radians(5.0)
    assert inclined.top_m == pytest.approx(0.05 * np.cos(angle) + 0.02 * np.sin(angle))


def test_the_corners_of_a_turned_box_are_in_the_world() -> None:
    turned = replace(BLOCK, rpy_deg=(0.0, 0.0, 90.0))
    half_x, half_y = 0.02, 0.05  # its extents have changed places
    corners = turned.corners_world
    np.testing.assert_allclose(corners.min(axis=0), [0.55 - half_x, -0.10 - half_y, 0.0], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [0.55 + half_x, -0.10 + half_y, 0.03], atol=1e-12)


@pytest.mark.parametrize(
    ("first", "dx_m", "dy_m", "yaw_deg", "overlaps"),
    [
        # Posts of 10 mm touch at 10 mm between their axes.
        (A, 0.0099, 0.0, 0.0, True),
        (A, 0.0101, 0.0, 0.0, False),
        (A, 0.007, 0.007, 0.0, True),
        (A, 0.0072, 0.0072, 0.0, False),
        # Boxes of 100 mm × 40 mm side by side, and one after the other.
        (BLOCK, 0.0, 0.039, 0.0, True),
        (BLOCK, 0.0, 0.041, 0.0, False),
        (BLOCK, 0.099, 0.0, 0.0, True),
        (BLOCK, 0.101, 0.0, 0.0, False),
        # Turned by 90° it is 40 mm along x: half of 100 and of 40.
        (BLOCK, 0.069, 0.0, 90.0, True),
        (BLOCK, 0.071, 0.0, 90.0, False),
        # Turned by 45°, the rectangles along x and y around both overlap, the boxes do not.
        (BLOCK, 0.085, 0.055, -45.0, False),
        (BLOCK, 0.085, 0.055, 45.0, True),
    ],
)
def test_fixtures_overlap_exactly_where_their_outlines_do(
    first: Fixture, dx_m: float, dy_m: float, yaw_deg: float, overlaps: bool
) -> None:
    other = beside(first, dx_m, dy_m, yaw_deg)
    if not overlaps:
        assert Scene(fixtures=(first, other)).fixtures == (first, other)
        return
    for pair in ((first, other), (other, first)):
        with pytest.raises(ConfigError, match=f"{pair[0].name} and {pair[1].name} overlap: correct"):
            Scene(fixtures=pair)


def test_two_fixtures_at_the_same_place_overlap() -> None:
    for first in (A, BLOCK):
        with pytest.raises(ConfigError, match="overlap"):
            Scene(fixtures=(first, replace(first, name="other")))


def test_a_post_is_round_at_the_corner_of_a_box() -> None:
    corner = np.array(BLOCK.position_m[:2]) + np.array(BLOCK.size_m[:2]) / 2.0

    def post(distance_m: float) -> Post:
        return replace(A, position_m=(*(corner + distance_m * np.sqrt(0.5)).tolist(), 0.0))

    with pytest.raises(ConfigError, match="overlap"):
        Scene(fixtures=(BLOCK, post(0.0049)))
    assert len(Scene(fixtures=(BLOCK, post(0.0051))).fixtures) == 2  # its square would reach 7.1 mm


def test_a_leaning_post_covers_the_table_below_its_head() -> None:
    tall = Post(name="tall", position_m=(0.45, 0.10, 0.0), height_m=0.30, rpy_deg=(0.0, 20.0, 0.0))
    below = replace(A, name="below", position_m=(0.45 + 0.09, 0.10, 0.0))  # the head is at 0.295 · sin 20° = 0.101
    behind = replace(A, name="behind", position_m=(0.45 - 0.09, 0.10, 0.0))
    with pytest.raises(ConfigError, match="tall and below overlap"):
        Scene(fixtures=(tall, below))
    assert len(Scene(fixtures=(tall, behind)).fixtures) == 2


@pytest.mark.parametrize("x_m", [0.0, 0.05])
def test_a_fixture_in_the_base_of_an_arm_is_refused_with_the_name_of_the_arm(x_m: float) -> None:
    with pytest.raises(ConfigError, match="the fixture A stands in the base of the first arm"):
        Scene(fixtures=(replace(A, position_m=(x_m, 0.0, 0.0)),))


def test_the_base_of_the_second_arm_counts_where_it_is() -> None:
    arms: tuple[ArmMount, ...] = PAPERS_CELL.mounts(2)
    place_m = (*arms[1].place_m[:2], 0.0)
    there = replace(A, position_m=place_m)
    table = Table(size_m=(3.0, 1.4))
    assert Scene(table=table, arms=arms[:1], fixtures=(there,)).fixtures == (there,)
    with pytest.raises(ConfigError, match="stands in the base of the second arm"):
        Scene(table=table, arms=arms, fixtures=(there,))


@pytest.mark.parametrize(
    ("fixtures", "says"),
    [
        ((A, replace(A, position_m=(0.5, 0.2, 0.0))), "two fixtures are called A"),
        ((replace(A, position_m=(0.45, 0.10, 0.0125)),), "A stands 12 mm over the table: correct the z"),
        ((replace(A, position_m=(0.45, 0.10, -0.003)),), "A stands 3 mm below the table: correct the z"),
        ((replace(A, position_m=(450.0, 100.0, 0.0)),), "A at [450.0, 100.0] m stands off the table"),
        # The table's edge is at y = 0.7: 20 mm of the box are beyond it.
        ((replace(BLOCK, position_m=(0.55, 0.70, 0.0)),), "block at [0.55, 0.7] m stands off the table"),
        # On its side its foot's middle is at the table, and half of the box below it.
        ((replace(BLOCK, rpy_deg=(90.0, 0.0, 0.0)),), "the box block reaches 20 mm into the table"),
    ],
)
def test_fixtures_that_cannot_stand_where_they_are_said_to_be_are_refused(
    fixtures: tuple[Fixture, ...], says: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(says)):
        Scene(fixtures=fixtures)


def test_a_foot_measured_a_millimetre_off_the_table_is_on_it() -> None:
    for z_m in (-0.001, 0.001):
        assert Scene(fixtures=(replace(A, position_m=(0.45, 0.10, z_m)),)).posts_world[0, 2] == z_m


@pytest.mark.parametrize(
    ("kind", "values", "says"),
    [
        (Post, {"diameter_m": -0.01}, "the fixture A: diameter_m is -0.01; it must be above 0 and at most 2."),
        (Post, {"height_m": 25.0}, "the fixture A: height_m is 25.0; it must be above 0 and at most 2."),
        (Box, {"size_m": (0.05, 0.05, 0.0)}, "the fixture A: size_m is (0.05, 0.05, 0.0); it must be"),
        (Box, {"friction": -0.1}, "the fixture A: friction is -0.1; it must be 0 or greater."),
        (Box, {"position_m": (0.4, float("nan"), 0.0)}, "it must be a finite number in each value."),
        (
            Post,
            {"height_m": 0.004},
            "the height of a post is at least half of its diameter: describe a flat one as a box.",
        ),
        (Post, {"rpy_deg": (0.0, -30.0, 0.0)}, "the post A leans by 30°; at most 20° are allowed"),
        (Post, {"rpy_deg": (180.0, 0.0, 0.0)}, "the post A leans by 180°"),
        (Post, {"name": "left post"}, "the name of a fixture is 'left post'; use up to 20 letters, digits and _."),
        (Post, {"name": ""}, "the name of a fixture is ''"),
    ],
)
def test_a_fixture_that_cannot_be_is_refused_by_its_name(
    kind: type[Fixture], values: dict[str, Any], says: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(says)):
        replace(kind(name="A", position_m=(0.45, 0.10, 0.0)), **values)


def test_a_pose_turns_about_the_fixed_axes_of_the_world() -> None:
    pose = replace(BLOCK, rpy_deg=(0.0, 0.0, 30.0)).T_world_foot
    assert pose.position_m.tolist() == list(BLOCK.position_m)
    np.testing.assert_allclose(geometry.rotation(pose)[:, 0], [np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0], atol=1e-12)


def test_a_leaning_post_is_drawn_from_above_with_its_foot_and_its_head() -> None:
    leaning = replace(A, rpy_deg=(0.0, 15.0, 0.0))
    head_x = 0.45 + 0.025 * np.sin(np.radians(15.0))
    outline = outline_xy(leaning)
    radius = 0.005
    np.testing.assert_allclose(
        outline.min(axis=0), [0.45 - radius * np.cos(np.radians(15.0)), 0.10 - radius], atol=1e-9
    )
    np.testing.assert_allclose(
        outline.max(axis=0), [head_x + radius * np.cos(np.radians(15.0)), 0.10 + radius], atol=1e-9
    )


def test_a_turned_box_is_drawn_from_above_by_its_four_corners() -> None:
    outline = outline_xy(replace(BLOCK, rpy_deg=(0.0, 0.0, 45.0)))
    assert len(outline) == 4
    reach = (0.05 + 0.02) * np.sqrt(0.5)
    np.testing.assert_allclose(outline.max(axis=0) - BLOCK.position_m[:2], [reach, reach], atol=1e-12)


def test_edges_join_the_rims_and_follow_them() -> None:
    assert Scene().edges_world.shape == (0, 2, 3)
    edges = Scene(fixtures=(BLOCK,)).edges_world
    assert edges.shape == (12, 2, 3)
    lengths = np.sort(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1))
    np.testing.assert_allclose(lengths, np.repeat(np.sort(BLOCK.size_m), 4))
    post = Scene(fixtures=(A,)).edges_world
    upright = post[np.abs(post[:, 1, 2] - post[:, 0, 2]) > 1e-9]
    np.testing.assert_allclose(upright[:, 1] - upright[:, 0], np.tile([0.0, 0.0, 0.025], (4, 1)), atol=1e-12)
    assert len(Scene(fixtures=(A, BLOCK)).edges_world) == len(post) + 12
