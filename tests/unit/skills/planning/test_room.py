import numpy as np
import pytest

from dlokit.description.arm.franka import PANDA
from dlokit.description.scene import Post, Scene
from dlokit.motion.tool_path import ROUNDING_M
from dlokit.skills.planning.room import HandRoom
from dlokit.types.arrays import Float64Array

DOWN_M = PANDA.gripper.grasp_height_m()
RADIUS_M = 0.004


def room(*places_m: tuple[float, float], height_m: float = 0.025) -> HandRoom:
    fixtures = tuple(
        Post(name=f"P{number}", position_m=(*place, 0.0), height_m=height_m) for number, place in enumerate(places_m)
    )
    return HandRoom(PANDA, Scene(fixtures=fixtures), RADIUS_M)


def carry(*places_m: tuple[float, float], lift_m: float = 0.06, yaw_rad: float = 0.0) -> Float64Array:
    """Waypoints down at the first place, up, over the others, down at the last; the fingers open along y."""
    (x0, y0), (x1, y1) = places_m[0], places_m[-1]
    lifted = [(x, y, DOWN_M + lift_m, yaw_rad) for x, y in places_m]
    return np.array([(x0, y0, DOWN_M, yaw_rad), *lifted, (x1, y1, DOWN_M, yaw_rad)])


def test_without_fixtures_the_widest_opening_is_taken() -> None:
    assert room().opening_m(carry((0.5, 0.0), (0.6, 0.0)), (0.05, 0.03)) == 0.05


def test_a_post_where_the_open_fingers_would_descend_takes_a_narrower_opening() -> None:
    # The fingers open along y: at 50 mm they cover 25 to 46 mm beside the rod, at 20 mm 10 to 31 mm.
    beside = room((0.5, 0.048))
    assert beside.opening_m(carry((0.5, 0.0), (0.6, 0.0)), (0.05, 0.03, 0.02)) == 0.02
    assert beside.opening_m(carry((0.6, 0.0), (0.5, 0.0)), (0.05, 0.03, 0.02)) == 0.02, "at the release as well"


def test_a_post_between_the_fingers_leaves_no_room() -> None:
    assert room((0.5, 0.012)).opening_m(carry((0.5, 0.0), (0.6, 0.0)), (0.05, 0.04, 0.03)) is None


@pytest.mark.parametrize(("lift_m", "free"), [(0.004, False), (0.06, True)])
def test_a_drag_through_a_post_has_no_room_and_a_carry_over_it_has(lift_m: float, free: bool) -> None:
    tool = carry((0.5, -0.1), (0.5, 0.1), lift_m=lift_m, yaw_rad=np.pi / 2.0)
    assert (room((0.5, 0.0)).opening_m(tool, (0.04,)) is not None) is free


def test_the_rounded_corner_counts_and_not_the_corner() -> None:
    # The lift and the carry are joined by a curve that passes below the corner, over the post.
    near = 0.5 + 0.4 * ROUNDING_M
    tool = carry((0.5, 0.0), (0.7, 0.0), lift_m=0.05, yaw_rad=np.pi / 2.0)
    assert room((near, 0.0), height_m=0.02).opening_m(tool, (0.02,)) is None
    corners = room((near, 0.0), height_m=0.02)
    assert all(corners.held_along(tool[k : k + 2]) for k in range(1, len(tool) - 1)), "the straight lines are free"


def test_closed_fingers_that_push_have_room_where_open_ones_have_none() -> None:
    push = np.array([(0.5, 0.0, DOWN_M, 0.0), (0.55, 0.0, DOWN_M, 0.0)])
    assert room((0.5, 0.042)).opening_m(push, (0.0,), holds=False) == 0.0
    assert room((0.56, 0.0)).opening_m(push, (0.0,), holds=False) is None
